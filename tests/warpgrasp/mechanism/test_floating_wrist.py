"""A floating wrist: every pose within its box is taken exactly, in the time of its way and turn."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strategies.poses.waypoints import Ring
from strategies.strategy import Strategy
from sweeps.episode.episodes import run_block
from sweeps.figures.replay_frames import arm_points, make_replay
from sweeps.spec.cell import Cell
from warpgrasp.geometry.body import Body, Part, scene_of
from warpgrasp.geometry.scene import Shape
from warpgrasp.mechanism.arm import arm_flanges, arm_home, arm_of, floating_joints
from warpgrasp.mechanism.arm_motion import ArmState, arm_hand_links, move_hand
from warpgrasp.mechanism.arm_motion_kernel import RETREAT_M
from warpgrasp.mechanism.arm_reach import (
    hand_reachable,
    nearest_reachable,
    pose_reachable,
    travel_time,
)
from warpgrasp.mechanism.calibration import arm_variance
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.parameters import ArmTable, ErrorTable, HandTable
from warpgrasp.probe_status import ProbeStatus

HAND = HandTable()
FLOATING = ArmTable(kind="none", repeatability_m=0.0)
CRUMB = Body("crumb", (Part(Shape.SPHERE, size_m=(0.001, 0, 0)),), (-0.001,) * 3, (0.001,) * 3)


def random_poses(count: int, low: float, high: float) -> np.ndarray:
    rng = np.random.default_rng(3)
    place = rng.uniform([-low, -low, high - 0.4], [low, low, high], (count, 3))
    return np.concatenate([place, Rotation.random(count, rng).as_quat()], axis=1)


def moved(poses: np.ndarray, arm: ArmTable):
    return move_hand(
        scene_of([CRUMB], "cpu"), np.zeros(1, int), np.array([[2.0, 2, 0, 0, 0, 0, 1.0]]), arm,
        HAND, np.array([7], np.uint64), ArmState.home(1, arm), poses[None],
        np.ones((1, len(poses)), bool), np.zeros((1, 4, 1, 4)))


def flanges(poses: np.ndarray, back: float = 0.0) -> np.ndarray:
    found = poses.copy()
    found[:, :3] -= Rotation.from_quat(poses[:, 3:]).apply([0, 0, HAND.mount_length_m + back])
    return found


def way_time(a: np.ndarray, b: np.ndarray) -> float:
    """By SciPy, between two flange poses."""
    way = np.linalg.norm(a[:3] - b[:3]) / FLOATING.wrist_speed_m_s
    turn = (Rotation.from_quat(a[3:]).inv() * Rotation.from_quat(b[3:])).magnitude()
    return max(way, turn / FLOATING.wrist_turn_rad_s)


def test_poses_are_taken_exactly_and_in_their_time() -> None:
    poses = random_poses(40, 0.6, 1.1)
    moves, actual = moved(poses, FLOATING)
    assert (moves.status == ProbeStatus.CONTACT).all()
    for found in (moves.believed_pose[0], actual[0]):
        assert np.abs(found[:, :3] - poses[:, :3]).max() < 1e-12
        apart = Rotation.from_quat(found[:, 3:]).inv() * Rotation.from_quat(poses[:, 3:])
        assert apart.magnitude().max() < 1e-7
    at, retreats = flanges(poses), flanges(poses, RETREAT_M)
    last = arm_flanges(FLOATING, arm_home(FLOATING)[None])[0]
    for k in range(len(poses)):
        wanted = way_time(last, retreats[k]) + 2 * way_time(retreats[k], at[k])
        assert moves.time_s[0, k] == pytest.approx(wanted, abs=1e-9)
        last = retreats[k]
    assert np.allclose(moves.state.q_rad[0, :6], floating_joints(retreats[-1:])[0])


def test_the_box_bounds_the_flange() -> None:
    """In kernels and on the host alike, the pose's retreat included."""
    arm = replace(FLOATING, box_low_m=(-0.3, -0.4, 0.7), box_high_m=(0.35, 0.45, 1.3))
    poses = random_poses(300, 0.7, 1.2)
    inside = np.ones(len(poses), bool)
    for back in (0.0, RETREAT_M):
        place = flanges(poses, back)[:, :3]
        inside &= ((place >= arm.box_low_m) & (place <= arm.box_high_m)).all(1)
    assert 20 < inside.sum() < 280
    assert np.array_equal(pose_reachable(arm, HAND, poses), inside)
    status = moved(poses, arm)[0].status[0, :, 0]
    assert np.array_equal(status == ProbeStatus.UNREACHABLE, ~inside)
    bad = poses[:2].copy()
    bad[0, 0] = np.nan
    assert not hand_reachable(arm, HAND, bad)[0]


def test_the_host_asks_as_the_kernel_moves() -> None:
    poses = random_poses(30, 0.6, 1.1)
    times = travel_time(FLOATING, HAND, poses[:-1], poses[1:])
    wanted = [way_time(a, b) for a, b in zip(flanges(poses)[:-1], flanges(poses)[1:], strict=True)]
    assert times == pytest.approx(wanted, abs=1e-9)
    assert travel_time(FLOATING, HAND, poses[0], poses).shape == (30,)
    far = np.array([3.0, 0, 0.5, 1, 0, 0, 0])
    assert np.isinf(travel_time(FLOATING, HAND, poses[0], far))
    near = nearest_reachable(FLOATING, HAND, far)
    assert near is not None
    assert near[:3] == pytest.approx([1.0, 0.0, 0.5], abs=0.02)


@pytest.mark.parametrize(("low", "high", "asked", "nearest"), [
    ((-1.0, -1.0, 0.0), (3.0, 1.0, 1.5), (4.0, 0.2, 0.5), (3.0, 0.2, 0.5)),
    ((1.5, -0.5, 0.0), (3.0, 0.5, 1.5), (0.45, 0.0, 0.5), (1.5, 0.0, 0.5)),
    ((-1.0, -1.0, -0.5), (1.0, 1.0, 1.5), (0.4, 0.0, -3.0), (0.4, 0.0, -0.5 - HAND.mount_length_m)),
    ((-1.0, -1.0, 0.0), (1.0, 1.0, 0.1), (0.4, 0.0, 3.0), None),  # no room for the retreat
])
def test_the_nearest_place_may_be_anywhere_in_the_box(low, high, asked, nearest) -> None:
    """A lattice within 1.2 m of the base was searched."""
    arm = replace(FLOATING, box_low_m=low, box_high_m=high)
    pose = np.array([*asked, 1.0, 0.0, 0.0, 0.0])
    found = nearest_reachable(arm, HAND, pose)
    if nearest is None:
        assert found is None
        return
    assert found is not None
    assert found == pytest.approx([*nearest, *pose[3:]], abs=1e-8)
    assert pose_reachable(arm, HAND, found)
    step = 1e-4 * (pose[:3] - found[:3]) / np.linalg.norm(pose[:3] - found[:3])
    assert not pose_reachable(arm, HAND, found + np.array([*step, 0.0, 0.0, 0.0, 0.0]))


def test_links_and_drawing_follow_the_wrist() -> None:
    poses = random_poses(5, 0.5, 1.0)
    q = np.concatenate([floating_joints(flanges(poses)), np.full((5, 16), 0.2)], axis=1)
    points, _ = arm_hand_links(FLOATING, HAND, q)
    wanted, _ = hand_links(HAND, poses, q[:, 6:].reshape(-1, 4, 4))
    assert np.abs(points - wanted).max() < 1e-9
    drawn, turn = arm_points(FLOATING, q[0, :6], HAND.mount_length_m)
    assert drawn.shape == (6, 3)
    assert np.allclose(drawn[-1], poses[0, :3])
    assert (Rotation.from_quat(turn).inv() * Rotation.from_quat(poses[0, 3:])).magnitude() < 1e-7


def test_no_joints_of_an_arm_err() -> None:
    errors = ErrorTable()
    assert arm_variance(errors, ArmTable(kind="none")) == ArmTable().repeatability_m**2
    assert arm_variance(errors, ArmTable()) > ArmTable().repeatability_m**2


def test_an_episode_with_a_floating_wrist() -> None:
    """The far side of an object, which the PUMA does not reach, is touched."""
    ring = Strategy("ring6", (Ring(count=6),), ("curl40",))
    cell = Cell(ring, {"name": "large_cylinder"}, "large_cylinder", seed=3, arm=ArmTable(
        kind="none"))
    block = run_block(cell, np.arange(2), "cpu")
    for procedure in block.exploration.procedures:
        assert not (procedure.felt.closing.status == ProbeStatus.UNREACHABLE).any()
    assert (block.scores.iou > 0.6).all()
    frames = make_replay(cell, block).frames
    assert all(np.isfinite(frame.arm_m).all() for frame in frames)


def test_a_box_the_wrong_way_round_is_refused() -> None:
    """Every pose was unreachable."""
    with pytest.raises(ValueError, match=r"box_low_mm should be below box_high_mm; are \(1.0, "):
        arm_of(replace(FLOATING, box_low_m=(1.0, 1.0, 0.0)), 0.1)
