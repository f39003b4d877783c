"""The planar explorer: what it must recover from the block, and that it always ends, saying why."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fit.fit_status import FitStatus
from strategies.planners.next_procedure import sides_crossed
from strategies.procedures.planar_explorer import explore_plane
from strategies.procedures.planar_faces import Face, angle_between, planes_of
from strategies.procedures.planar_record import PlanarExploration, PlanarOptions
from strategies.procedures.touches import REASON_TEXT, EndReason, true_touches
from warpgrasp.core.random import counter_key
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.parameters import ArmTable, ErrorTable, HandTable, PadTable, SensorTable
from warpgrasp.robot import Robot, Truth

WORLDS = 40
FACES = {"near": ((-0.03, 0.0, 0.06), (-1.0, 0.0, 0.0), (0.08, 0.12)),
         "left": ((0.0, 0.04, 0.06), (0.0, 1.0, 0.0), (0.06, 0.12)),
         "right": ((0.0, -0.04, 0.06), (0.0, -1.0, 0.0), (0.06, 0.12))}

CALIBRATED = replace(ErrorTable.none(), mount_m=5e-4, mount_rad=float(np.radians(0.2)))

def set_up(worlds: int, name: str = "block", pads: PadTable | None = None, seed: int = 3,
           errors: ErrorTable = CALIBRATED):
    """Robots calibrated but for their mounts, unless `errors` are given."""
    rng = np.random.default_rng(seed)
    pose = np.zeros((worlds, 7))
    pose[:, 0] = 0.45
    yaw = rng.uniform(-0.3, 0.3, worlds)
    pose[:, 5], pose[:, 6] = np.sin(yaw / 2), np.cos(yaw / 2)
    truth = Truth(pose)
    key = np.arange(worlds).astype(np.uint64) + np.uint64(1000 * seed)
    return Robot([body_from_name(name)], np.zeros(1, int), truth, key, ArmTable(), HandTable(),
                 SensorTable(), pads=pads, errors=errors), truth


def told_face(truth: Truth, face: str, seed: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """A point near the face's middle and a normal some degrees off, as a fitted body would say."""
    rng = np.random.default_rng(seed)
    point, normal, _ = FACES[face]
    turn = Rotation.from_quat(truth.body_pose[:, 3:])
    off = rng.normal(0, np.radians(4), (len(truth.body_pose), 3))
    return (truth.body_pose[:, :3] + turn.apply(point) + rng.normal(0, 0.004, off.shape),
            turn.apply(normal) + off)


def true_normal(truth: Truth, face: str) -> np.ndarray:
    return Rotation.from_quat(truth.body_pose[:, 3:]).apply(FACES[face][1])


@pytest.fixture(scope="module")
def explored() -> tuple[Truth, dict[str, PlanarExploration], dict[str, Face]]:
    robot, truth = set_up(WORLDS)
    found = {name: explore_plane(robot, *told_face(truth, name)) for name in FACES}
    return truth, found, {name: planes_of(e) for name, e in found.items()}


def test_every_episode_ends_with_a_named_reason(explored) -> None:
    _, found, _ = explored
    for exploration in found.values():
        assert not (exploration.reason == EndReason.GOING_ON).any()
        done = exploration.reason == EndReason.COMPLETE
        assert done.mean() > 0.9
        assert (exploration.direction_reason[done] != EndReason.GOING_ON).all()


def test_plane_normals(explored) -> None:
    truth, _, planes = explored
    for name, face in planes.items():
        off = np.degrees(np.arccos(np.clip((face.normal * true_normal(truth, name)).sum(1), -1, 1)))
        assert np.median(off) <= 1.0
        assert face.flat.mean() > 0.9


def test_angles_of_neighbours_and_the_width_between_opposite_faces(explored) -> None:
    _, _, planes = explored
    angle, sigma = angle_between(planes["near"], planes["left"])
    error = np.degrees(angle) - 90.0
    assert (np.abs(error) <= 3.0).mean() >= 0.9
    # The stated uncertainty is of the right size.
    assert 0.5 < np.sqrt(np.mean((np.radians(error) / sigma) ** 2)) < 2.0
    left, right = planes["left"], planes["right"]
    across = left.normal - right.normal
    width = ((left.fit.centre_m - right.fit.centre_m) * across).sum(1) / np.linalg.norm(
        across, axis=1)
    assert np.abs(np.median(width) - 0.080) < 0.001


def test_traces_cover_the_face(explored) -> None:
    truth, found, _ = explored
    turn = Rotation.from_quat(truth.body_pose[:, 3:])
    for name, exploration in found.items():
        table = exploration.touches
        true_point, _ = true_touches(table, truth)
        local = turn[table.world].inv().apply(true_point - truth.body_pose[table.world, :3])
        across = local[:, 1] if name == "near" else local[:, 0]
        covered = []
        for world in np.flatnonzero(exploration.reason == EndReason.COMPLETE):
            mine = (table.world == world) & np.isfinite(true_point[:, 0])
            covered.append([np.ptp(across[mine]), np.ptp(local[mine, 2])])
        share = np.asarray(covered) / FACES[name][2]
        assert (share.min(1) >= 0.85).mean() >= 0.9


def test_believed_touches_lie_on_the_face(explored) -> None:
    truth, found, _ = explored
    table = found["near"].touches
    point, _ = true_touches(table, truth)
    error = np.linalg.norm(table.point_m - point, axis=1)
    assert np.nanmedian(error) < 0.002
    assert (table.taxel_peak[np.isfinite(table.point_m[:, 0])] >= 6).all()


def test_bad_starts_end_with_a_reason_and_a_message() -> None:
    robot, truth = set_up(6)
    point, normal = told_face(truth, "near")
    middle = truth.body_pose[:, :3] + [0, 0, 0.06]
    point[1], normal[1] = middle[1] + [0.029, 0, 0], normal[1]  # inside, near the other face
    normal[2] = -normal[2]  # pointing into the object
    point[3] = [0.45, 0.3, 0.06]  # beside it
    point[4, 0] = np.nan
    normal[5] = 0.0
    e = explore_plane(robot, point, normal)
    assert e.reason[0] == EndReason.COMPLETE
    assert e.reason[1] in (EndReason.START_BLOCKED, EndReason.BLOCKED, EndReason.COMPLETE)
    assert e.reason[2] in (EndReason.START_BLOCKED, EndReason.UNREACHABLE, EndReason.BLOCKED)
    assert e.reason[3] in (EndReason.NO_CONTACT, EndReason.UNREACHABLE)
    assert e.reason[4] == e.reason[5] == EndReason.BAD_START
    assert all(REASON_TEXT[EndReason(r)] for r in e.reason)
    assert np.isfinite(planes_of(e).normal).all()


@pytest.mark.parametrize("wrong", [1e300, np.inf, np.nan, 1e-12])
def test_a_normal_of_no_length_is_a_bad_start(wrong: float) -> None:
    """The length of a huge one overflowed, which ended the exploration of all worlds."""
    robot, truth = set_up(2)
    point, normal = told_face(truth, "near")
    normal[1] = wrong
    assert explore_plane(robot, point, normal).reason[1] == EndReason.BAD_START
    for flags, kind in ((np.ones(3, bool), ValueError), (np.ones((2, 1), bool), ValueError),
                        (np.ones(2), TypeError)):
        with pytest.raises(kind, match=r"wanted: .* \(world 2,\)"):
            explore_plane(robot, point, normal, wanted=flags)


def test_every_reason_has_a_text_of_its_own() -> None:
    """An enumeration's members have no docstrings: asked for one, they give the class's."""
    assert set(REASON_TEXT) == set(EndReason)
    assert len(set(REASON_TEXT.values())) == len(EndReason)
    assert EndReason.__doc__ not in REASON_TEXT.values()
    for reason, text in REASON_TEXT.items():
        assert text
        assert "\n" not in text
        assert "Why an exploration" not in text, reason
    assert "edge" in REASON_TEXT[EndReason.EDGE]
    assert "table" in REASON_TEXT[EndReason.TABLE]


def test_dead_pads_block_and_say_so() -> None:
    robot, truth = set_up(3, pads=replace(PadTable(), dead_fraction=1.0))
    e = explore_plane(robot, *told_face(truth, "near"))
    assert (e.reason == EndReason.BLOCKED).all()
    assert "pads" in REASON_TEXT[EndReason.BLOCKED]
    assert "another part of the hand" in REASON_TEXT[EndReason.BLOCKED]
    assert not np.isfinite(e.touches.point_m).any()


def test_steps_are_bounded_and_unwanted_worlds_are_left_alone() -> None:
    robot, truth = set_up(4)
    wanted = np.array([True, False, True, False])
    e = explore_plane(robot, *told_face(truth, "near"), wanted=wanted,
                      options=PlanarOptions(most_steps=2))
    assert set(np.unique(e.touches.world)) == {0, 2}
    assert (e.direction_reason[wanted] == EndReason.SPENT).all()
    assert (e.time_s[~wanted] == 0).all()
    assert all(set(line.rows) <= {0, 2} for line in truth.lines)  # the others cost nothing


def test_a_face_does_not_depend_on_the_batch() -> None:
    robot, truth = set_up(12)
    point, normal = told_face(truth, "near")
    point[:4, 1] += [0.02, 0.01, -0.01, -0.02]  # first contacts from which ways back are longer
    together = explore_plane(robot, point, normal)
    alone_robot, _ = set_up(12)
    only = np.arange(12) == 7
    alone = explore_plane(alone_robot, point, normal, wanted=only)
    np.testing.assert_array_equal(together.touches.point_m[together.touches.world == 7],
                                  alone.touches.point_m)
    for name in ("touch_count", "time_s", "path_m"):  # intervals of the way back are its own
        np.testing.assert_array_equal(getattr(together, name)[only], getattr(alone, name)[only])


def test_lines_of_all_worlds_are_made_together() -> None:
    """As many batches of lines as the world with most lines has, whatever each line is for."""
    robot, truth = set_up(8)
    explore_plane(robot, *told_face(truth, "near"))
    lines = np.bincount(np.concatenate([line.rows for line in truth.lines]))
    assert robot.line_count == len(truth.lines) == lines.max()
    assert lines.min() < lines.max()


def test_a_cylinder_is_not_flat() -> None:
    robot, truth = set_up(10, "large_cylinder")
    point = truth.body_pose[:, :3] + [-0.035, 0, 0.06]
    e = explore_plane(robot, point, np.tile([-1.0, 0.0, 0.0], (10, 1)))
    assert not planes_of(e).flat.any()


@pytest.mark.parametrize(("rise_mm", "off_deg"), [(5, 90.0), (10, 14.0)])
def test_a_plane_that_stands_across_what_was_felt_is_no_face(rise_mm: int, off_deg: float) -> None:
    """Touches of a line on the lower part of a step, and of the step: planes through both."""
    step = body_from_table({"name": "step", "compound": [
        {"shape": "block", "size_mm": [80, 80, 30]},
        {"shape": "block", "size_mm": [40, 80, rise_mm], "at_mm": [20, 0, 30]}]}, Path())
    robot = Robot([step], np.zeros(1, int), Truth(np.array([[0.45, 0, 0, 0, 0, 0, 1.0]])),
                  counter_key(7, 0, np.arange(1)),
                  replace(ArmTable(), repeatability_m=0.0, encoder_step_rad=0.0), HandTable(),
                  replace(SensorTable(), joint_noise_rad=0.0), errors=ErrorTable.none(),
                  pads=replace(PadTable(), gain_spread=0.0, repeatability=0.0, noise_counts=0.0))
    start = np.array([[0.43 if rise_mm == 5 else 0.44, 0.0, 0.03]])
    face = planes_of(explore_plane(robot, start, np.array([[0.0, 0.0, 1.0]])))
    assert np.degrees(np.arccos(face.normal[0, 2])) == pytest.approx(off_deg, abs=3.0)
    assert face.fit.status[0] == FitStatus.not_converged
    assert not face.flat[0]
    crossed, _ = sides_crossed(SimpleNamespace(worlds=1, faces=(face,)))  # pyright: ignore
    assert crossed[0] == 0  # what was felt is a top


def test_steps_are_as_long_as_asked() -> None:
    """They were whole intervals: 1.5, 2 and 2.5 mm were the same exploration."""
    no_noise = PadTable(noise_counts=0.0, gain_spread=0.0)
    for step_m, interval_m in ((0.0025, 0.001), (0.0035, 0.001), (0.006, 0.004)):
        robot, truth = set_up(1, pads=no_noise, errors=ErrorTable.none())
        found = explore_plane(robot, *told_face(truth, "near"), options=PlanarOptions(
            step_m=step_m, interval_m=interval_m))
        along = found.touches.hand_pose[found.touches.part == 0, :3] @ found.axes[0, 0]
        assert np.diff(along)[:-1].mean() == pytest.approx(step_m, rel=0.02)


def test_a_finger_past_an_edge_that_touches_it_has_not_found_a_lower_surface() -> None:
    """In 197 of 200 worlds the side of the block was said to be one."""
    robot, truth = set_up(6)
    point = truth.body_pose[:, :3] + [0.0, 0.0, 0.12]
    found = explore_plane(robot, point, np.tile([0.0, 0.0, 1.0], (6, 1)))
    assert (found.reason == EndReason.COMPLETE).all()
    assert not (found.direction_reason == EndReason.FELL_AWAY).any()


def test_a_face_that_goes_on_above_the_reach_of_the_arm_is_explored_downwards_too() -> None:
    """From the highest place reached no way leads over the face; the hand goes back along it."""
    tall = body_from_table({"name": "tall", "compound": [
        {"shape": "block", "size_mm": [30, 30, 300]}]}, Path("."))
    pose = np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (3, 1))
    robot = Robot([tall], np.zeros(1, int), Truth(pose), np.arange(3).astype(np.uint64), ArmTable(),
                  HandTable(), SensorTable(), errors=CALIBRATED)
    point = np.array([[0.435, 0.0, z] for z in (0.10, 0.15, 0.20)])
    found = explore_plane(robot, point, np.tile([-1.0, 0.0, 0.0], (3, 1)))
    assert (found.reason == EndReason.COMPLETE).all()
    assert (found.direction_reason[:, 2] == EndReason.UNREACHABLE).all()
    assert (found.direction_reason[:, 3] == EndReason.TABLE).all()
