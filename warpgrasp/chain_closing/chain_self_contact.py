"""Whether a finger's contact is with the robot itself, by its own angles, for hands of chains.

As `closing.self_contact`: links that the robot believes to touch one another, or nearly.
"""

import numpy as np
import warp as wp

from warpgrasp.chain.chain_hand import ChainHand, true_chains
from warpgrasp.chain.chain_kernel import CAPSULES, vec6
from warpgrasp.chain_closing.chain_closing_kernels import chain_self_gap_kernel
from warpgrasp.chain_closing.chain_meeting import CLOSE_M, pairs_on_device
from warpgrasp.chain_closing.chain_path import padded
from warpgrasp.closing.closing import Closing
from warpgrasp.core.dtypes import real, vec3, vec4
from warpgrasp.core.kernel_launch import launch
from warpgrasp.mechanism.calibration import no_errors
from warpgrasp.parameters import ContactTable, ErrorTable, HandTable, SensorTable

_DEVIATIONS = 2.0


def chain_self_contacts(
    closing: Closing, commands_rad: np.ndarray, hand: ChainHand, table: HandTable,
    sensors: SensorTable, errors: ErrorTable, *, device: str = "cpu",
) -> np.ndarray:
    """Which fingers, by their angles, may have stopped at another finger or the palm.

    `commands_rad` (grasp, finger, step, width) are those of the closing. Returns bool (world,
    probe, grasp, finger).
    """
    shape = closing.status.shape
    rows = closing.status[..., 0].size
    # Of links that the open hand has as near nothing can be told.
    margin = chain_self_margin(hand, sensors, errors)
    palm, palm_balls, pairs = pairs_on_device(hand, max(margin, CLOSE_M), device)
    read = closing.q_rad.reshape(rows, hand.fingers, -1).copy()
    # Drives that a finger has not stand at zero; a finger that was not closed is not finite.
    for f, own in enumerate(hand.drives):
        read[:, f, len(own):] = 0.0
    gap = wp.empty((rows, hand.fingers), dtype=real, device=device)
    launch(chain_self_gap_kernel, {"row": rows}, {
        "believed": "1 finger", "palm": "bar 2", "palm_balls": "bar", "pairs": "pair",
        "q": "row finger", "step": "row finger", "grasp": "row", "path": "grasps finger step",
        "ends": "row every 2", "balls": "row every", "gap": "row finger"}, {
        "believed": true_chains(hand, table, ContactTable(), no_errors(hand.fingers, 6, 6),
                                device),
        "palm": palm, "palm_balls": palm_balls, "pairs": pairs,
        "q": wp.array(padded(read), dtype=vec6, device=device),
        "step": wp.array(closing.step.reshape(rows, -1), dtype=int, device=device),
        "grasp": wp.array(np.broadcast_to(np.arange(shape[2]), shape[:3]).ravel(), dtype=int,
                          device=device),
        "path": wp.array(padded(commands_rad), dtype=vec6, device=device),
        "ends": wp.zeros((rows, hand.fingers * CAPSULES, 2), dtype=vec3, device=device),
        "balls": wp.zeros((rows, hand.fingers * CAPSULES), dtype=vec4, device=device),
        "gap": gap}, device=device)
    return np.asarray(gap.numpy().reshape(shape) < margin)


def chain_self_margin(hand: ChainHand, sensors: SensorTable, errors: ErrorTable) -> float:
    """How far apart links that touch may be believed to be [m], two standard deviations; of the
    hand's longest finger."""
    joint = sensors.joint_noise_rad**2 + errors.joint_offset_rad**2
    most = 0.0
    for finger in hand.model.fingers:
        length = np.array([*(np.linalg.norm(j.place[:3]) for j in finger.joints[1:]),
                           np.linalg.norm(finger.tip_m)])
        turned = joint * (length[::-1].cumsum() ** 2).sum()
        most = max(most, float(turned + ((errors.link_length_share * length) ** 2).sum()))
    return _DEVIATIONS * float(np.sqrt(2.0 * (most + errors.finger_base_m**2)))
