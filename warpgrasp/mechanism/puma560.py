"""PUMA 560: forward kinematics, the eight closed-form inverse solutions, and moves between poses.

Standard Denavit-Hartenberg frames. The inverse follows Paul and Zhang 1986, "Computationally
efficient kinematics for manipulators with spherical wrists".
"""

import numpy as np
import warp as wp

from warpgrasp.arms.serial_arm import padded
from warpgrasp.core.array_checks import check_array
from warpgrasp.core.dtypes import transform, vec7
from warpgrasp.core.kernel_launch import array_of, launch
from warpgrasp.mechanism.puma560_kernel import (
    Arm,
    _forward_kernel,
    _inverse_kernel,
    _reachable_kernel,
)
from warpgrasp.parameters import ArmTable

HOME_RAD = tuple(np.radians((19.5, 28.8, -200.0, 0.0, -8.8, -160.5)))
"""Where an episode starts: the hand some 0.35 m above the table, pointing down."""
ALPHA_RAD = (np.pi / 2, 0.0, -np.pi / 2, np.pi / 2, -np.pi / 2, 0.0)


def puma_misfit(table: ArmTable) -> str:
    """Why the closed-form inverse does not cover a table; empty where it does."""
    d, a = table.d_m, table.a_m
    if d[1] or d[4] or d[5] or a[0] or any(a[3:]):
        return ("the closed-form inverse wants d2 = d5 = d6 = a1 = a4 = a5 = a6 = 0 (of six each); "
                "the length of a tool is hand.mount_length_mm")
    return ""


def home_misfit(table: ArmTable) -> str:
    """Why the arm cannot start at `HOME_RAD`; empty where it can."""
    for joint, (low, home, high) in enumerate(zip(
            table.limit_low_rad, HOME_RAD, table.limit_high_rad, strict=True)):
        if not low <= home <= high:
            return (f"joint {joint + 1} is limited to {np.degrees(low):g} to {np.degrees(high):g} "
                    f"deg; should include {np.degrees(home):g}, where episodes start")
    return ""


def puma_arm(table: ArmTable, mount_length_m: float) -> Arm:
    """The kernels' arm. Raises ValueError with what `puma_misfit` says."""
    if wrong := puma_misfit(table):
        raise ValueError(wrong)
    d, a = table.d_m, table.a_m
    arm = Arm()
    arm.d1, arm.d3, arm.d4, arm.a2, arm.a3 = d[0], d[2], d[3], a[1], a[2]
    arm.low, arm.high = vec7(*padded(table.limit_low_rad)), vec7(*padded(table.limit_high_rad))
    arm.speed = vec7(*table.speed_rad_s, 1.0)
    arm.mount = mount_length_m
    arm.encoder_step, arm.repeatability = table.encoder_step_rad, table.repeatability_m
    return arm


def puma_forward_batch(table: ArmTable, q_rad: np.ndarray, *, device: str = "cpu") -> np.ndarray:
    """Flange poses (x, y, z [m], quaternion xyzw), shape (pose, 7), of joints (pose, 6) [rad].
    Raises TypeError and ValueError for other arrays."""
    check_array("q_rad", q_rad, "numbers", "pose 6")
    out = wp.empty(len(q_rad), dtype=transform, device=device)
    launch(_forward_kernel, {"pose": len(q_rad)}, {"q": "pose", "flange": "pose"},
           {"arm": puma_arm(table, 0.0), "q": array_of(padded(q_rad), vec7, device),
            "flange": out}, device=device)
    return out.numpy().copy()


def puma_inverse_batch(table: ArmTable, flange: np.ndarray, *, device: str = "cpu") -> np.ndarray:
    """All eight branches [rad], shape (pose, 8, 6), of flange poses (pose, 7); NaN out of reach.

    Branch bits: 1 lefty, 2 elbow, 4 wrist flip. Limits are not applied. Raises TypeError and
    ValueError for other arrays.
    """
    check_array("flange", flange, "numbers", "pose 7")
    out = wp.empty((len(flange), 8), dtype=vec7, device=device)  # pyright: ignore[reportArgumentType]
    launch(_inverse_kernel, {"pose": len(flange), "branch": 8},
           {"flange": "pose", "q": "pose branch"},
           {"arm": puma_arm(table, 0.0), "flange": array_of(flange, transform, device),
            "q": out}, device=device)
    return out.numpy()[..., :6].copy()


def puma_reachable_batch(table: ArmTable, flange: np.ndarray, *, device: str = "cpu") -> np.ndarray:
    """Whether some branch takes the flange to poses (pose, 7) with all joints inside their limits,
    bool (pose,). Raises TypeError and ValueError for other arrays."""
    check_array("flange", flange, "numbers", "pose 7")
    out = wp.empty(len(flange), dtype=wp.bool, device=device)  # pyright: ignore[reportArgumentType]
    launch(_reachable_kernel, {"pose": len(flange)}, {"flange": "pose", "reachable": "pose"},
           {"arm": puma_arm(table, 0.0), "flange": array_of(flange, transform, device),
            "reachable": out}, device=device)
    return out.numpy().copy()
