"""What a guarded line brings: its time, where the hand truly is, and what the pads tell."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strategies.poses.postures import extended_finger, poking_pose
from warpgrasp.mechanism.puma560 import puma_inverse_batch
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
from warpgrasp.touch.line_touch import LineTouch
from warpgrasp.touch.pad import read_pads

ARM = ArmTable(encoder_step_rad=0.0, repeatability_m=0.0)
FLOATING = replace(ARM, kind="none", guarded_step_s=0.0)
QUIET = PadTable(noise_counts=0.0, gain_spread=0.0, repeatability=0.0, dead_fraction=0.0)
INWARD = np.array([1.0, 0.0, 0.0])
FACE_M = 0.42
"""Where the block's near face stands."""


def robot_at_block(worlds: int, *, arm: ArmTable = ARM, hand: HandTable | None = None,
                   pads: PadTable = QUIET, errors: ErrorTable | None = None
                   ) -> tuple[Robot, Truth]:
    truth = Truth(np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (worlds, 1)))
    return Robot([body_from_name("block")], np.zeros(1, int), truth,
                 np.arange(worlds, dtype=np.uint64), arm, hand or HandTable(),
                 SensorTable(joint_noise_rad=0.0), pads=pads, errors=errors or ErrorTable.none(),
                 contact=ContactTable.none()), truth


def poke(robot: Robot, gap_m: float, steps: int, interval_m: float = 1e-3) -> LineTouch:
    """One finger towards the block's near face, from `gap_m` before it."""
    one = extended_finger(robot.hand, robot.pads)
    pose = poking_pose(one, np.array([FACE_M - gap_m, 0.0, 0.06]), INWARD,
                       np.array([0.0, 0.0, -1.0]))
    return along(robot, np.tile(pose, (robot.worlds, 1)), steps, interval_m)


def along(robot: Robot, pose: np.ndarray, steps: int, interval_m: float = 1e-3) -> LineTouch:
    n = robot.worlds
    return robot.guarded_line(
        np.arange(n), pose, np.tile(INWARD, (n, 1)), interval_m=interval_m, steps=steps, finger=0,
        commands_rad=extended_finger(robot.hand, robot.pads).commands_rad)


@pytest.mark.parametrize(("gap_m", "status"), [
    (0.01, ProbeStatus.CONTACT), (0.05, ProbeStatus.NO_CONTACT)])
def test_a_line_takes_as_long_as_the_wrist_needs_for_its_way(
    gap_m: float, status: ProbeStatus
) -> None:
    """As far as the line went; its steps themselves take no time."""
    robot, _ = robot_at_block(1, arm=FLOATING)
    poke(robot, gap_m, 0)  # the wrist then stands at the start
    touch = poke(robot, gap_m, 30)
    assert touch.status[0] == status
    assert touch.time_s == pytest.approx(1e-3 * touch.steps / FLOATING.wrist_speed_m_s, rel=1e-9)


@pytest.mark.parametrize(("steps", "status", "share"), [
    (30, ProbeStatus.NO_CONTACT, 1e-6), (60, ProbeStatus.CONTACT, 0.2)])
def test_a_hand_is_truly_in_the_same_place_whatever_line_took_it_there(
    steps: int, status: ProbeStatus, share: float
) -> None:
    """At the end of a line it slips as at a line's start; between, nearly as much."""
    robot, truth = robot_at_block(20, errors=ErrorTable())
    start = poke(robot, 0.04, 0)
    touch = poke(robot, 0.04, steps)
    assert (touch.status == status).all()
    along(robot, touch.hand_pose, 0)
    first, went, there = (line.hand_pose for line in truth.lines)
    slipped = there - first - (touch.hand_pose - start.hand_pose)
    assert np.median(np.abs(slipped[:, :3]).max(1)) > 3e-5
    assert np.abs(went - there).max() < share * np.abs(slipped).max()


def test_the_hand_is_believed_where_the_encoders_read_it_and_truly_between() -> None:
    """By the closed-form inverse: joints read are the nearest steps of those of the line's end."""
    step, mount = np.pi / 300, HandTable().mount_length_m  # a whole turn is a number of steps
    robot, truth = robot_at_block(1, arm=replace(ARM, encoder_step_rad=step))
    touch = poke(robot, 0.04, 20)

    def joints(pose: np.ndarray) -> np.ndarray:
        back = Rotation.from_quat(pose[:, 3:]).apply([0.0, 0.0, mount])
        return puma_inverse_batch(ARM, np.concatenate([pose[:, :3] - back, pose[:, 3:]], 1))[0]

    one = extended_finger(robot.hand, robot.pads)
    end = poking_pose(one, np.array([FACE_M - 0.02, 0.0, 0.06]), INWARD, np.array([0.0, 0.0, -1.0]))
    np.testing.assert_allclose(truth.lines[0].hand_pose[0, :3], end[:3], atol=1e-9)
    read, true = joints(touch.hand_pose), joints(truth.lines[0].hand_pose)
    branch = np.abs(read / step - np.round(read / step)).max(-1).argmin()
    np.testing.assert_allclose(read[branch], step * np.round(true[branch] / step), atol=1e-8)
    assert np.abs(read[branch] - true[branch]).max() > 0.1 * step


def test_a_touch_whose_nearest_taxel_is_dead_is_told_as_deep_as_another_says() -> None:
    robot, _ = robot_at_block(100, pads=replace(
        QUIET, dead_fraction=0.2, threshold_counts=30.0, yield_rad=0.5))
    touch = poke(robot, 0.01, 30)
    assert (touch.status == ProbeStatus.CONTACT).all()
    np.testing.assert_allclose(touch.point_m[:, 0], FACE_M, atol=1e-4)


def test_a_pad_feels_where_its_image_says_so() -> None:
    """A few live taxels, gains of whole pads, and noise that may raise a taxel or hide its load."""
    pads = replace(QUIET, noise_counts=4.0, threshold_counts=10.0, dead_fraction=0.97)
    robot, _ = robot_at_block(2000, pads=pads, errors=replace(
        ErrorTable.none(), pad_gain_share=0.3))
    touch = poke(robot, 0.0, 100, 1e-4)
    felt = touch.status == ProbeStatus.CONTACT
    blocked = touch.status == ProbeStatus.BLOCKED
    assert felt.sum() > 300
    assert blocked.sum() > 300
    assert touch.taxel_peak[felt].min() >= pads.threshold_counts
    assert touch.taxel_peak[blocked].max() < pads.threshold_counts


def test_of_several_pads_the_one_that_bears_most_is_told() -> None:
    """A stiff finger laid on a face, more or less with its tip: middle and distal pads press."""
    n, hand = 11, HandTable(joint_stiffness_Nm_rad=1e3)
    pads = replace(QUIET, middle=True, stiffness_N_m=200.0)
    robot, truth = robot_at_block(n, arm=FLOATING, hand=hand, pads=pads)
    commands = np.full((4, 1, 4), np.pi / 2)
    commands[:, 0, 0], commands[1] = 0.0, 0.0
    turn = (Rotation.from_rotvec(np.radians(np.linspace(-0.9, 0.5, n))[:, None] * [0.0, 1.0, 0.0])
            * Rotation.from_quat([1.0, 0.0, 0.0, 0.0]))
    middle = np.array([hand.link_radius_m + pads.thickness_m - hand.palm_gap_m / 2, 0.0,
                       hand.abduction_offset_m + sum(hand.link_length_m[:2])])
    pose = np.concatenate([[FACE_M - 0.0104, 0.0, 0.06] - turn.apply(middle), turn.as_quat()], 1)
    touch = robot.guarded_line(np.arange(n), pose, np.tile(INWARD, (n, 1)), interval_m=1e-3,
                               steps=20, finger=1, commands_rad=commands)
    line = truth.lines[0]
    q = np.repeat(commands[None, :, 0], n, axis=0)
    q[:, 1] = line.q_rad
    every = read_pads(robot._scene, np.zeros(1, int), truth.body_pose, hand, pads,
                      np.arange(n, dtype=np.uint64), line.hand_pose, q)
    count, load = every.counts[:, 1], every.force_N[:, 1].sum((2, 3))
    assert (load[:, 1:] > 0.5).all()
    assert set(load.argmax(1)) == {1, 2}
    np.testing.assert_allclose(line.force_N, load.max(1), rtol=1e-9)
    assert ((line.point_m[:, 2] > 0.06) == (load.argmax(1) == 1)).all()
    np.testing.assert_array_equal(touch.link, count.max((2, 3)).argmax(1))
    np.testing.assert_array_equal(touch.image, count[np.arange(n), touch.link])
