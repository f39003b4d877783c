"""The kernels of closings of chains, as one of Warp's modules: see `closing.closing_kernels`."""

import warp as wp

from warpgrasp.chain_closing.chain_closing_kernel import chain_closing_kernel
from warpgrasp.chain_closing.chain_estimate_kernel import chain_estimate_kernel
from warpgrasp.chain_closing.chain_meeting_kernel import chain_meeting_kernel
from warpgrasp.chain_closing.chain_near_kernel import chain_near_kernel, path_gap_kernel
from warpgrasp.chain_closing.chain_readout import chain_reading_kernel
from warpgrasp.hand_rest.chain_press_kernel import chain_press_kernel

__all__ = ["chain_closing_kernel", "chain_estimate_kernel", "chain_meeting_kernel",
           "chain_near_kernel", "chain_press_kernel", "chain_reading_kernel", "path_gap_kernel"]
wp.set_module_options({"max_unroll": 1})
