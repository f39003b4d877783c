"""The robot that is: how each world's arm and hand differ from the tables that are believed.

A calibration error is drawn once an episode and kept. The true robot moves and feels with it; what
the robot concludes comes from the tables alone (Allen and Michelman 1990 name the calibration of
the arm, the joint sensors and the hand's kinematic model as their sources of error).
"""

from dataclasses import dataclass, fields, replace
from functools import lru_cache

import numpy as np
import warp as wp
from scipy.spatial.transform import Rotation

from warpgrasp.arms.arm_model import ARM_JOINTS, ArmModel
from warpgrasp.core.random import Purpose, counter_key, normal_vector
from warpgrasp.core.struct_array import repeated
from warpgrasp.mechanism.arm import arm_of, is_floating, serial_model
from warpgrasp.mechanism.puma560_kernel import Arm
from warpgrasp.mechanism.tendon import may_stop_free, tendon_sensor_of
from warpgrasp.mechanism.tendon_kernel import TendonSensor
from warpgrasp.mechanism.utah_mit_hand import FINGER_COUNT, LINK_COUNT, hand_of
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand
from warpgrasp.mechanism.utah_mit_weight import link_weights, weight_bounds
from warpgrasp.parameters import (
    ArmTable,
    ContactTable,
    ErrorTable,
    HandTable,
    SensorTable,
)
from warpgrasp.table_misfit import LARGEST_ERROR

_ARM_LENGTHS = ("d1", "d3", "d4", "a2", "a3")
_ARM_LEVER_M, _MOUNT_LEVER_M = 0.5, 0.15
"""From the arm's joints, and from the mount, to a fingertip, about."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """The errors of each world's robot, true less believed. Shapes start with (world,).

    Two are equal only if they are the same, so that what is made from one can be kept.
    """

    joint_offset_rad: np.ndarray
    """What joint sensors read less the joints' angles, (..., finger, joint): 4, 4 of the Utah-MIT
    hand."""
    link_length_share: np.ndarray
    """Of each link's length, (..., finger, link)."""
    finger_base_m: np.ndarray
    """Hand frame, (..., finger, 3)."""
    moment_arm_share: np.ndarray
    """Of what turns a torque into what is read, (..., finger, joint)."""
    arm_offset_rad: np.ndarray
    """Of each joint of the arm, (..., 7)."""
    arm_length_m: np.ndarray
    """Of d1, d3, d4, a2, a3 of the PUMA's DH table, of other arms of the first five ways from joint
    to joint, (..., 5)."""
    mount: np.ndarray
    """Pose [m] and quaternion xyzw in the nominal frame of the hand, (..., 7)."""
    pad_shift_m: np.ndarray
    """Along and across its link, (..., finger, link, 2)."""
    pad_gain: np.ndarray
    """Factor, (..., finger, link)."""
    askew_limit: float
    """What `Hand.askew` is at most for any errors of this size, weight apart."""

    @property
    def worlds(self) -> int:
        """1 where all worlds share one robot."""
        return len(self.mount)

    def of(self, rows: np.ndarray) -> "Calibration":
        """Those of the worlds `rows` (row,); itself where all worlds share one robot."""
        if self.worlds == 1:
            return self
        return replace(self, **{f.name: getattr(self, f.name)[rows] for f in fields(self)
                                if isinstance(getattr(self, f.name), np.ndarray)})


def draw_calibration(
    table: ErrorTable, key: np.ndarray, *, fingers: int = FINGER_COUNT, joints: int = 4,
    links: int = LINK_COUNT,
) -> Calibration:
    """The errors of each world, from its episode's key (world,) uint64; the defaults are the
    Utah-MIT hand's.

    Normal, cut at three standard deviations; the mount's axes are not cut. Raises ValueError where
    factors could be zero or less; those of pads are asked where a pad is to feel.
    """
    if wrong := table.misfit(pads=False):
        raise ValueError(wrong)
    stream = counter_key(key, int(Purpose.CALIBRATION))

    def draw(number: int, *shape: int) -> np.ndarray:
        values = normal_vector(counter_key(stream, number), int(np.prod(shape)))
        return np.clip(values, -LARGEST_ERROR, LARGEST_ERROR).reshape(len(key), *shape)

    mount = normal_vector(counter_key(key, int(Purpose.MOUNT)), 6)
    turn = Rotation.from_rotvec(mount[:, 3:] * table.mount_rad).as_quat()
    each = fingers, links
    return Calibration(
        joint_offset_rad=table.joint_offset_rad * draw(0, fingers, joints),
        link_length_share=table.link_length_share * draw(1, *each),
        finger_base_m=table.finger_base_m * draw(2, fingers, 3),
        moment_arm_share=table.moment_arm_share * draw(3, fingers, joints),
        arm_offset_rad=table.arm_joint_offset_rad * draw(4, ARM_JOINTS),
        arm_length_m=table.arm_link_m * draw(5, len(_ARM_LENGTHS)),
        mount=np.concatenate([mount[:, :3] * table.mount_m, turn], axis=1),
        pad_shift_m=table.pad_m * draw(6, *each, 2),
        pad_gain=1.0 + table.pad_gain_share * draw(7, *each),
        askew_limit=LARGEST_ERROR * (3 * table.joint_offset_rad + table.link_length_share))


@lru_cache(maxsize=4)
def no_errors(fingers: int = FINGER_COUNT, joints: int = 4, links: int = LINK_COUNT
              ) -> Calibration:
    """The robot that is believed, shared by all worlds."""
    return draw_calibration(ErrorTable.none(), np.zeros(1, np.uint64), fingers=fingers,
                            joints=joints, links=links)


def arm_variance(errors: ErrorTable, arm: ArmTable) -> float:
    """Variance per axis of where the flange is believed to be [m2]: the arm's calibration, turns
    acting on a lever of half a metre, and its repeatability. A floating wrist has no joints whose
    calibration could be off. An estimate."""
    if is_floating(arm):
        return arm.repeatability_m**2
    swing = 3 * (_ARM_LEVER_M * errors.arm_joint_offset_rad) ** 2
    return swing + len(_ARM_LENGTHS) / 3 * errors.arm_link_m**2 + arm.repeatability_m**2


def place_variance(errors: ErrorTable, arm: ArmTable, longest_m: float) -> float:
    """Variance per axis of where the robot believes a place on a finger to be [m2], its finger's
    joints apart: from the calibration of arm, mount and finger base, and the arm's repeatability.

    `longest_m` is the length of the hand's longest link. An estimate: turns of the mount act on a
    lever of 0.15 m.
    """
    return (arm_variance(errors, arm) + errors.mount_m**2
            + (_MOUNT_LEVER_M * errors.mount_rad) ** 2 + errors.finger_base_m**2
            + (errors.link_length_share * longest_m) ** 2)


def _strays(table: HandTable, errors: Calibration) -> np.ndarray:
    """How far any place of each link is from where the tables have it, in the frame of its finger's
    base, at most [m], (world or 1, finger 4, link 3)."""
    length = np.array(table.link_length_m)
    end = length.cumsum()
    lever = np.stack([end + table.abduction_offset_m,
                      *(np.maximum(end - start, 0.0) for start in end - length)])
    return np.abs(errors.joint_offset_rad) @ (1.1 * lever) + (
        np.abs(errors.link_length_share) * length).cumsum(-1)


def _askew(errors: Calibration) -> np.ndarray:
    """How far links stand askew of those believed [rad], and how much longer they are, relatively:
    the largest sum, (world or 1, finger 4)."""
    offset = errors.joint_offset_rad
    turned = np.abs(np.concatenate([offset[..., :1], offset[..., 1:].cumsum(-1)], -1)).max(-1)
    return turned + np.abs(errors.link_length_share).max(-1)


@lru_cache(maxsize=8)
def true_hands(
    table: HandTable, contact: ContactTable, errors: Calibration, device: str
) -> wp.array:
    """The true hands as kernels take them, (world or 1, finger 4).

    A joint's stops are where its sensor reads its limits: the zeros are set by them.
    """
    rows = repeated(hand_of(table, contact), Hand, (errors.worlds, FINGER_COUNT))
    rows["link_length"] *= 1.0 + errors.link_length_share
    rows["base_shift"] = errors.finger_base_m
    rows["offset"] = errors.joint_offset_rad
    rows["sag"] += _strays(table, errors)
    rows["askew"] += _askew(errors)
    rows["low"] -= errors.joint_offset_rad
    rows["high"] -= errors.joint_offset_rad
    return wp.array(rows, dtype=Hand, device=device)


@lru_cache(maxsize=8)
def true_tendons(
    hand: HandTable, sensors: SensorTable, contact: ContactTable, errors: Calibration, device: str
) -> wp.array:
    """The true tendons as kernels take them, (world or 1, finger 4)."""
    rows = repeated(tendon_sensor_of(hand, sensors), TendonSensor, (errors.worlds, FINGER_COUNT))
    rows["moment_arm"] *= 1.0 + errors.moment_arm_share
    rows["per_torque"] = 1.0 / rows["moment_arm"]
    torque = weight_bounds(hand, link_weights(hand) * contact.weight)[0]
    rows["heard"] = may_stop_free(hand, sensors, (torque / rows["moment_arm"])[..., 1:].max(-1))
    return wp.array(rows, dtype=TendonSensor, device=device)


def true_arms(
    table: ArmTable, mount_length_m: float, errors: Calibration, device: str
) -> wp.array:
    """The true arms as kernels take them, (world or 1,)."""
    return _true_arms(table, serial_model(table), mount_length_m, errors, device)


@lru_cache(maxsize=8)
def _true_arms(
    table: ArmTable, model: ArmModel | None, mount_length_m: float, errors: Calibration, device: str
) -> wp.array:
    """As `true_arms`; `model` is the table's, whose file may have changed."""
    rows = repeated(arm_of(table, mount_length_m), Arm, (errors.worlds,))
    if model is not None:
        _lengthen(rows["serial"], errors.arm_length_m)
    else:
        for n, name in enumerate(_ARM_LENGTHS):
            rows[name] += errors.arm_length_m[:, n]
    rows["offset"] = errors.arm_offset_rad
    return wp.array(rows, dtype=Arm, device=device)


def _lengthen(serial: np.ndarray, more_m: np.ndarray) -> None:
    """Makes the first ways from joint to joint longer: of rows of `SerialArm`, in place."""
    way = serial["frame"][:, :, :3]
    length = np.linalg.norm(way, axis=-1)
    moved = [j for j in range(1, ARM_JOINTS) if length[0, j] > 0.0][:more_m.shape[1]]
    for n, j in enumerate(moved):
        way[:, j] *= (1.0 + more_m[:, n] / length[:, j])[:, None]
