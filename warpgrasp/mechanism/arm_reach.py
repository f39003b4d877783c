"""Which hand poses the arm can take: a question a strategy may ask before it moves."""

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.arms.serial_arm import arm_reach_m, joint_choices
from warpgrasp.mechanism.arm import floating_joints, is_floating, serial_model
from warpgrasp.mechanism.arm_motion_kernel import RETREAT_M
from warpgrasp.mechanism.puma560 import puma_inverse_batch, puma_reachable_batch
from warpgrasp.parameters import ArmTable, HandTable

_FARTHEST_M = 1.2
"""Of places that the PUMA 560 takes the hand to, from its base."""
_LATTICE_M = 0.05
_ON_LINE = 64
_WITHIN_M = 1e-9
"""How far within its box a floating wrist is, whose places are rounded."""


def hand_reachable(arm: ArmTable, hand: HandTable, hand_pose: np.ndarray) -> np.ndarray:
    """Whether some arm configuration inside the limits takes the hand there, shape (...,).

    `hand_pose` (..., 7) is position [m] and quaternion xyzw in the base frame; a pose that is not
    finite is not reachable.
    """
    poses = np.asarray(hand_pose, float)
    if is_floating(arm) or serial_model(arm) is not None:
        return np.asarray(_configurations(arm, hand, poses)[0].any(-1))
    flange, finite = _flanges(hand, poses)
    return (puma_reachable_batch(arm, flange) & finite).reshape(poses.shape[:-1])


def pose_reachable(arm: ArmTable, hand: HandTable, hand_pose: np.ndarray) -> np.ndarray:
    """As `hand_reachable`, of the pose and of the one that the hand comes to it from."""
    behind = np.array(hand_pose, float)
    turn = Rotation.from_quat(behind[..., 3:].reshape(-1, 4))
    behind[..., :3] -= turn.apply([0.0, 0.0, RETREAT_M]).reshape(behind[..., :3].shape)
    return hand_reachable(arm, hand, hand_pose) & hand_reachable(arm, hand, behind)


def nearest_reachable(arm: ArmTable, hand: HandTable, hand_pose: np.ndarray) -> np.ndarray | None:
    """The reachable hand pose (7,) nearest to `hand_pose` (7,) that is turned as it is.

    To about 10 mm: a lattice is searched, then the line from its best place to the pose asked for.
    None where no place of the lattice is reachable turned so. Of a floating wrist, whose box may
    lie anywhere, to `_WITHIN_M`; None where its box has no room for the pose and its retreat.
    """
    if is_floating(arm):
        return _nearest_in_box(arm, hand, hand_pose)
    base, farthest = _base_and_reach(arm, hand)
    low, high = np.maximum(base - farthest, [-np.inf, -np.inf, 0.0]), base + farthest
    apart = float(np.linalg.norm(hand_pose[:3] - np.clip(hand_pose[:3], low, high)))
    best, beyond, wide = None, 0.0, 2 * _LATTICE_M
    while best is None and beyond < apart + 4 * farthest:  # the nearest first, mostly near by
        near = _lattice(hand_pose[:3], base, farthest, beyond, apart + wide)
        beyond, wide = apart + wide, 2 * wide
        poses = np.concatenate([near, np.tile(hand_pose[3:], (len(near), 1))], 1)
        reached = pose_reachable(arm, hand, poses)
        best = poses[int(reached.argmax())] if reached.any() else None
    if best is None:
        return None
    way = hand_pose[:3] - best[:3]
    length = float(np.linalg.norm(way))
    on_line = np.repeat(best[None], _ON_LINE, 0)
    share = np.linspace(0.0, min(1.0, 2 * _LATTICE_M / max(length, 1e-12)), _ON_LINE)
    on_line[:, :3] += share[:, None] * way
    barred = ~pose_reachable(arm, hand, on_line)
    return on_line[int(barred.argmax()) - 1] if barred.any() else on_line[-1]


def _nearest_in_box(arm: ArmTable, hand: HandTable, hand_pose: np.ndarray) -> np.ndarray | None:
    """`nearest_reachable` of a floating wrist: flange and retreat of the flange are in its box."""
    ahead = Rotation.from_quat(hand_pose[3:]).apply([0.0, 0.0, 1.0])
    ahead = np.outer([hand.mount_length_m, hand.mount_length_m + RETREAT_M], ahead)
    low = (np.asarray(arm.box_low_m) + ahead).max(0) + _WITHIN_M
    high = (np.asarray(arm.box_high_m) + ahead).min(0) - _WITHIN_M
    if (low > high).any():
        return None
    return np.concatenate([np.clip(hand_pose[:3], low, high), hand_pose[3:]])


def _base_and_reach(arm: ArmTable, hand: HandTable) -> tuple[np.ndarray, float]:
    """Where an arm stands [m], and how far from there it may take the hand at most [m]."""
    model = serial_model(arm)
    if model is None:
        return np.zeros(3), _FARTHEST_M
    return np.array(model.base_xyz_m), (
        float(np.linalg.norm(model.joints[0].xyz_m)) + arm_reach_m(model) + hand.mount_length_m)


def _lattice(place: np.ndarray, base: np.ndarray, farthest: float, beyond: float, within: float
             ) -> np.ndarray:
    """The places of the lattice about the base that are so far from `place` (3,), the nearest
    first, (near, 3)."""
    steps = np.arange(-farthest, farthest + _LATTICE_M / 2, _LATTICE_M)
    along = [(at + steps)[np.abs(at + steps - middle) <= within]
             for at, middle in zip(base, place, strict=True)]
    along[2] = along[2][along[2] >= 0.0]
    near = np.stack(np.meshgrid(*along), -1).reshape(-1, 3)
    far = np.linalg.norm(near - place, axis=1)
    shell = ((far > beyond) | (beyond == 0.0)) & (far <= within)
    return near[shell][np.argsort(far[shell], kind="stable")]


def travel_time(
    arm: ArmTable, hand: HandTable, start_pose: np.ndarray, end_pose: np.ndarray
) -> np.ndarray:
    """About how long the arm takes between hand poses, broadcast (..., 7) each [s], shape (...,).

    The slowest joint governs, over the pair of configurations that are nearest in time; inf where
    either pose is out of reach.
    """
    if is_floating(arm):
        return _floating_time(arm, hand, np.asarray(start_pose, float), np.asarray(end_pose, float))
    model = serial_model(arm)
    speed = arm.speed_rad_s if model is None else [joint.speed_rad_s for joint in model.joints]
    inside, q = _configurations(arm, hand, np.asarray(start_pose, float))
    inside_end, q_end = _configurations(arm, hand, np.asarray(end_pose, float))
    apart = np.abs(q[..., :, None, :] - q_end[..., None, :, :])
    time = (apart / np.asarray(speed)).max(-1)
    possible = inside[..., :, None] & inside_end[..., None, :]
    return np.where(possible, time, np.inf).min((-1, -2))


def _floating_time(
    arm: ArmTable, hand: HandTable, start: np.ndarray, end: np.ndarray
) -> np.ndarray:
    """`travel_time` of a floating wrist: way and turn at once, the slower one governs."""
    start, end = np.broadcast_arrays(start, end)
    possible, q = _configurations(arm, hand, start)
    possible_end, q_end = _configurations(arm, hand, end)
    way = np.linalg.norm(q_end[..., 0, :3] - q[..., 0, :3], axis=-1)
    turn = (Rotation.from_rotvec(q[..., 0, 3:].reshape(-1, 3)).inv()
            * Rotation.from_rotvec(q_end[..., 0, 3:].reshape(-1, 3))).magnitude()
    time = np.maximum(way / arm.wrist_speed_m_s, turn.reshape(way.shape) / arm.wrist_turn_rad_s)
    return np.where(possible[..., 0] & possible_end[..., 0], time, np.inf)


def _flanges(hand: HandTable, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Flange poses (pose, 7) of hand poses (..., 7), and which are finite, bool (pose,)."""
    flat = poses.reshape(-1, 7)
    finite = np.asarray(np.isfinite(flat).all(1))
    flange = np.where(finite[:, None], flat, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    flange[:, :3] -= Rotation.from_quat(flange[:, 3:]).apply([0.0, 0.0, hand.mount_length_m])
    return flange, finite


def _configurations(
    arm: ArmTable, hand: HandTable, poses: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The configurations [rad] of hand poses (..., 7): whether they are, (..., n), and the angles
    (..., n, joint). Of the PUMA 560 eight, each angle the least inside the limits where there is
    one; a floating wrist has one; of a serial arm those that some starts come to."""
    flange, finite = _flanges(hand, poses)
    shape = poses.shape[:-1]
    if is_floating(arm):  # one configuration a pose
        within = (flange[:, :3] >= arm.box_low_m) & (flange[:, :3] <= arm.box_high_m)
        return ((within.all(1) & finite).reshape(*shape, 1),
                floating_joints(flange).reshape(*shape, 1, 6))
    model = serial_model(arm)
    if model is not None:
        q = joint_choices(model, flange)
        inside = np.isfinite(q).all(-1) & finite[:, None]
        return inside.reshape(*shape, -1), np.nan_to_num(q).reshape(*shape, *q.shape[1:])
    q = puma_inverse_batch(arm, flange)
    low, high = np.asarray(arm.limit_low_rad), np.asarray(arm.limit_high_rad)
    # The least equivalent angle that is not below the lower limit.
    with np.errstate(invalid="ignore"):
        wrapped = low + np.mod(q - low, 2 * np.pi)
        inside = (np.isfinite(q) & (wrapped <= high)).all(-1) & finite[:, None]
    return inside.reshape(*shape, 8), np.nan_to_num(wrapped).reshape(*shape, 8, 6)
