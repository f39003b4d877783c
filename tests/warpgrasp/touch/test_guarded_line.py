"""Guarded lines: what ends them, what is believed, and that the finger truly rests."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from scipy.stats import kstest, uniform

from strategies.poses.postures import extended_finger, poking_pose
from warpgrasp.geometry.body import Body
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.objects.mesh_import import body_from_mesh
from warpgrasp.parameters import (
    ArmTable,
    ContactTable,
    ErrorTable,
    HandTable,
    PadTable,
    SensorTable,
    TrueTables,
)
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Robot, Truth
from warpgrasp.touch import guarded_motion
from warpgrasp.touch.line_touch import Until
from warpgrasp.touch.pad import read_pads

EXACT_ARM = ArmTable(encoder_step_rad=0.0, repeatability_m=0.0)
EXACT = SensorTable(joint_noise_rad=0.0)
HAND = HandTable()
QUIET = PadTable(noise_counts=0.0, gain_spread=0.0, repeatability=0.0, dead_fraction=0.0)
INWARD = np.array([1.0, 0.0, 0.0])
POKE_RAD = extended_finger(HandTable(), PadTable()).commands_rad


def robot_before_block(worlds: int, *, arm=None, sensors=None, pads=None, errors=None,
                       body: Body | None = None) -> tuple[Robot, Truth]:
    """A robot whose arm is exact has no errors at all, unless they are given, and no weight."""
    contact = None
    if arm is EXACT_ARM:
        errors, contact = errors or ErrorTable.none(), ContactTable.none()
    truth = Truth(np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (worlds, 1)))
    robot = Robot([body or body_from_name("block")], np.zeros(1, int), truth,
                  np.arange(worlds).astype(np.uint64) + np.uint64(99), arm or ArmTable(),
                  HandTable(), sensors or SensorTable(), pads=pads, errors=errors, contact=contact)
    return robot, truth


def poke(robot: Robot, height: float = 0.06, gap: float = 0.010, side: float = 0.0, **changes):
    rows = np.arange(robot.worlds)
    touch = np.array([0.42 - gap, side, height])
    pose = poking_pose(extended_finger(robot.hand, robot.pads), touch, INWARD,
                       np.array([0.0, 0.0, -1.0]))
    arguments = {"interval_m": 0.001, "steps": 30, "finger": 0, "commands_rad": POKE_RAD} | changes
    return robot.guarded_line(rows, np.tile(pose, (len(rows), 1)),
                              np.tile(INWARD, (len(rows), 1)), **arguments)


def test_poking_pose_points_the_pad_along_the_normal() -> None:
    hand, pads = HandTable(), PadTable()
    pose = poking_pose(extended_finger(hand, pads), np.array([0.4, 0.1, 0.2]), INWARD,
                       np.array([0.0, 0.0, -1.0]))
    tip = Rotation.from_quat(pose[3:]).apply(extended_finger(hand, pads).tip_m) + pose[:3]
    np.testing.assert_allclose(tip + 0.009 * INWARD, [0.4, 0.1, 0.2], atol=1e-12)


def test_contact_is_found_where_the_face_is() -> None:
    robot, truth = robot_before_block(1, arm=EXACT_ARM, sensors=EXACT, pads=QUIET)
    touch = poke(robot)
    assert touch.status[0] == ProbeStatus.CONTACT
    assert touch.link[0] == 2
    assert touch.steps[0] in (11, 12)
    assert touch.point_m[0, 0] == pytest.approx(0.42, abs=2e-4)
    np.testing.assert_allclose(truth.lines[0].point_m[0, 0], 0.42, atol=1e-9)
    np.testing.assert_allclose(truth.lines[0].normal[0], [-1, 0, 0], atol=1e-12)
    # Along the face: half a taxel of 1.6 mm on the pad's bend.
    np.testing.assert_allclose(touch.point_m[0], truth.lines[0].point_m[0], atol=9e-4)
    assert truth.lines[0].force_N[0] > 0.05


@pytest.mark.parametrize("table", [False, True])
def test_a_touch_is_told_to_be_of_table_or_object(table: bool) -> None:
    """From above, beside the block or on its top."""
    robot, truth = robot_before_block(1, arm=EXACT_ARM, sensors=EXACT, pads=QUIET)
    down, height = np.array([0.0, 0.0, -1.0]), 0.0 if table else 0.12
    pose = poking_pose(extended_finger(robot.hand, robot.pads),
                       np.array([0.45, 0.25 if table else 0.0, height + 0.01]), down, -INWARD)
    touch = robot.guarded_line(np.zeros(1, int), pose[None], down[None], interval_m=0.001, steps=30,
                               finger=0, commands_rad=POKE_RAD)
    line = truth.lines[0]
    assert touch.status[0] == ProbeStatus.CONTACT
    assert line.on_table[0] == table
    assert line.point_m[0, 2] == pytest.approx(height, abs=1e-9)
    np.testing.assert_allclose(line.normal[0], -down, atol=1e-12)


def test_the_true_normal_of_a_mesh_is_of_unit_length(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WARPGRASP_CACHE", str(tmp_path))
    trimesh.creation.box((0.060, 0.080, 0.120)).export(tmp_path / "block.stl")
    robot, truth = robot_before_block(
        1, arm=EXACT_ARM, sensors=EXACT, pads=QUIET,
        body=body_from_mesh(tmp_path / "block.stl", units="m"))
    poke(robot)
    assert abs(np.linalg.norm(truth.lines[0].normal[0]) - 1.0) < 1e-12


def test_default_noise_leaves_the_touch_within_a_millimetre_or_two() -> None:
    robot, truth = robot_before_block(100)
    touch = poke(robot)
    assert (touch.status == ProbeStatus.CONTACT).all()
    error = touch.point_m - truth.lines[0].point_m
    # Mount, finger base, pad and arm some 0.5 mm each, joints 0.5 deg on levers up to 0.1 m.
    assert np.sqrt((error[:, 0] ** 2).mean()) < 1.7e-3
    assert np.median(np.linalg.norm(error, axis=1)) < 2.7e-3
    lean = np.degrees(np.arccos(-touch.normal[:, 0]))
    assert np.median(lean) < 5.0


@pytest.mark.parametrize("name", ["block", "wine_bottle"])
def test_the_load_is_that_of_all_taxels(name: str) -> None:
    """No taxel that presses is overlooked: `read_pads` asks every one."""
    n = 60
    body, pose = body_from_name(name), np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (n, 1))
    truth, pads = Truth(pose), PadTable(middle=True)
    key = np.arange(n).astype(np.uint64) + np.uint64(7)
    robot = Robot([body], np.zeros(1, int), truth, key, ArmTable(), HandTable(), SensorTable(),
                  pads=pads, errors=ErrorTable.none())
    angle = np.linspace(-1.0, 1.0, n)
    inward = np.stack([np.cos(angle), np.sin(angle), 0 * angle], 1)
    start = poking_pose(extended_finger(robot.hand, pads),
                        np.array([0.45, 0.0, 0.05]) - 0.06 * inward, inward,
                        np.array([0.0, 0.0, -1.0]))
    robot.guarded_line(np.arange(n), start, inward, interval_m=0.001, steps=60, finger=0,
                       commands_rad=POKE_RAD)
    line = truth.lines[0]
    q = np.repeat(POKE_RAD[None, :, 0], n, axis=0)
    q[:, 0] = line.q_rad
    every = read_pads(robot._scene, np.zeros(1, int), pose, robot.hand, pads, key, line.hand_pose,
                      q).force_N[:, 0].sum((2, 3)).max(1)
    assert (every > 0.05).mean() > 0.8
    np.testing.assert_allclose(line.force_N, every, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("radius", [0.006, 0.010])
def test_what_the_finger_truly_does_is_not_what_is_believed(radius: float) -> None:
    """The same hand moves and feels the same, whatever radius its robot takes its links to have."""
    n = 6
    truth = Truth(np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (n, 1)))
    start = np.tile([0.37, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (n, 1))
    start[:, 2] = np.linspace(0.165, 0.177, n)
    commands = np.radians(np.full((4, 1, 4), 90.0))
    commands[:, 0, 0], commands[1, 0, 1:] = 0.0, np.radians(20.0)
    touches = []
    for believed in (HandTable(), HandTable(link_radius_m=radius)):
        robot = Robot([body_from_name("lightbulb")], np.zeros(1, int), truth,
                      np.arange(n, dtype=np.uint64), ArmTable(), believed, EXACT, pads=QUIET,
                      true=TrueTables(HandTable(), EXACT, ErrorTable()))
        touches.append(robot.guarded_line(np.arange(n), start, np.tile(INWARD, (n, 1)),
                                          interval_m=5e-4, steps=120, finger=1,
                                          commands_rad=commands))
    assert (touches[0].status == ProbeStatus.CONTACT).all()
    for name in ("status", "steps", "taxel_peak", "image", "q_rad"):
        np.testing.assert_array_equal(getattr(touches[0], name), getattr(touches[1], name))
    for name in ("q_rad", "point_m", "normal", "force_N", "hand_pose"):
        np.testing.assert_array_equal(getattr(truth.lines[0], name), getattr(truth.lines[1], name))


def test_servo_torques_balance_the_pad() -> None:
    """The energy of servos and of all taxels, each a spring, has no slope where the finger rests:
    an independent check."""
    robot, truth = robot_before_block(1, arm=EXACT_ARM, sensors=EXACT, pads=QUIET)
    touch = poke(robot)
    assert truth.lines[0].force_N[0] > 0.05

    def pressed(q: np.ndarray) -> float:
        """Energy of the taxels [J], none of which is pressed flat."""
        read = read_pads(robot._scene, np.zeros(1, int), truth.body_pose, robot.hand, QUIET,
                         np.zeros(1, np.uint64), touch.hand_pose, np.tile(q, (1, 4, 1)))
        return float((read.force_N[0, 0] ** 2).sum() / (2 * QUIET.stiffness_N_m))

    q = touch.q_rad[0]
    torque = HandTable().joint_stiffness_Nm_rad * (POKE_RAD[0, 0] - q)
    slope = [(pressed(q + turn) - pressed(q - turn)) / 2e-6 for turn in 1e-6 * np.eye(4)]
    np.testing.assert_allclose(slope, torque, atol=2e-6)
    assert np.abs(torque).max() > 1e-3


def test_a_spent_line_and_a_release() -> None:
    robot, _ = robot_before_block(3)
    spent = poke(robot, gap=0.05)
    assert (spent.status == ProbeStatus.NO_CONTACT).all()
    assert (spent.steps == 30).all()
    touched = poke(robot)
    away = robot.guarded_line(np.arange(3), touched.hand_pose, np.tile(-INWARD, (3, 1)),
                              interval_m=0.0005, steps=20, finger=0, commands_rad=POKE_RAD,
                              until=Until.RELEASE)
    assert (away.status == ProbeStatus.NO_CONTACT).all()
    assert (away.steps <= 6).all()


def test_dead_pads_make_the_finger_block() -> None:
    robot, _ = robot_before_block(3, pads=replace(PadTable(), dead_fraction=1.0))
    touch = poke(robot)
    assert (touch.status == ProbeStatus.BLOCKED).all()
    assert np.isnan(touch.point_m).all()
    assert (touch.steps < 25).all()


def test_a_start_inside_is_a_collision_and_far_away_is_unreachable() -> None:
    robot, _ = robot_before_block(2)
    assert (poke(robot, gap=-0.02).status == ProbeStatus.COLLISION).all()
    rows = np.arange(2)
    far = np.tile([3.0, 0.0, 0.5, 0.0, 1.0, 0.0, 0.0], (2, 1))
    touch = robot.guarded_line(rows, far, np.tile(INWARD, (2, 1)), interval_m=0.001, steps=5,
                               finger=0, commands_rad=POKE_RAD)
    assert (touch.status == ProbeStatus.UNREACHABLE).all()


def test_worlds_do_not_see_each_other() -> None:
    many, _ = robot_before_block(5)
    all_rows = poke(many)
    one, _ = robot_before_block(5)
    pose = poking_pose(extended_finger(one.hand, one.pads), np.array([0.41, 0.0, 0.06]), INWARD,
                       np.array([0.0, 0.0, -1.0]))
    alone = one.guarded_line(np.array([3]), pose[None], INWARD[None], interval_m=0.001, steps=30,
                             finger=0, commands_rad=POKE_RAD)
    np.testing.assert_array_equal(alone.point_m[0], all_rows.point_m[3])
    np.testing.assert_array_equal(alone.image[0], all_rows.image[3])


def test_lines_of_several_kinds_are_those_made_one_by_one() -> None:
    """Intervals, their number and what ends a line may differ from row to row."""
    kinds = [{"interval_m": 0.001, "steps": 30}, {"interval_m": 0.004, "steps": 2},
             {"interval_m": 0.0005, "steps": 20, "until": Until.RELEASE}]
    robot, _ = robot_before_block(3)
    mixed = poke(robot, interval_m=np.array([k["interval_m"] for k in kinds]),
                 steps=np.array([k["steps"] for k in kinds]),
                 until=np.array([k.get("until", Until.CONTACT) for k in kinds]))
    assert (mixed.status == [ProbeStatus.CONTACT, ProbeStatus.NO_CONTACT,
                             ProbeStatus.NO_CONTACT]).all()
    assert list(mixed.is_touch) == [True, True, False]
    for row, kind in enumerate(kinds):
        robot, _ = robot_before_block(3)
        for name, values in vars(poke(robot, **kind)).items():
            np.testing.assert_array_equal(getattr(mixed, name)[row], values[row], name)


SWING_RAD = POKE_RAD + np.radians(np.linspace(-60.0, 0.0, 31))[:, None] * [0.0, 1.0, 0.0, 0.0]


@pytest.mark.parametrize("way", [
    {"gap": 0.02}, {"gap": -0.004, "interval_m": 1e-5, "commands_rad": SWING_RAD}],
    ids=["arm", "finger"])
def test_skipping_free_intervals_changes_nothing(
    way: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a march of almost nothing every interval is looked at: the same touches, whether the arm
    takes the finger there or the finger swings."""
    quick, _ = robot_before_block(4)
    slow, _ = robot_before_block(4)
    a = poke(quick, **way)
    monkeypatch.setattr(guarded_motion, "guarded_line",
                        partial(guarded_motion.guarded_line, march_scale=1e-6))
    b = poke(slow, **way)
    assert (a.status == ProbeStatus.CONTACT).all()
    np.testing.assert_array_equal(a.steps, b.steps)
    np.testing.assert_array_equal(a.point_m, b.point_m)


def in_free_air(pads: PadTable, direction: np.ndarray, *, start_m: float = 0.5, steps: int = 40,
                interval_m: float = 0.001):
    """Lines of fingers hanging down, 0.45 m before the arm."""
    robot, truth = robot_before_block(len(direction), arm=EXACT_ARM, sensors=EXACT, pads=pads)
    pose = np.tile([0.45, 0.0, start_m, 1.0, 0.0, 0.0, 0.0], (len(direction), 1))
    touch = robot.guarded_line(np.arange(robot.worlds), pose, direction, interval_m=interval_m,
                               steps=steps, finger=1, commands_rad=np.zeros((4, 1, 4)))
    return touch, truth.lines[0]


@pytest.mark.parametrize("links", [(), (1,), (2,), (0, 1, 2)])
def test_noise_touches_where_there_are_pads_as_often_as_its_chance_says(links) -> None:
    pads = PadTable(noise_counts=1.3, proximal=0 in links, middle=1 in links, distal=2 in links)
    n, steps = 1000, 40
    touch, truth = in_free_air(pads, np.tile([0.0, 0.0, -1.0], (n, 1)), steps=steps)
    felt = touch.status == ProbeStatus.CONTACT
    chance = 1.0 - (1.0 - pads.false_touch_probability()) ** (steps * len(links))
    assert felt.mean() == pytest.approx(chance, abs=4 * np.sqrt(chance * (1 - chance) / n))
    assert set(touch.link[felt]) == set(links)
    if not links:
        return
    # Anywhere along the line, and the hand stands where it was felt.
    assert kstest(touch.steps[felt] + 0.5, uniform(0, steps).cdf).pvalue > 1e-3
    went = np.multiply.outer(touch.steps * 0.001, [0.0, 0.0, -1.0])
    for pose in (touch.hand_pose, truth.hand_pose):
        np.testing.assert_allclose(pose[:, :3], [0.45, 0.0, 0.5] + went, atol=1e-6)


def test_other_fingers_that_strike_the_table_end_a_line() -> None:
    """The finger that feels is bent away; the others, straight, are as long as their links."""
    robot, _ = robot_before_block(1, arm=EXACT_ARM, sensors=EXACT, pads=QUIET)
    commands = np.zeros((4, 1, 4))
    commands[1, 0, 1] = np.pi / 2
    long = HAND.abduction_offset_m + sum(HAND.link_length_m) + HAND.link_radius_m
    pose = np.array([[0.45, 0.2, long + 0.0205, 1.0, 0.0, 0.0, 0.0]])
    touch = robot.guarded_line(np.zeros(1, int), pose, np.array([[0.0, 0.0, -1.0]]),
                               interval_m=0.001, steps=40, finger=1, commands_rad=commands)
    assert touch.status[0] == ProbeStatus.BLOCKED
    assert touch.steps[0] == 21


@pytest.mark.parametrize(("height", "status"), [
    (0.030, ProbeStatus.NO_CONTACT), (-0.030, ProbeStatus.COLLISION)])
def test_a_checked_way_to_the_start_is_barred_by_what_stands_in_it(
    height: float, status: ProbeStatus
) -> None:
    """From one side of the block to the other, straight fingers above its top or below it."""
    robot, truth = robot_before_block(1, arm=EXACT_ARM, sensors=EXACT, pads=QUIET)
    long = HAND.abduction_offset_m + sum(HAND.link_length_m) + HAND.link_radius_m

    def line(y: float, checked: bool):
        pose = np.array([[0.45 + HAND.palm_gap_m / 2, y, 0.120 + long + height, 1.0, 0, 0, 0]])
        return robot.guarded_line(np.zeros(1, int), pose, np.array([[0.0, 0.0, 1.0]]),
                                  interval_m=0.001, steps=0, finger=1,
                                  commands_rad=np.zeros((4, 1, 4)), checked=checked)

    assert line(-0.15, checked=False).status[0] == ProbeStatus.NO_CONTACT
    before = truth.lines[-1].hand_pose[0]
    touch = line(0.15, checked=True)
    assert touch.status[0] == status
    if status == ProbeStatus.COLLISION:  # the hand stays where it was
        np.testing.assert_allclose(touch.hand_pose[0, :3], before[:3], atol=1e-6)
    assert line(0.15, checked=False).status[0] == ProbeStatus.NO_CONTACT


def test_the_arm_errs_by_its_repeatability_along_each_axis_for_itself() -> None:
    n, sigma = 2000, 1e-3
    robot, truth = robot_before_block(n, arm=replace(EXACT_ARM, repeatability_m=sigma),
                                      sensors=EXACT, errors=ErrorTable.none())
    pose = np.tile([0.45, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0], (n, 1))
    touch = robot.guarded_line(np.arange(n), pose, np.tile(INWARD, (n, 1)), interval_m=0.001,
                               steps=0, finger=1, commands_rad=np.zeros((4, 1, 4)))
    off = (truth.lines[0].hand_pose - touch.hand_pose)[:, :3] / sigma
    np.testing.assert_allclose(off.T @ off / n, np.eye(3), atol=5 / np.sqrt(n))


def test_what_goes_fast_beside_it_changes_no_line() -> None:
    pads = PadTable(noise_counts=1.3)
    slow = np.tile([0.0, 0.0, -0.1], (100, 1))
    way = {"start_m": 0.25, "steps": 100, "interval_m": 0.005}
    alone, _ = in_free_air(pads, slow, **way)
    beside, _ = in_free_air(pads, np.concatenate([slow, [[0.0, 0.0, -1.0]]]), **way)
    np.testing.assert_array_equal(alone.steps, beside.steps[:100])
    np.testing.assert_array_equal(alone.point_m, beside.point_m[:100])
    assert (alone.status == ProbeStatus.CONTACT).any()


def test_bodies_and_fingers_that_there_are_not_are_refused() -> None:
    robot, _ = robot_before_block(1)
    with pytest.raises(ValueError, match="finger 4: wants 0 to 3"):
        poke(robot, finger=4)
    truth = Truth(np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (1, 1)))
    with pytest.raises(ValueError, match="body 3: wants 0 to 0"):
        Robot([body_from_name("block")], np.array([3]), truth, np.zeros(1, np.uint64), ArmTable(),
              HandTable(), SensorTable())


def test_a_gain_that_errors_could_turn_round_is_refused_where_a_pad_is_to_feel() -> None:
    robot, _ = robot_before_block(2, errors=ErrorTable(scale=4.0))
    with pytest.raises(ValueError, match="pad_gain_pct times scale is 40 %"):
        poke(robot)


def test_the_path_goes_by_way_of_the_start() -> None:
    robot, _ = robot_before_block(1, arm=EXACT_ARM, sensors=EXACT, pads=QUIET)
    stood = poke(robot).hand_pose[0, :3]
    touch = poke(robot, height=0.08, gap=0.020)
    start = poking_pose(extended_finger(robot.hand, robot.pads), np.array([0.40, 0.0, 0.08]),
                        INWARD, np.array([0.0, 0.0, -1.0]))[:3]
    stations = np.stack([stood, start, touch.hand_pose[0, :3]])
    assert touch.path_m[0] == pytest.approx(
        np.linalg.norm(np.diff(stations, axis=0), axis=1).sum(), abs=1e-9)
    assert touch.path_m[0] > 0.001 * touch.steps[0] + 0.02
