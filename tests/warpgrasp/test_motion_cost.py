"""One clock and one count for every procedure: the same motion costs the same."""

from dataclasses import replace

import numpy as np
import pytest

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from strategies.poses.postures import extended_finger, opposed_pair
from warpgrasp.motion_cost import closing_time_s, guarded_time_s, line_time_s, opening_time_s
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import (
    ArmTable,
    ContactTable,
    ErrorTable,
    HandTable,
    PadTable,
    SensorTable,
)
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Robot, Truth
from warpgrasp.touch.line_touch import Until

ABOVE = np.array([0.45, 0.0, 0.45, 1.0, 0.0, 0.0, 0.0])
"""A hand pose [m], quaternion xyzw, high above the object: the hand points down."""
ONE = np.zeros(1, int)
POKE_RAD = extended_finger(HandTable(), PadTable()).commands_rad
THUMB = opposed_pair(HandTable(), PadTable()).fingers[1]


def robot_of(arm: ArmTable) -> Robot:
    """Its pads and tendons feel nothing unless something is there."""
    return Robot([body_from_name("block")], ONE,
                 Truth(np.array([[0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])),
                 np.array([5], np.uint64), arm, HandTable(),
                 SensorTable(tendon_threshold_N=30.0), pads=PadTable(threshold_counts=60.0),
                 errors=ErrorTable.none(), contact=ContactTable.none())


@pytest.mark.parametrize("arm", [
    ArmTable(), ArmTable(guarded_step_s=0.0), ArmTable(finger_speed_rad_s=0.02),
    ArmTable(guarded_step_s=0.2, finger_speed_rad_s=3.0)])
def test_closing_a_finger_costs_the_same_in_a_grasp_and_along_a_contour(arm: ArmTable) -> None:
    """Half a degree a step: 50 ms, by tendons or by a pad; and the finger opens again."""
    commands = opposed_pair(HandTable(), PadTable()).commands_rad[1]
    steps = commands.shape[1] - 1
    robot = robot_of(arm)
    grasps = robot.grasp(ABOVE[None, None], np.ones((1, 1), bool), commands[None],
                         np.array([steps + 1]))
    assert (grasps.closing.status == ProbeStatus.NO_CONTACT).all()
    of_grasp = (grasps.time_s - grasps.moves.time_s).item()

    def line() -> float:
        touch = robot.guarded_line(ONE, ABOVE[None], np.zeros((1, 3)), interval_m=0.001,
                                   steps=steps, finger=THUMB, commands_rad=commands)
        assert touch.status[0] == ProbeStatus.NO_CONTACT
        assert touch.steps[0] == steps
        return float(touch.time_s[0])

    line()  # takes the arm there
    along_contour = line()
    assert along_contour == pytest.approx(of_grasp, abs=1e-3)  # the encoder's step of the arm
    step = max(arm.guarded_step_s, np.radians(0.5) / arm.finger_speed_rad_s)
    assert of_grasp == pytest.approx(
        steps * (step + np.radians(0.5) / arm.finger_speed_rad_s), rel=1e-9)


def test_fingers_close_in_step_and_the_last_one_governs() -> None:
    arm = ArmTable()
    path = closing_commands(CLOSING_PATHS["curl40"])
    commands = np.stack([path, path])
    status = np.full((1, 1, 2, 4), ProbeStatus.CONTACT)
    step = np.array([[[[10, 90, 30, 20], [5, 5, 5, 5]]]])
    spent = 95 * 0.05 + 95 * np.radians(0.5) / arm.finger_speed_rad_s
    assert closing_time_s(arm, status, step, commands).item() == pytest.approx(spent)
    status[0, 0, 0, 1] = ProbeStatus.UNREACHABLE  # not made: the next one governs
    spent = 35 * (0.05 + np.radians(0.5) / arm.finger_speed_rad_s)
    assert closing_time_s(arm, status, step, commands).item() == pytest.approx(spent)


def test_time_grows_with_every_step_and_a_held_command_turns_nothing() -> None:
    arm = ArmTable()
    path = closing_commands(CLOSING_PATHS["base_then_curl"])[0]
    for of in (guarded_time_s, opening_time_s):
        assert of(arm, path)[0] == 0.0
        assert (np.diff(of(arm, path)) > 0.0).all()
    held = np.arange(4)
    assert line_time_s(arm, path[:1], held, np.zeros(4)) == pytest.approx(0.05 * held)
    slow = line_time_s(arm, path[:1], held, np.full(4, 0.12))
    assert slow == pytest.approx([0.12, 0.12, 0.12, 0.15])


def test_a_guarded_line_is_a_touch_felt_or_not_and_one_until_release_is_none() -> None:
    robot = robot_of(replace(ArmTable(), encoder_step_rad=0.0))

    def line(height: float, until: Until = Until.CONTACT, direction: float = -1.0):
        pose = ABOVE[None].copy()
        pose[:, 2] = height
        return robot.guarded_line(ONE, pose, np.array([[0.0, 0.0, direction]]), interval_m=0.001,
                                  steps=5, finger=0, commands_rad=POKE_RAD, until=until)

    free = line(0.45)
    assert free.status[0] == ProbeStatus.NO_CONTACT
    assert free.is_touch[0]
    assert not line(0.45, Until.RELEASE, 1.0).is_touch[0]
    far = line(3.0)
    assert far.status[0] == ProbeStatus.UNREACHABLE
    assert not far.is_touch[0]
