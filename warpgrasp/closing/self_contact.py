"""Whether a finger's contact is with the robot itself, by what its own joint angles tell.

A finger that stops at another finger or at the palm feels the same as at an object. It may have
stopped there if pressing on the links that the robot believes explains where it is read, within
what the errors of joint sensors and of calibration leave open: see `hand_rest.press_kernel`.
"""

import numpy as np
import warp as wp

from warpgrasp.closing.closing import Closing
from warpgrasp.closing.closing_kernels import hand_press_kernel
from warpgrasp.core.array_checks import check_range
from warpgrasp.core.dtypes import real, vec4
from warpgrasp.core.kernel_launch import array_of, launch, poses_of
from warpgrasp.hand_rest.press_kernel import Doubt
from warpgrasp.mechanism.utah_mit_hand import FINGER_COUNT, hand_of
from warpgrasp.parameters import ContactTable, ErrorTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus

MISFIT = 12.0
"""Squared deviations: a finger that pressing on a link explains worse did not stop there. It leaves
one meeting in some hundred untold: those of the gap and of four joints stay below it with 98 %."""
_TURN_RAD = 0.003
"""What turns a joint beside what is known: links pressed in two places, or that glance [est]."""
_PLACE_M = 3e-4
"""How far skins give [est]."""


def doubt_of(sensors: SensorTable, errors: ErrorTable, length_m: np.ndarray) -> Doubt:
    """What a robot does not know of a finger whose links have these lengths.

    `errors` are standard deviations already scaled. Lengths and bases count as errors of a place in
    every direction, joints by how they move it.
    """
    doubt = Doubt()
    doubt.zero = errors.joint_offset_rad**2 + _TURN_RAD**2
    doubt.reading = sensors.joint_noise_rad**2
    doubt.turn = doubt.reading + _TURN_RAD**2
    stretch = float(((errors.link_length_share * length_m) ** 2).sum())
    doubt.place = errors.finger_base_m**2 + stretch + _PLACE_M**2
    return doubt


def self_contacts(
    closing: Closing, believed_pose: np.ndarray, commands_rad: np.ndarray, hand: HandTable,
    sensors: SensorTable, errors: ErrorTable, *, contact: ContactTable | None = None,
    device: str = "cpu",
) -> np.ndarray:
    """Which fingers, by their joint angles, may have stopped at another finger or the palm.

    `believed_pose` (world, probe, 7) is the nominal hand pose [m, quaternion xyzw], `commands_rad`
    (grasp, finger, step, 4) are those of the closing, and `contact` is what acts on the fingers.
    Returns bool (world, probe, grasp, finger). Raises ShapeError where shapes disagree, ValueError
    for steps that the commands have not, and for the pose of a contact that is no place and unit
    quaternion.
    """
    check_range("closing.step", closing.step, -1, np.shape(commands_rad)[2] - 1)
    dims = closing.status.shape
    misfit = wp.empty(dims, dtype=real, device=device)
    each = "world probe grasp finger"
    launch(hand_press_kernel, dict(zip(each.split(), dims, strict=True)), {
        "hand_pose": "world probe", "status": each, "q": each, "step": each,
        "commands": "grasp 4 step 4", "misfit": each}, {
        "hand": hand_of(hand, contact), "mount": hand.mount_length_m,
        "doubt": doubt_of(sensors, errors, np.array(hand.link_length_m)),
        "hand_pose": poses_of(
            "believed_pose", believed_pose, device,
            (closing.status == ProbeStatus.CONTACT).any((-1, -2))),
        "status": array_of(closing.status, int, device),
        "q": array_of(closing.q_rad, vec4, device), "step": array_of(closing.step, int, device),
        "commands": wp.array(commands_rad, dtype=real, device=device), "misfit": misfit},
        device=device, heavy=True)
    assert dims[-1] == FINGER_COUNT
    return np.asarray(misfit.numpy() < MISFIT)
