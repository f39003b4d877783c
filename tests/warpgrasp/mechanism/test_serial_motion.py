"""A hand on a serial arm: taken to its poses, in the time of its joints, with its errors."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strategies.ready_made import STRATEGIES
from sweeps.episode.episodes import run_block
from sweeps.figures.replay_frames import arm_points, make_replay
from sweeps.spec.cell import Cell
from sweeps.spec.errors import SpecError
from sweeps.spec.reader import read_spec
from warpgrasp.arms.arm_file import SHIPPED_ARMS, arm_named, arm_text
from warpgrasp.arms.serial_arm import flange_poses, serial_places
from warpgrasp.geometry.body import Body, Part, scene_of
from warpgrasp.geometry.scene import Shape
from warpgrasp.mechanism.arm import arm_home
from warpgrasp.mechanism.arm_motion import ArmState, arm_hand_links, move_hand
from warpgrasp.mechanism.arm_reach import hand_reachable, pose_reachable, travel_time
from warpgrasp.mechanism.calibration import draw_calibration
from warpgrasp.parameters import ArmTable, ErrorTable, HandTable
from warpgrasp.probe_status import ProbeStatus

HAND = HandTable()
CRUMB = Body("crumb", (Part(Shape.SPHERE, size_m=(0.001, 0, 0)),), (-0.001,) * 3, (0.001,) * 3)
KEY = np.arange(4, dtype=np.uint64) + 7


def exact(name: str) -> ArmTable:
    return ArmTable(kind=name, repeatability_m=0.0, encoder_step_rad=0.0)


def hand_poses(count: int, seed: int = 0) -> np.ndarray:
    """About where objects stand, the palm towards them from above."""
    rng = np.random.default_rng(seed)
    place = rng.uniform([0.35, -0.1, 0.2], [0.55, 0.1, 0.35], (count, 3))
    turn = Rotation.from_euler("zyz", np.stack([
        rng.uniform(-1.0, 1.0, count), np.pi - rng.uniform(0.0, 0.5, count),
        rng.uniform(-1.0, 1.0, count)], 1))
    return np.concatenate([place, turn.as_quat()], 1)


def moved(arm: ArmTable, poses: np.ndarray, errors=None, worlds: int = 1):
    return move_hand(
        scene_of([CRUMB], "cpu"), np.zeros(1, int), np.tile([2.0, 2, 0, 0, 0, 0, 1.0], (worlds, 1)),
        arm, HAND, KEY[:worlds], ArmState.home(worlds, arm), np.tile(poses, (worlds, 1, 1)),
        np.ones((worlds, len(poses)), bool), np.zeros((1, 4, 1, 4)), errors=errors)


@pytest.mark.parametrize("name", SHIPPED_ARMS)
def test_reachable_poses_are_taken_exactly(name: str) -> None:
    arm, poses = exact(name), hand_poses(30)
    moves, actual = moved(arm, poses)
    made = moves.status[0, :, 0] != ProbeStatus.UNREACHABLE
    assert made.sum() > 20
    np.testing.assert_allclose(actual[0, made, :3], poses[made, :3], atol=2e-8)
    np.testing.assert_array_equal(moves.believed_pose[0, made], actual[0, made])
    assert (moves.time_s[0, made] > 0.0).all()
    # What a strategy may ask beforehand says the same.
    np.testing.assert_array_equal(pose_reachable(arm, HAND, poses), made)
    far = poses + np.array([3.0, 0, 0, 0, 0, 0, 0])
    assert not hand_reachable(arm, HAND, far).any()
    assert (moved(arm, far)[0].status == ProbeStatus.UNREACHABLE).all()


def test_joints_go_to_the_nearest_step_of_their_encoders() -> None:
    """From home: every joint asked for lies within 0.4 steps of a step."""
    step, model, rng = 0.02, arm_named("ur5e"), np.random.default_rng(3)
    stepped = step * np.round((np.array(model.home_rad) + rng.uniform(-0.1, 0.1, (8, 6))) / step)
    mount = [0.0, 0.0, HAND.mount_length_m]

    def hand_at(q: np.ndarray) -> np.ndarray:
        flange = flange_poses(model, q)
        tool = Rotation.from_quat(flange[:, 3:]).apply(mount)
        return np.concatenate([flange[:, :3] + tool, flange[:, 3:]], 1)

    arm = replace(exact("ur5e"), encoder_step_rad=step)
    wanted = hand_at(stepped + step * rng.uniform(-0.4, 0.4, stepped.shape))
    moves, actual = moved(arm, wanted)
    assert (moves.status[0, :, 0] != ProbeStatus.UNREACHABLE).all()
    np.testing.assert_array_equal(moves.believed_pose, actual)
    np.testing.assert_allclose(actual[0, :, :3], hand_at(stepped)[:, :3], atol=1e-6)
    assert np.linalg.norm(actual[0] - wanted, axis=-1).min() > 1e-3


def test_an_arms_file_that_has_changed_is_read_again(tmp_path: Path) -> None:
    """Both the arm that is believed and the true one: poses are taken exactly again."""
    file, model, poses = tmp_path / "arm.toml", arm_named("ur5e"), hand_poses(8)
    homes = []
    for lower_m in (0.0, 0.05):
        x, y, z = model.base_xyz_m
        file.write_text(arm_text(replace(
            model, base_xyz_m=(x, y, z - lower_m), home_rad=(lower_m, *model.home_rad[1:]))))
        arm = exact(str(file))
        homes.append(arm_home(arm)[0])
        moves, actual = moved(arm, poses)
        made = moves.status[0, :, 0] != ProbeStatus.UNREACHABLE
        assert made.sum() > 3
        np.testing.assert_allclose(actual[0, made, :3], poses[made, :3], atol=2e-8)
    assert homes == [pytest.approx(0.0), pytest.approx(0.05)]


@pytest.mark.parametrize("name", SHIPPED_ARMS)
def test_no_move_is_faster_than_its_slowest_joint(name: str) -> None:
    arm, poses = exact(name), hand_poses(8, 1)
    taken = pose_reachable(arm, HAND, poses)
    assert taken.sum() > 3
    a, b = poses[taken][:-1], poses[taken][1:]
    time = travel_time(arm, HAND, a, b)
    way = np.linalg.norm(a[:, :3] - b[:, :3], axis=1)
    fastest = sum(joint.speed_rad_s for joint in arm_named(name).joints)  # at a metre's lever
    assert np.isfinite(time).all()
    assert (time >= way / fastest).all()
    np.testing.assert_allclose(travel_time(arm, HAND, a, a), 0.0, atol=1e-6)


@pytest.mark.parametrize("name", SHIPPED_ARMS)
def test_the_true_arm_has_its_joints_offsets_and_lengths(name: str) -> None:
    arm, poses = exact(name), hand_poses(6, 2)
    errors = replace(ErrorTable.none(), arm_joint_offset_rad=2e-3, arm_link_m=1e-3)
    drawn = draw_calibration(errors, KEY)
    moves, actual = moved(arm, poses, drawn, 4)
    made = moves.status[0, :, 0] == ProbeStatus.CONTACT
    off = np.linalg.norm(actual[:, made, :3] - poses[made, :3], axis=-1)
    assert made.sum() > 2
    assert (off > 1e-5).all()
    assert (off < 0.03).all()
    # The last retreat's joints with the offsets alone, against a model with longer ways.
    model = arm_named(name)
    for world in range(4):
        joints, left = [], list(drawn.arm_length_m[world])
        for number, joint in enumerate(model.joints):
            length = float(np.linalg.norm(joint.xyz_m))
            if number and length > 0.0 and left:
                share = 1.0 + left.pop(0) / length
                joint = replace(joint, xyz_m=tuple(share * v for v in joint.xyz_m))
            joints.append(joint)
        own = replace(model, joints=tuple(joints))
        q = moves.state.q_rad[world, :len(joints)] + drawn.arm_offset_rad[world, :len(joints)]
        retreat = flange_poses(own, q[None])[0]
        last = np.flatnonzero(moves.status[world, :, 0] != ProbeStatus.UNREACHABLE)[-1]
        back = Rotation.from_quat(poses[last, 3:]).apply([0.0, 0.0, 0.12 + HAND.mount_length_m])
        assert np.linalg.norm(retreat[:3] - (poses[last, :3] - back)) < 0.03
        assert np.linalg.norm(retreat[:3] - (poses[last, :3] - back)) > 1e-5


def test_points_of_the_robot_and_of_its_picture_agree() -> None:
    arm = ArmTable(kind="panda")
    q = arm_home(arm)
    points, turn = arm_points(arm, q, HAND.mount_length_m)
    assert len(points) == 10
    places = serial_places(arm_named("panda"), q)
    np.testing.assert_allclose(points[-2], places[-1, :3])
    found, _ = arm_hand_links(arm, HAND, np.concatenate([q, np.zeros(16)])[None])
    base = found[0, 0, 0]
    np.testing.assert_allclose(np.linalg.norm(base - points[-1]), np.hypot(
        HAND.palm_gap_m / 2, HAND.finger_spacing_m), atol=1e-9)
    assert np.isclose(np.linalg.norm(turn), 1.0)


@pytest.mark.parametrize("name", SHIPPED_ARMS)
def test_episodes_run_on_the_arm(name: str) -> None:
    cell = Cell(STRATEGIES["ring6"], {"name": "large_cylinder"}, "large_cylinder", seed=1,
                arm=ArmTable(kind=name))
    block = run_block(cell, np.arange(4), "cpu")
    assert (block.status == "ok").all()
    assert np.median(block.scores.chamfer_m) < 0.008
    replay = make_replay(cell, block, 0)
    assert len(replay.frames) > 10


def spec_text(arm: str) -> str:
    return ('schema = 1\nepisodes_per_cell = 2\nobjects = ["block"]\n' + arm
            + '\n[[strategy]]\nname = "ring6"\n')


def test_a_spec_names_its_arm(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(arm_text(arm_named("ur5e")))
    file = tmp_path / "study.toml"
    for word, kind in (('"panda"', "panda"), ('"mine.toml"', str(tmp_path / "mine.toml"))):
        file.write_text(spec_text(f"arm = {word}"))
        assert read_spec(file).tables["arm"].kind == kind


@pytest.mark.parametrize(("arm", "message"), [
    ('arm = "ur5"', "ur5e"), ('arm = "none.toml"', "none.toml"),
    ('arm = {kind = "ur5e", d_mm = [1, 2, 3, 4, 5, 6]}', "PUMA 560"),
    ('arm = {kind = "ur5e", wrist_speed_mm_s = 3}', "floating wrist"),
])
def test_what_is_wrong_with_an_arm_is_named(arm: str, message: str, tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    file.write_text(spec_text(arm))
    with pytest.raises(SpecError, match="arm") as error:
        read_spec(file)
    assert message in str(error.value)


@pytest.mark.parametrize(("arm", "rest", "message"), [
    ("panda", '[sweep.grid]\n"arm.speed_deg_s" = [[82, 54, 122, 228, 241, 228]]', "PUMA 560"),
    ("none", '[sweep.grid]\n"arm.speed_deg_s" = [[82, 54, 122, 228, 241, 228]]',
     "a floating wrist has box_low_mm, box_high_mm, wrist_speed_mm_s, wrist_turn_deg_s"),
    ("puma560", '[sweep.grid]\n"arm.wrist_speed_mm_s" = [300, 500]', "the PUMA 560 has d_mm"),
    ("none", '[sweep.grid]\n"errors.arm_link_mm" = [0.3, 1.0]', "an error of an arm's joints"),
    ("none", "[errors]\narm_link_mm = 1.0", "an error of an arm's joints"),
])
def test_a_key_that_says_nothing_of_any_arm_is_refused(
        arm: str, rest: str, message: str, tmp_path: Path) -> None:
    """Fixed or swept, but not where one of the arms that are compared has it."""
    file = tmp_path / "study.toml"
    file.write_text(spec_text(f'arm = "{arm}"') + f"{rest}\n")
    with pytest.raises(SpecError) as error:
        read_spec(file)
    assert message in str(error.value)
    arms = "\n[sweep.zip]\narm = [\"puma560\", \"none\", \"panda\"]\n"
    file.write_text(spec_text("") + f"{rest}\n{arms}")
    read_spec(file)
