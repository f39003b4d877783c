"""The robot that is, beside the robot that is believed."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from warpgrasp.geometry.body import scene_of
from warpgrasp.mechanism.arm_motion import ArmState, move_hand
from warpgrasp.mechanism.calibration import (
    Calibration,
    draw_calibration,
    no_errors,
    place_variance,
    true_hands,
)
from warpgrasp.mechanism.puma560 import puma_forward_batch, puma_inverse_batch
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import (
    FLOATING,
    ArmTable,
    ContactTable,
    ErrorTable,
    HandTable,
    SensorTable,
)
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Robot, Truth

EXACT_ARM = ArmTable(encoder_step_rad=0.0, repeatability_m=0.0)
KEY = np.arange(4000, dtype=np.uint64)


def test_variances_of_places_are_the_sum_of_what_each_error_moves() -> None:
    """By hand: half a metre from three of the arm's joints, 0.15 m from the mount."""
    longest, arm = max(HandTable().link_length_m), replace(ArmTable(), repeatability_m=1e-3)
    assert place_variance(ErrorTable.none(), arm, longest) == pytest.approx(1e-6)
    moved_m2 = {
        "arm_joint_offset_rad": 3 * (0.5 * 0.01) ** 2, "arm_link_m": 5 * 0.01**2 / 3,
        "mount_m": 0.01**2, "mount_rad": (0.15 * 0.01) ** 2, "finger_base_m": 0.01**2,
        "link_length_share": (0.01 * longest) ** 2}
    for name, moved in moved_m2.items():
        one = replace(ErrorTable.none(), **{name: 0.01})
        assert place_variance(one, arm, longest) == pytest.approx(1e-6 + moved), name
    every = replace(ErrorTable.none(), **dict.fromkeys(moved_m2, 0.01))
    assert place_variance(every, arm, longest) == pytest.approx(1e-6 + sum(moved_m2.values()))
    floats = replace(arm, kind=FLOATING)  # it has no joints
    assert place_variance(every, floats, longest) == pytest.approx(
        1e-6 + sum(list(moved_m2.values())[2:]))


def test_errors_have_the_deviations_asked_for_and_are_an_episodes_own() -> None:
    table = ErrorTable()
    drawn = draw_calibration(table, KEY)
    for values, sigma in (
            (drawn.joint_offset_rad, table.joint_offset_rad),
            (drawn.link_length_share, table.link_length_share),
            (drawn.finger_base_m, table.finger_base_m),
            (drawn.moment_arm_share, table.moment_arm_share),
            (drawn.arm_offset_rad, table.arm_joint_offset_rad),
            (drawn.arm_length_m, table.arm_link_m), (drawn.mount[:, :3], table.mount_m),
            (drawn.pad_shift_m, table.pad_m), (drawn.pad_gain - 1.0, table.pad_gain_share)):
        assert values.std() == pytest.approx(sigma, rel=0.02)
        assert abs(values.mean()) < 0.02 * sigma
    alone = draw_calibration(table, KEY[7:8])
    for f in fields(Calibration):
        if f.name == "askew_limit":
            continue
        np.testing.assert_array_equal(getattr(alone, f.name)[0], getattr(drawn, f.name)[7])


def test_no_two_errors_are_drawn_from_the_same_numbers() -> None:
    drawn = draw_calibration(ErrorTable(), KEY)
    each = [getattr(drawn, f.name) for f in fields(Calibration) if f.name != "askew_limit"]
    columns = np.concatenate([values.reshape(len(KEY), -1) for values in each], 1)
    apart = np.delete(columns, columns.std(0) < 1e-6, axis=1)
    related = np.corrcoef(apart.T) - np.eye(apart.shape[1])
    assert np.abs(related).max() < 0.1  # by chance one in 63


def test_a_joint_stops_where_its_sensor_reads_its_limit() -> None:
    hand, contact = HandTable(), ContactTable()
    errors = draw_calibration(ErrorTable(joint_offset_rad=0.02), KEY[:5])
    rows: list[Any] = [true_hands(hand, contact, each, "cpu").numpy()
                       for each in (errors, no_errors())]
    for stop in ("low", "high"):
        true, believed = (each[stop] for each in rows)
        np.testing.assert_allclose(true + errors.joint_offset_rad,
                                   np.broadcast_to(believed, true.shape), atol=1e-12)


def test_no_errors_are_none() -> None:
    none = no_errors()
    assert none.worlds == 1
    np.testing.assert_array_equal(none.mount, [[0, 0, 0, 0, 0, 0, 1]])
    assert (none.pad_gain == 1.0).all()
    for name in ("joint_offset_rad", "link_length_share", "finger_base_m", "moment_arm_share",
                 "arm_offset_rad", "arm_length_m", "pad_shift_m"):
        assert not getattr(none, name).any()


def test_the_true_hand_is_where_the_true_arm_takes_it() -> None:
    """By the forward kinematics of a table with the errors in it, at the joints commanded."""
    hand, worlds = replace(HandTable(), mount_length_m=0.0), 6
    table = replace(ErrorTable.none(), arm_joint_offset_rad=0.002, arm_link_m=0.002)
    errors = draw_calibration(table, KEY[:worlds])
    wanted = np.array([0.45, 0.05, 0.30, 1.0, 0.0, 0.0, 0.0])
    moves, actual = move_hand(
        scene_of([body_from_name("block")], "cpu"), np.zeros(1, int),
        np.tile([2.0, 0, 0, 0, 0, 0, 1.0], (worlds, 1)), EXACT_ARM, hand, KEY[:worlds],
        ArmState.home(worlds), np.tile(wanted, (worlds, 1, 1)), np.ones((worlds, 1), bool),
        np.zeros((1, 4, 1, 4)), errors=errors)
    assert (moves.status == ProbeStatus.CONTACT).all()
    np.testing.assert_allclose(moves.believed_pose[:, 0, :3], wanted[None, :3].repeat(worlds, 0),
                               atol=1e-9)
    branches = puma_inverse_batch(EXACT_ARM, wanted[None])[0]
    for world in range(worlds):
        d, a = np.array(EXACT_ARM.d_m), np.array(EXACT_ARM.a_m)
        d[[0, 2, 3]] += errors.arm_length_m[world, :3]
        a[[1, 2]] += errors.arm_length_m[world, 3:]
        own = replace(EXACT_ARM, d_m=tuple(d), a_m=tuple(a))
        places = puma_forward_batch(own, branches + errors.arm_offset_rad[world, :6])[:, :3]
        away = np.linalg.norm(places - actual[world, 0, :3], axis=1)
        assert np.nanmin(away) < 1e-9
        assert 1e-4 < np.linalg.norm(actual[world, 0, :3] - wanted[:3]) < 0.02


def grasp_twice(errors: ErrorTable, worlds: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Joints read and true joints, (world, probe 2, finger, joint), without noise."""
    truth = Truth(np.tile([0.45, 0, 0, 0, 0, 0, 1.0], (worlds, 1)))
    quiet = SensorTable(tension_noise_N=0.0, tension_step_N=0.0, joint_noise_rad=0.0)
    robot = Robot([body_from_name("lightbulb")], np.zeros(1, int), truth, KEY[:worlds], EXACT_ARM,
                  HandTable(), quiet, contact=ContactTable(friction=0.0), errors=errors)
    poses = np.tile([0.45, 0.0, 0.16, 1.0, 0.0, 0.0, 0.0], (worlds, 2, 1))
    poses[:, 1, 0] += 0.004
    commands = closing_commands(CLOSING_PATHS["curl40"])[None]
    felt = robot.grasp(poses, np.ones((worlds, 2), bool), commands, np.array([commands.shape[2]]))
    return felt.closing.q_rad[:, :, 0], truth.closings[0].q_rad[:, :, 0]


def test_a_joint_sensors_zero_is_off_by_the_same_in_every_grasp() -> None:
    read, true = grasp_twice(ErrorTable())
    off = read - true
    np.testing.assert_allclose(off[:, 0], off[:, 1], atol=1e-12)
    assert off.std() == pytest.approx(ErrorTable().joint_offset_rad, rel=0.2)
    assert len(np.unique(np.round(off[:, 0], 12))) == off[:, 0].size


@pytest.mark.parametrize("name", ["joint_offset_rad", "link_length_share", "finger_base_m",
                                  "moment_arm_share", "arm_joint_offset_rad", "arm_link_m",
                                  "mount_m", "mount_rad"])
def test_each_error_moves_what_truly_happens(name: str) -> None:
    exact = grasp_twice(ErrorTable.none())[1]
    own = grasp_twice(replace(ErrorTable.none(), **{name: getattr(ErrorTable(), name)}))[1]
    assert (np.abs(own - exact) > 1e-7).any((1, 2, 3)).all()
