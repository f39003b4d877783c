"""The kernels of closings with friction, as one of Warp's modules.

Warp compiles a module as a whole, and a function that its kernels share once. The files of these
kernels name this one as their module; hosts take them from here, where all of them are known.
"""

import warp as wp

from warpgrasp.closing.contact_estimate_kernel import estimate_kernel
from warpgrasp.closing.friction_kernel import friction_kernel
from warpgrasp.closing.meeting_kernel import meeting_kernel
from warpgrasp.closing.near_kernel import near_kernel
from warpgrasp.closing.readout import reading_kernel
from warpgrasp.hand_rest.hand_press_kernel import hand_press_kernel

__all__ = ["estimate_kernel", "friction_kernel", "hand_press_kernel", "meeting_kernel",
           "near_kernel", "reading_kernel"]
wp.set_module_options({"max_unroll": 1})
