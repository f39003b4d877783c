"""The arm that a table names, on the host: its flange, its home, and the floating wrist.

A floating wrist stands for an arm that reaches every pose: its six numbers are the flange's place
[m] and rotation vector [rad], base frame; its place stays within a box, and way and turn have a
speed each. A serial arm has its numbers in a file of its own (`warpgrasp.arms`).
"""

from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.arms.arm_model import ArmModel
from warpgrasp.arms.serial_arm import flange_poses, padded, serial_of
from warpgrasp.core.dtypes import vec7
from warpgrasp.mechanism.puma560 import HOME_RAD, home_misfit, puma_arm, puma_forward_batch
from warpgrasp.mechanism.puma560_kernel import Arm
from warpgrasp.parameters import FLOATING, PUMA560, ArmTable
from warpgrasp.table_misfit import order_misfit

_FLOATING_HOME = (0.45, 0.0, 0.5, np.pi, 0.0, 0.0)
"""Of a floating wrist, as near to this as its box lets it: the flange, pointing down."""


def is_floating(table: ArmTable) -> bool:
    """Whether the table's arm is none, a floating wrist."""
    return table.kind == FLOATING


def serial_model(table: ArmTable) -> ArmModel | None:
    """The model of a serial arm; None of the PUMA 560 and of a floating wrist. Raises ArmError for
    an arm that cannot be used."""
    if table.kind in (PUMA560, FLOATING):
        return None
    # What reads files of arms is imported for other arms alone.
    from warpgrasp.arms.arm_file import arm_from_file, arm_named

    if not table.kind.endswith(".toml"):
        return arm_named(table.kind)
    try:
        changed = Path(table.kind).stat()
    except OSError:
        return arm_from_file(Path(table.kind))  # which says what is wrong
    return _arm_of_file(table.kind, changed.st_mtime_ns, changed.st_size)


@lru_cache(maxsize=16)
def _arm_of_file(file: str, changed_ns: int, size: int) -> ArmModel:
    """The arm of a file; `changed_ns` and `size` only tell versions of the file apart."""
    from warpgrasp.arms.arm_file import arm_from_file

    return arm_from_file(Path(file))


def arm_of(table: ArmTable, mount_length_m: float) -> Arm:
    """The kernels' arm. Raises ValueError for a table the closed-form inverse does not cover and a
    floating wrist's box that is none, ArmError for an arm that cannot be used."""
    model = serial_model(table)
    if model is None and not is_floating(table):
        return puma_arm(table, mount_length_m)
    arm = Arm()
    arm.mount, arm.repeatability = mount_length_m, table.repeatability_m
    if model is not None:
        arm.serial = serial_of(model)
        arm.speed = vec7(*padded([joint.speed_rad_s for joint in model.joints])
                         + np.where(padded(np.ones(len(model.joints))) > 0.0, 0.0, 1.0))
        arm.encoder_step = table.encoder_step_rad
        return arm
    if wrong := order_misfit(table.box_low_m, table.box_high_m,
                             "box_low_mm should be below box_high_mm"):
        raise ValueError(wrong)
    arm.floating = 1
    arm.low = vec7(*padded([*table.box_low_m, *[-np.inf] * 3]))
    arm.high = vec7(*padded([*table.box_high_m, *[np.inf] * 3]))
    arm.speed = vec7(*[table.wrist_speed_m_s] * 3, *[table.wrist_turn_rad_s] * 3, 1.0)
    return arm


def arm_home(table: ArmTable) -> np.ndarray:
    """The joints where an episode starts, (joint,). Raises ValueError where limits exclude it."""
    model = serial_model(table)
    if model is not None:
        return np.array(model.home_rad)
    if not is_floating(table):
        if wrong := home_misfit(table):
            raise ValueError(wrong)
        return np.array(HOME_RAD)
    home = np.array(_FLOATING_HOME)
    home[:3] = np.clip(home[:3], table.box_low_m, table.box_high_m)
    return home


def arm_flanges(table: ArmTable, q: np.ndarray, *, device: str = "cpu") -> np.ndarray:
    """Flange poses (x, y, z [m], quaternion xyzw), (pose, 7), of joints (pose, joint)."""
    model = serial_model(table)
    if model is not None:
        return flange_poses(model, q, device=device)
    if not is_floating(table):
        return puma_forward_batch(table, q, device=device)
    return np.concatenate([q[:, :3], Rotation.from_rotvec(q[:, 3:6]).as_quat()], axis=1)


def floating_joints(flange: np.ndarray) -> np.ndarray:
    """The six numbers (pose, 6) of a floating wrist at flange poses (pose, 7)."""
    return np.concatenate([flange[:, :3], Rotation.from_quat(flange[:, 3:]).as_rotvec()], axis=1)
