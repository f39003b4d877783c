"""Which hand poses the arm can take: a question a strategy may ask before it moves."""

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.parameters import ArmTable, HandTable
from warpgrasp.puma560 import puma_inverse_batch


def hand_reachable(arm: ArmTable, hand: HandTable, hand_pose: np.ndarray) -> np.ndarray:
    """Whether some arm configuration inside the limits takes the hand there, shape (...,).

    `hand_pose` (..., 7) is position [m] and quaternion xyzw in the base frame; a pose that is not
    finite is not reachable.
    """
    poses = np.asarray(hand_pose, float)
    flat = poses.reshape(-1, 7)
    finite = np.asarray(np.isfinite(flat).all(1))
    flange = np.where(finite[:, None], flat, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    flange[:, :3] -= Rotation.from_quat(flange[:, 3:]).apply([0.0, 0.0, hand.mount_length_m])
    q = puma_inverse_batch(arm, flange)
    low, high = np.asarray(arm.limit_low_rad), np.asarray(arm.limit_high_rad)
    # The least equivalent angle that is not below the lower limit.
    with np.errstate(invalid="ignore"):
        wrapped = low + np.mod(q - low, 2 * np.pi)
        inside = (np.isfinite(q) & (wrapped <= high)).all(-1).any(-1)
    return np.asarray(inside & finite).reshape(poses.shape[:-1])
