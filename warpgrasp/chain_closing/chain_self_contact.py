"""Whether a finger's contact is with the robot itself, by its own angles, for hands of chains.

As `closing.self_contact`: by whether pressing on links that the robot believes explains them.
"""

import numpy as np
import warp as wp

from warpgrasp.chain.chain_hand import ChainHand, padded, true_chains
from warpgrasp.chain.chain_kernel import vec6
from warpgrasp.chain_closing.chain_closing_kernels import chain_press_kernel
from warpgrasp.chain_closing.chain_meeting import CLOSE_M, pairs_on_device
from warpgrasp.chain_closing.chain_path import no_chain_errors
from warpgrasp.closing.closing import Closing
from warpgrasp.closing.self_contact import MISFIT, doubt_of
from warpgrasp.core.array_checks import check_range
from warpgrasp.core.dtypes import real
from warpgrasp.core.kernel_launch import array_of, launch, poses_of
from warpgrasp.hand_rest.press_kernel import Doubt
from warpgrasp.parameters import ContactTable, ErrorTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus


def chain_self_contacts(
    closing: Closing, believed_pose: np.ndarray, commands_rad: np.ndarray, hand: ChainHand,
    table: HandTable, sensors: SensorTable, errors: ErrorTable, *,
    contact: ContactTable | None = None, device: str = "cpu",
) -> np.ndarray:
    """Which fingers, by their angles, may have stopped at another finger or the palm.

    As `self_contacts`, with `hand` in place of the Utah-MIT's; it raises the same errors. Returns
    bool (world, probe, grasp, finger).
    """
    check_range("closing.step", closing.step, -1, np.shape(commands_rad)[2] - 1)
    dims = closing.status.shape
    read = closing.q_rad.copy()
    # Drives that a finger has not stand at zero; a finger that was not closed is not finite.
    for f, own in enumerate(hand.drives):
        read[..., f, len(own):] = 0.0
    palm, _, pairs = pairs_on_device(hand, CLOSE_M, device)
    misfit = wp.empty(dims, dtype=real, device=device)
    each = "world probe grasp finger"
    launch(chain_press_kernel, dict(zip(each.split(), dims, strict=True)), {
        "believed": "1 finger", "palm": "bar 2", "pairs": "pair", "doubt": "finger",
        "hand_pose": "world probe", "status": each, "q": each, "step": each,
        "path": "grasp finger step", "misfit": each}, {
        "believed": true_chains(hand, table, contact or ContactTable(),
                                no_chain_errors(hand), device),
        "palm": palm, "pairs": pairs,
        "doubt": wp.array([doubt_of(sensors, errors, lengths_m(hand, f))
                           for f in range(hand.fingers)], dtype=Doubt, device=device),
        "hand_pose": poses_of(
            "believed_pose", believed_pose, device,
            (closing.status == ProbeStatus.CONTACT).any((-1, -2))),
        "status": array_of(closing.status, int, device),
        "q": array_of(padded(read), vec6, device), "step": array_of(closing.step, int, device),
        "path": array_of(padded(commands_rad), vec6, device), "misfit": misfit}, device=device,
        heavy=True)
    return np.asarray(misfit.numpy() < MISFIT)


def lengths_m(hand: ChainHand, finger: int) -> np.ndarray:
    """Lengths of a finger's links [m]: from joint to joint, and on to its tip."""
    own = hand.model.fingers[finger]
    return np.array([*(np.linalg.norm(joint.place[:3]) for joint in own.joints[1:]),
                     np.linalg.norm(own.tip_m)])
