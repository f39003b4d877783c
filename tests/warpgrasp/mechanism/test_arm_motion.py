"""Arm and hand together: 22 joints in, every fingertip in the world out."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from warpgrasp.chain.chain_hand import chain_of, hand_of_kind
from warpgrasp.chain.chain_move import chain_clearance
from warpgrasp.geometry.body import Body, Part, scene_of
from warpgrasp.geometry.scene import Shape
from warpgrasp.mechanism.arm_motion import ArmState, Clearance, arm_hand_links, move_hand
from warpgrasp.mechanism.calibration import Calibration, draw_calibration
from warpgrasp.mechanism.puma560 import HOME_RAD, puma_forward_batch, puma_inverse_batch
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, ContactTable, ErrorTable, HandTable
from warpgrasp.probe_status import ProbeStatus

ARM, HAND = ArmTable(), HandTable()


def test_fingertips_ride_on_the_flange() -> None:
    rng = np.random.default_rng(0)
    q = np.zeros((50, 22))
    q[:, :6] = rng.uniform(ARM.limit_low_rad, ARM.limit_high_rad, (50, 6))
    points, palmar = arm_hand_links(ARM, HAND, q)
    flange = puma_forward_batch(ARM, q[:, :6])
    reach = HAND.mount_length_m + HAND.abduction_offset_m + sum(HAND.link_length_m)
    for finger, (x, y) in enumerate(((-1, -1), (-1, 0), (-1, 1), (1, 0))):
        local = [x * HAND.palm_gap_m / 2, y * HAND.finger_spacing_m, reach]
        tip = Rotation.from_quat(flange[:, 3:]).apply(local) + flange[:, :3]
        assert np.allclose(points[:, finger, 4], tip, atol=1e-12)
    assert np.allclose(np.linalg.norm(palmar, axis=-1), 1.0)


def test_home_holds_the_hand_above_the_table_pointing_down() -> None:
    points, _ = arm_hand_links(ARM, HAND, np.array([[*HOME_RAD, *np.zeros(16)]]))
    along = points[0, 1, 4] - points[0, 1, 0]
    assert along[2] / np.linalg.norm(along) < -0.999
    assert 0.1 < points[..., 2].min() < points[..., 2].max() < 0.6


def test_home_lies_within_the_limits_so_that_the_first_move_is_short() -> None:
    assert (np.array(ARM.limit_low_rad) <= HOME_RAD).all()
    assert (np.array(ARM.limit_high_rad) >= HOME_RAD).all()
    poses = hand_poses_of(puma_forward_batch(ARM, np.array([HOME_RAD])))
    poses[..., 2] += 0.05
    block = Body("far", (Part(Shape.BLOCK, size_m=(0.01, 0.01, 0.01)),), (-0.1, -0.1, 0.0),
                 (0.1, 0.1, 0.1))
    moves, _ = move_hand(scene_of([block], "cpu"), np.zeros(1, int),
                         np.array([[0.0, 0.9, 0.0, 0, 0, 0, 1.0]]), ARM, HAND,
                         np.zeros(1, np.uint64), ArmState.home(1), poses, np.ones((1, 1), bool),
                         np.zeros((1, 4, 1, 4)))
    assert np.abs(moves.state.q_rad[0, :6] - HOME_RAD).max() < 0.7


def hand_poses_of(flange: np.ndarray) -> np.ndarray:
    """Poses of the hand (1, pose, 7) at flange poses (pose, 7)."""
    tool = Rotation.from_quat(flange[:, 3:]).apply([0.0, 0.0, HAND.mount_length_m])
    return np.concatenate([flange[:, :3] + tool, flange[:, 3:]], 1)[None]


def joints_of(hand_pose: np.ndarray) -> np.ndarray:
    """The arm's joints (pose, branch 8, 6), by each branch of the inverse, at poses of the hand."""
    back = Rotation.from_quat(hand_pose[:, 3:]).apply([0.0, 0.0, HAND.mount_length_m])
    return puma_inverse_batch(ARM, np.concatenate([hand_pose[:, :3] - back, hand_pose[:, 3:]], 1))


def test_joints_go_to_the_nearest_step_of_their_encoders() -> None:
    """By the closed-form inverse, of the pose that was wanted and of that which was taken."""
    step = np.pi / 300  # a whole turn is a number of steps
    arm = replace(ARM, encoder_step_rad=step, repeatability_m=0.0)
    poses = np.tile([0.45, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0], (1, 20, 1))
    rng = np.random.default_rng(2)
    poses[..., :3] += rng.uniform(-0.05, 0.05, (1, 20, 3))
    poses[0, :, 3:] = (Rotation.from_rotvec(rng.uniform(-0.2, 0.2, (20, 3)))
                       * Rotation.from_quat(poses[0, :, 3:])).as_quat()
    moves, actual = move_hand(
        scene_of([body_from_name("block")], "cpu"), np.zeros(1, int),
        np.array([[0.0, 0.9, 0.0, 0, 0, 0, 1.0]]), arm, HAND, np.zeros(1, np.uint64),
        ArmState.home(1), poses, np.ones((1, 20), bool), np.zeros((1, 4, 1, 4)))
    assert (moves.status == ProbeStatus.CONTACT).all()
    np.testing.assert_array_equal(moves.believed_pose, actual)
    taken, wanted = joints_of(actual[0]), joints_of(poses[0])
    stepped = np.abs(taken / step - np.round(taken / step)).max(-1)  # (pose, branch)
    there = stepped.argmin(1)
    assert stepped.min(1).max() < 1e-6
    off = (taken - wanted)[np.arange(20), there] / step
    assert np.abs(off).max() < 0.5 + 1e-6
    assert np.abs(off).max(0).min() > 0.1


def test_another_number_of_joints_is_refused() -> None:
    with pytest.raises(ValueError, match="22"):
        arm_hand_links(ARM, HAND, np.zeros((1, 21)))


@pytest.mark.parametrize("gap", [0.0005, 0.001, 0.0015, 0.003])
def test_a_way_along_a_wall_is_looked_at_to_its_end(gap: float) -> None:
    """Straight fingers straddle a block, near to it: steps are short, and end in the table."""
    wide = HAND.palm_gap_m - 2 * HAND.link_radius_m - 2 * gap
    block = Body("wall", (Part(Shape.BLOCK, size_m=(wide, 0.03, 0.1)),), (-0.1, -0.1, 0.0),
                 (0.1, 0.1, 0.1))
    exact = ArmTable(encoder_step_rad=0.0, repeatability_m=0.0)

    def status(height: float) -> int:
        moves, _ = move_hand(
            scene_of([block], "cpu"), np.zeros(1, int), np.array([[0.45, 0, 0, 0, 0, 0, 1.0]]),
            exact, HAND, np.array([7], np.uint64), ArmState.home(1),
            np.array([[[0.45, 0.0, height, 1.0, 0.0, 0.0, 0.0]]]), np.ones((1, 1), bool),
            np.zeros((1, 4, 1, 4)))
        return int(moves.status[0, 0, 0])

    tips = HAND.abduction_offset_m + sum(HAND.link_length_m) + HAND.link_radius_m
    assert status(tips + 0.001) == ProbeStatus.CONTACT
    assert status(tips - 0.020) == ProbeStatus.COLLISION


@pytest.mark.parametrize("errors", [ErrorTable.none(), replace(
    ErrorTable.none(), joint_offset_rad=0.05, link_length_share=0.1)], ids=["exact", "astray"])
def test_the_utah_mit_hand_as_a_chain_is_barred_as_by_its_own_numbers(errors: ErrorTable) -> None:
    """Its approach, from all sides and from beyond the object, too, and fingers that open otherwise
    for a second grasp."""
    worlds, probes, wrist = 12, 24, ArmTable(kind="none")
    rng, key = np.random.default_rng(4), np.arange(worlds, dtype=np.uint64)
    turn = Rotation.from_euler("xyz", np.stack([
        np.pi + rng.uniform(-1.7, 1.7, (worlds, probes)),
        rng.uniform(-1.7, 1.7, (worlds, probes)),
        rng.uniform(-np.pi, np.pi, (worlds, probes))], -1).reshape(-1, 3))
    place = rng.uniform([0.25, -0.2, 0.1], [0.65, 0.2, 0.3], (worlds, probes, 3))
    poses = np.concatenate([place, turn.as_quat().reshape(worlds, probes, 4)], -1)
    commands = np.zeros((2, 4, 1, 4))
    commands[1, :, 0, 1:] = np.radians([20.0, 40.0, 40.0])
    chain = chain_of(hand_of_kind("utah_mit"))
    own = draw_calibration(errors, key)
    beside = ((0, 0), (0, 0), (0, 2))
    as_chain = replace(
        own, joint_offset_rad=np.pad(own.joint_offset_rad, beside),
        link_length_share=np.pad(own.link_length_share, ((0, 0), (0, 0), (1, 2))))

    def status(errors: Calibration, clearance: Clearance | None) -> np.ndarray:
        return move_hand(
            scene_of([body_from_name("block")], "cpu"), np.zeros(1, int),
            np.tile([0.45, 0, 0, 0, 0, 0, 1.0], (worlds, 1)), wrist, HAND, key,
            ArmState.home(worlds, wrist), poses, np.ones((worlds, probes), bool), commands,
            errors=errors, clearance=clearance)[0].status

    found = status(own, None)
    barred = (found == ProbeStatus.COLLISION).mean((0, 1))
    assert ((barred > 0.1) & (barred < 0.8)).all()
    np.testing.assert_array_equal(found, status(as_chain, chain_clearance(
        chain, HAND, ContactTable(), as_chain)))
