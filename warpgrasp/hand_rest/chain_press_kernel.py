# type: ignore  # Warp functions, which type checkers cannot follow
"""How well pressing on the others, or on the palm, explains where a finger of chains stopped."""

import warp as wp

from warpgrasp.chain.chain_kernel import (
    Chain,
    chain_capsule,
    chain_free_joints,
    chain_jacobian,
    chain_pose,
    link_place,
    vec6,
)
from warpgrasp.core.dtypes import HALF, real, transform, vec3
from warpgrasp.geometry.segment_pair import segment_pair
from warpgrasp.hand_rest.chain_meetings import CapsulePair
from warpgrasp.hand_rest.press_kernel import (
    NO_PRESS,
    PRESS_REACH,
    Doubt,
    press_misfit,
    pushed_turn,
)
from warpgrasp.probe_status import ProbeStatus

_CONTACT = wp.constant(int(ProbeStatus.CONTACT))


@wp.kernel(enable_backward=False, module="warpgrasp.chain_closing.chain_closing_kernels")
def chain_press_kernel(
    first: int,
    # Robot:
    believed: wp.array2d[Chain],
    palm: wp.array2d[vec3],
    pairs: wp.array[CapsulePair],
    doubt: wp.array[Doubt],
    # Closing in:
    hand_pose: wp.array2d[transform],
    status: wp.array4d[int],
    q: wp.array4d[vec6],
    step: wp.array4d[int],
    path: wp.array3d[vec6],
    # Misfit out:
    misfit: wp.array4d[real],
):
    """As `hand_press_kernel`; `doubt` are each finger's."""
    w, p, g, finger = wp.tid()
    w += first
    least = real(NO_PRESS)
    if status[w, p, g, finger] != _CONTACT:
        misfit[w, p, g, finger] = least
        return
    frame = wp.transform_identity(dtype=wp.float64)
    s = step[w, p, g, finger]
    hand = believed[0, finger]
    own = doubt[finger]
    free = chain_free_joints(hand, hand_pose[w, p], path[g, finger, s])
    turned = q[w, p, g, finger] - free
    f = chain_pose(hand, frame, q[w, p, g, finger])
    for other in range(-1, believed.shape[1]):
        if other == finger:
            continue
        from_hand = believed[0, wp.max(other, 0)]
        from_doubt = doubt[wp.max(other, 0)]
        there = vec6()
        angle = from_doubt.zero
        if other >= 0 and step[w, p, g, other] > s:
            there = chain_free_joints(from_hand, hand_pose[w, p], path[g, other, s])
        elif other >= 0:
            there = q[w, p, g, other]
            angle += from_doubt.reading
        o = chain_pose(from_hand, frame, there)
        for k in range(pairs.shape[0]):
            pair = pairs[k]
            number = pair.capsule
            second = pair.other
            if pair.two == finger and pair.one == other:
                number = pair.other
                second = pair.capsule
            elif pair.one != finger or pair.two != other:
                continue
            mine = chain_capsule(hand, number)
            c = vec3()
            d = vec3()
            joint = int(0)
            if other >= 0:
                theirs = chain_capsule(from_hand, second)
                joint = theirs.joint
                c = link_place(o, joint, theirs.start)
                d = link_place(o, joint, theirs.end)
            else:
                c = palm[second, 0]
                d = palm[second, 1]
            a = link_place(f, mine.joint, mine.start)
            b = link_place(f, mine.joint, mine.end)
            ball = (wp.length(b - a) + wp.length(d - c)) * HALF + pair.both + PRESS_REACH
            if wp.length_sq((a + b - c - d) * HALF) > ball * ball:
                continue
            near = segment_pair(a, b, c, d)
            if near.apart > pair.both + PRESS_REACH:
                continue
            away = chain_jacobian(hand, f, mine.joint, near.one, near.way)
            variance = own.place + own.zero * wp.dot(away, away)
            if other >= 0:
                by = chain_jacobian(from_hand, o, joint, near.two, near.way)
                variance += from_doubt.place + angle * wp.dot(by, by)
            give = pushed_turn(away, hand.stiffness, free, hand.low, hand.high, hand.stop)
            least = wp.min(least, press_misfit(near.apart - wp.dot(away, turned), pair.both,
                                               variance, away, give, turned, own))
    misfit[w, p, g, finger] = least
