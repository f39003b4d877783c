"""Whether a finger's contact is with the robot itself, by what its own joint angles tell.

A finger that stops at another finger or at the palm feels the same as at an object. It may have
stopped there if pressing on the links that the robot believes explains where it is read, within
what the errors of joint sensors and of calibration leave open: see `hand_rest.press_kernel`.
"""

import numpy as np
import warp as wp

from warpgrasp.closing.closing import Closing
from warpgrasp.closing.closing_kernels import hand_press_kernel
from warpgrasp.core.dtypes import real, transform, vec4
from warpgrasp.core.kernel_launch import array_of, launch
from warpgrasp.hand_rest.pressing import MISFIT, doubt_of
from warpgrasp.mechanism.utah_mit_hand import FINGER_COUNT, hand_of
from warpgrasp.parameters import ContactTable, ErrorTable, HandTable, SensorTable


def self_contacts(
    closing: Closing, believed_pose: np.ndarray, commands_rad: np.ndarray, hand: HandTable,
    sensors: SensorTable, errors: ErrorTable, *, contact: ContactTable | None = None,
    device: str = "cpu",
) -> np.ndarray:
    """Which fingers, by their joint angles, may have stopped at another finger or the palm.

    `believed_pose` (world, probe, 7) is the nominal hand pose [m, quaternion xyzw], `commands_rad`
    (grasp, finger, step, 4) are those of the closing, and `contact` is what acts on the fingers.
    Returns bool (world, probe, grasp, finger).
    """
    dims = closing.status.shape
    misfit = wp.empty(dims, dtype=real, device=device)
    each = "world probe grasp finger"
    launch(hand_press_kernel, dict(zip(each.split(), dims, strict=True)), {
        "hand_pose": "world probe", "status": each, "q": each, "step": each,
        "commands": "grasp 4 step 4", "misfit": each}, {
        "hand": hand_of(hand, contact), "mount": hand.mount_length_m,
        "doubt": doubt_of(sensors, errors, np.array(hand.link_length_m)),
        "hand_pose": array_of(believed_pose, transform, device),
        "status": array_of(closing.status, int, device),
        "q": array_of(closing.q_rad, vec4, device), "step": array_of(closing.step, int, device),
        "commands": wp.array(commands_rad, dtype=real, device=device), "misfit": misfit},
        device=device)
    assert dims[-1] == FINGER_COUNT
    return np.asarray(misfit.numpy() < MISFIT)
