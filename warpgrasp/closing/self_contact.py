"""Whether a finger's contact is with the robot itself, by what its own joint angles tell.

A finger that stops at another finger or at the palm feels the same as at an object. The links that
the robot believes, at the angles that it has read, then touch one another, or nearly: within what
errors of the joint sensors and of calibration leave open.
"""

import numpy as np
import warp as wp

from warpgrasp.closing.closing import Closing
from warpgrasp.closing.closing_kernels import self_gap_kernel
from warpgrasp.core.dtypes import real, vec4
from warpgrasp.core.kernel_launch import launch
from warpgrasp.mechanism.utah_mit_hand import FINGER_COUNT, hand_of
from warpgrasp.parameters import ErrorTable, HandTable, SensorTable

_DEVIATIONS = 2.0


def self_contacts(
    closing: Closing, commands_rad: np.ndarray, hand: HandTable, sensors: SensorTable,
    errors: ErrorTable, *, device: str = "cpu",
) -> np.ndarray:
    """Which fingers, by their joint angles, may have stopped at another finger or the palm.

    `commands_rad` (grasp, finger, step, 4) are those of the closing. Returns bool (world, probe,
    grasp, finger).
    """
    dims = closing.status.shape
    gap = wp.empty(dims, dtype=real, device=device)
    each = "world probe grasp finger"
    launch(self_gap_kernel, dict(zip(each.split(), dims, strict=True)),
           {"q": each, "step": each, "commands": "grasp 4 step 4", "gap": each}, {
               "hand": hand_of(hand), "mount": hand.mount_length_m, "gap": gap,
               "q": wp.array(np.ascontiguousarray(closing.q_rad), dtype=vec4, device=device),
               "step": wp.array(np.ascontiguousarray(closing.step), dtype=int, device=device),
               "commands": wp.array(commands_rad, dtype=real, device=device)},
           device=device)
    assert dims[-1] == FINGER_COUNT
    return np.asarray(gap.numpy() < self_margin(hand, sensors, errors))


def self_margin(hand: HandTable, sensors: SensorTable, errors: ErrorTable) -> float:
    """How far apart links that touch may be believed to be [m], two standard deviations."""
    length = np.array(hand.link_length_m)
    joint = sensors.joint_noise_rad**2 + errors.joint_offset_rad**2
    turned = joint * (length[::-1].cumsum() ** 2).sum()
    stretched = (errors.link_length_share * length) ** 2
    finger = turned + stretched.sum() + errors.finger_base_m**2
    return _DEVIATIONS * float(np.sqrt(2.0 * finger))
