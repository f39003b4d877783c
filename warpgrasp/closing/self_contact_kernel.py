# type: ignore  # Warp functions, which type checkers cannot follow
"""How near a finger is to the others and to the palm, in a kernel."""

import warp as wp

from warpgrasp.core.dtypes import real, vec4
from warpgrasp.hand_rest.link_gap import finger_gap, palm_gap
from warpgrasp.mechanism.utah_mit_hand_kernel import (
    FingerPose,
    Hand,
    finger_base,
    finger_pose,
)

_FAR = wp.constant(real(1.0))  # [m]


@wp.func
def _beside(f: FingerPose, g: FingerPose, reach: real):
    """Whether the chains of two fingers overlap along y when wider by `reach`."""
    low = wp.min(wp.min(f.p1[1], f.p2[1]), wp.min(f.p3[1], f.p4[1]))
    high = wp.max(wp.max(f.p1[1], f.p2[1]), wp.max(f.p3[1], f.p4[1]))
    under = wp.min(wp.min(g.p1[1], g.p2[1]), wp.min(g.p3[1], g.p4[1]))
    over = wp.max(wp.max(g.p1[1], g.p2[1]), wp.max(g.p3[1], g.p4[1]))
    return low - reach < over and under < high + reach


@wp.kernel(enable_backward=False, module="warpgrasp.closing.closing_kernels")
def self_gap_kernel(
    first: int,
    # Robot:
    hand: Hand,
    mount: real,
    # Joints in:
    q: wp.array4d[vec4],
    step: wp.array4d[int],
    commands: wp.array4d[real],
    # Gap out:
    gap: wp.array4d[real],
):
    """The least gap between the skins of a finger and of the others and the palm [m], 1 where it is
    more than a link's width: when the finger stopped, where others that had not were commanded."""
    w, p, g, finger = wp.tid()
    w += first
    least = real(_FAR)
    if not wp.isfinite(q[w, p, g, finger][0]):
        gap[w, p, g, finger] = least
        return
    both = hand.link_radius * real(2.0)
    f = finger_pose(hand, finger_base(hand, finger), q[w, p, g, finger])
    for other in range(4):
        if other != finger and wp.isfinite(q[w, p, g, other][0]):
            there = q[w, p, g, other]
            s = step[w, p, g, finger]
            if step[w, p, g, other] > s:
                there = vec4(commands[g, other, s, 0], commands[g, other, s, 1],
                             commands[g, other, s, 2], commands[g, other, s, 3])
            o = finger_pose(hand, finger_base(hand, other), there)
            if _beside(f, o, both * real(2.0)):
                least = wp.min(least, finger_gap(hand, f, hand, o))
    if wp.min(f.p3[2], f.p4[2]) < both:
        least = wp.min(least, palm_gap(hand, mount, f))
    gap[w, p, g, finger] = least
