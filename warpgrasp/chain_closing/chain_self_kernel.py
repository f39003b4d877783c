# type: ignore  # Warp functions, which type checkers cannot follow
"""How near a finger of a hand of chains is to the others and to the palm, in a kernel."""

import warp as wp

from warpgrasp.chain.chain_kernel import Chain, vec6
from warpgrasp.core.dtypes import real, vec3, vec4
from warpgrasp.hand_rest.chain_meetings import (
    CapsulePair,
    ChainBuild,
    pair_gap,
    place_finger,
)

wp.set_module_options({"max_unroll": 1})
_FAR = wp.constant(real(1.0))  # [m]


@wp.kernel(enable_backward=False)
def chain_self_gap_kernel(
    first: int,
    # Robot:
    believed: wp.array2d[Chain],
    palm: wp.array2d[vec3],
    palm_balls: wp.array[vec4],
    pairs: wp.array[CapsulePair],
    # Drives in, a row a hand:
    q: wp.array2d[vec6],
    step: wp.array2d[int],
    grasp: wp.array[int],
    path: wp.array3d[vec6],
    # Scratch:
    ends: wp.array3d[vec3],
    balls: wp.array2d[vec4],
    # Gap out:
    gap: wp.array2d[real],
):
    """The least gap between the skins of a finger and of the others and the palm [m], at most a
    metre: when the finger stopped, where others that had not were commanded."""
    i = wp.tid() + first
    fingers = believed.shape[1]
    build = ChainBuild()
    build.palm = palm
    build.palm_balls = palm_balls
    build.pairs = pairs
    build.ends = ends
    build.balls = balls
    for f in range(fingers):
        least = real(_FAR)
        if wp.isfinite(q[i, f][0]):
            for other in range(fingers):
                there = q[i, other]
                if step[i, other] > step[i, f] or not wp.isfinite(there[0]):
                    there = path[grasp[i], other, wp.max(step[i, f], 0)]
                place_finger(believed[0, other], there, ends, balls, i, other)
            for k in range(pairs.shape[0]):
                if pairs[k].one == f or pairs[k].two == f:
                    least = wp.min(least, pair_gap(build, pairs[k], i, least))
        gap[i, f] = least
