"""The arm that a table names, on the host: its flange, its home, and the floating wrist.

A floating wrist stands for an arm that reaches every pose: its six numbers are the flange's place
[m] and rotation vector [rad], base frame; its place stays within a box, and way and turn have a
speed each.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.core.dtypes import vec6
from warpgrasp.mechanism.puma560 import puma_arm, puma_forward_batch
from warpgrasp.mechanism.puma560_kernel import Arm
from warpgrasp.parameters import ArmTable

HOME_RAD = tuple(np.radians((19.5, 28.8, 160.0, 0.0, -8.8, -160.5)))
"""Where an episode starts: the hand some 0.35 m above the table, pointing down."""
_FLOATING_HOME = (0.45, 0.0, 0.5, np.pi, 0.0, 0.0)
"""Of a floating wrist, as near to this as its box lets it: the flange, pointing down."""


def is_floating(table: ArmTable) -> bool:
    """Whether the table's arm is none, a floating wrist."""
    return table.kind == "none"


def arm_of(table: ArmTable, mount_length_m: float) -> Arm:
    """The kernels' arm. Raises ValueError for a table the closed-form inverse does not cover."""
    if not is_floating(table):
        return puma_arm(table, mount_length_m)
    arm = Arm()
    arm.floating = 1
    arm.low = vec6(*table.box_low_m, *[-np.inf] * 3)
    arm.high = vec6(*table.box_high_m, *[np.inf] * 3)
    arm.speed = vec6(*[table.wrist_speed_m_s] * 3, *[table.wrist_turn_rad_s] * 3)
    arm.mount, arm.repeatability = mount_length_m, table.repeatability_m
    return arm


def arm_home(table: ArmTable) -> np.ndarray:
    """The joints where an episode starts, (6,)."""
    if not is_floating(table):
        return np.array(HOME_RAD)
    home = np.array(_FLOATING_HOME)
    home[:3] = np.clip(home[:3], table.box_low_m, table.box_high_m)
    return home


def arm_flanges(table: ArmTable, q: np.ndarray, *, device: str = "cpu") -> np.ndarray:
    """Flange poses (x, y, z [m], quaternion xyzw), (pose, 7), of joints (pose, 6)."""
    if not is_floating(table):
        return puma_forward_batch(table, q, device=device)
    return np.concatenate([q[:, :3], Rotation.from_rotvec(q[:, 3:]).as_quat()], axis=1)


def floating_joints(flange: np.ndarray) -> np.ndarray:
    """The six numbers (pose, 6) of a floating wrist at flange poses (pose, 7)."""
    return np.concatenate([flange[:, :3], Rotation.from_quat(flange[:, 3:]).as_rotvec()], axis=1)
