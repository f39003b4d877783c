"""The approach of an open hand of chains: what `move_hand` asks in place of the Utah-MIT's."""

import numpy as np
import warp as wp

from warpgrasp.chain.chain_clearance_kernel import chain_clearance_kernel
from warpgrasp.chain.chain_hand import ChainHand, padded, true_chains
from warpgrasp.chain.chain_kernel import ChainBar, vec6
from warpgrasp.core.struct_array import record_type
from warpgrasp.mechanism.arm_motion import Clearance, ClearanceKernel
from warpgrasp.mechanism.calibration import Calibration
from warpgrasp.parameters import ContactTable, HandTable


def chain_clearance(
    hand: ChainHand, table: HandTable, contact: ContactTable, errors: Calibration
) -> Clearance:
    """Which approaches are barred to a hand, its fingers at the first commands of a grasp, its palm
    and its wrist as they are."""

    def kernel_of(commands_rad: np.ndarray, device: str) -> ClearanceKernel:
        return chain_clearance_kernel, {
            "hands": "world? finger", "palm": "bar", "path": "grasp finger step"}, {
            "hands": true_chains(hand, table, contact, errors, device),
            "palm": palm_bars(hand, table, device),
            "path": wp.array(padded(commands_rad), dtype=vec6, device=device)}

    return kernel_of


def palm_bars(hand: ChainHand, table: HandTable, device: str) -> wp.array:
    """Palm and wrist as kernels take them, (bar,), see `palm_and_wrist`."""
    ends, radius = palm_and_wrist(hand, table)
    rows = np.zeros(len(ends), record_type(ChainBar))
    rows["start"], rows["end"], rows["radius"] = ends[:, 0], ends[:, 1], radius
    return wp.array(rows, dtype=ChainBar, device=device)


def palm_and_wrist(hand: ChainHand, table: HandTable) -> tuple[np.ndarray, np.ndarray]:
    """Capsules of the palm, then of the wrist, which reaches from the palm's deepest place back to
    the flange: their ends in the hand's frame (bar, 2, 3) and radii (bar,) [m]."""
    bars = [(c.start, c.end, c.radius) for c in hand.palm]
    deepest = min((z for start, end, _ in bars for z in (start[2], end[2])), default=0.0)
    if -table.mount_length_m < deepest:
        bars.append(((0.0, 0.0, -table.mount_length_m), (0.0, 0.0, deepest),
                     table.palm_thickness_m / 2))
    ends = np.array([(start, end) for start, end, _ in bars]).reshape(-1, 2, 3)
    return ends, np.array([r for *_, r in bars])
