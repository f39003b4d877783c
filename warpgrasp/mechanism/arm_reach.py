"""Which hand poses the arm can take: a question a strategy may ask before it moves."""

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.mechanism.puma560 import puma_inverse_batch
from warpgrasp.parameters import ArmTable, HandTable


def hand_reachable(arm: ArmTable, hand: HandTable, hand_pose: np.ndarray) -> np.ndarray:
    """Whether some arm configuration inside the limits takes the hand there, shape (...,).

    `hand_pose` (..., 7) is position [m] and quaternion xyzw in the base frame; a pose that is not
    finite is not reachable.
    """
    poses = np.asarray(hand_pose, float)
    inside, _ = _configurations(arm, hand, poses)
    return np.asarray(inside.any(-1))


def travel_time(
    arm: ArmTable, hand: HandTable, start_pose: np.ndarray, end_pose: np.ndarray
) -> np.ndarray:
    """About how long the arm takes between hand poses, broadcast (..., 7) each [s], shape (...,).

    The slowest joint governs, over the pair of configurations that are nearest in time; inf where
    either pose is out of reach.
    """
    inside, q = _configurations(arm, hand, np.asarray(start_pose, float))
    inside_end, q_end = _configurations(arm, hand, np.asarray(end_pose, float))
    apart = np.abs(q[..., :, None, :] - q_end[..., None, :, :])
    time = (apart / np.asarray(arm.speed_rad_s)).max(-1)
    possible = inside[..., :, None] & inside_end[..., None, :]
    return np.where(possible, time, np.inf).min((-1, -2))


def _configurations(
    arm: ArmTable, hand: HandTable, poses: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The eight configurations [rad] of hand poses (..., 7), each angle the least inside the
    limits where there is one: whether they are (..., 8), and the angles (..., 8, 6)."""
    flat = poses.reshape(-1, 7)
    finite = np.asarray(np.isfinite(flat).all(1))
    flange = np.where(finite[:, None], flat, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    flange[:, :3] -= Rotation.from_quat(flange[:, 3:]).apply([0.0, 0.0, hand.mount_length_m])
    q = puma_inverse_batch(arm, flange)
    low, high = np.asarray(arm.limit_low_rad), np.asarray(arm.limit_high_rad)
    # The least equivalent angle that is not below the lower limit.
    with np.errstate(invalid="ignore"):
        wrapped = low + np.mod(q - low, 2 * np.pi)
        inside = (np.isfinite(q) & (wrapped <= high)).all(-1) & finite[:, None]
    shape = poses.shape[:-1]
    return inside.reshape(*shape, 8), np.nan_to_num(wrapped).reshape(*shape, 8, 6)
