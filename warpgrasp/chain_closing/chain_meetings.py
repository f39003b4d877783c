# type: ignore  # Warp functions, which type checkers cannot follow
"""Where capsules of a hand of chains touch one another or the palm, or are near.

Two skins give in series, and do not rub. Pairs that the hand's build keeps close are no pairs: the
first links of fingers and the palm, and what is as near in the open hand (`barred`).
"""

import warp as wp

from warpgrasp.chain.chain_kernel import (
    CAPSULES,
    Chain,
    chain_capsule,
    chain_jacobian,
    chain_pose,
    link_place,
    vec6,
)
from warpgrasp.core.dtypes import HALF, real, struct, vec3
from warpgrasp.geometry.segment_pair import segment_pair

FINGERS = 5
"""Fingers of a hand at most."""
MEETINGS = 8
"""Places where links of a hand touch that are resolved."""
_CAPSULES = wp.constant(CAPSULES)
_MEETINGS = wp.constant(MEETINGS)
_FAR = wp.constant(real(1.0))  # [m]
hand_angles = wp.types.matrix(shape=(FINGERS, 6), dtype=real)


@struct
class ChainMeeting:
    """Two capsules that touch or are near: how deep [m], and how their distance changes with the
    drives of each finger [m/rad]; `two` is -1 for the palm."""

    one: int
    two: int
    depth: real
    by_one: vec6
    by_two: vec6
    give_one: vec6
    """How far a newton between them turns the drives of each [rad/N]."""
    give_two: vec6


@wp.func
def angles_of(q: hand_angles, finger: int):
    """The drives of a finger."""
    own = vec6()
    for d in range(6):
        own[d] = q[finger, d]
    return own


@wp.func
def place_capsules(
    hands: wp.array2d[Chain], own: int, q: hand_angles, ends: wp.array3d[vec3], i: int
):
    """Notes both ends of every capsule in the hand's frame, in row `i` of `ends`."""
    still = wp.transform_identity(dtype=wp.float64)
    for f in range(hands.shape[1]):
        hand = hands[own, f]
        pose = chain_pose(hand, still, angles_of(q, f))
        for c in range(hand.capsule_count):
            capsule = chain_capsule(hand, c)
            ends[i, f * _CAPSULES + c, 0] = link_place(pose, capsule.joint, capsule.start)
            ends[i, f * _CAPSULES + c, 1] = link_place(pose, capsule.joint, capsule.end)


@wp.func
def _within(a: vec3, b: vec3, c: vec3, d: vec3, reach: real):
    """Whether two segments may be nearer than `reach`: by balls around them."""
    apart = wp.length((a + b - c - d) * HALF)
    return apart < reach + (wp.length(b - a) + wp.length(d - c)) * HALF


@wp.func
def hand_gap(
    hands: wp.array2d[Chain], own: int, one: int, two: int, palm: wp.array2d[vec3],
    palm_radius: wp.array[real], barred: wp.array2d[wp.bool], ends: wp.array3d[vec3], i: int
):
    """Least distance between the skins of two fingers [m], of a finger and the palm with `two` -1;
    at most a metre."""
    least = real(_FAR)
    for c in range(hands[own, one].capsule_count):
        row = one * _CAPSULES + c
        a = ends[i, row, 0]
        b = ends[i, row, 1]
        radius = chain_capsule(hands[own, one], c).radius
        if two < 0:
            for bar in range(palm.shape[0]):
                if not barred[row, hands.shape[1] * _CAPSULES + bar] and _within(
                        a, b, palm[bar, 0], palm[bar, 1], least + radius + palm_radius[bar]):
                    near = segment_pair(a, b, palm[bar, 0], palm[bar, 1])
                    least = wp.min(least, near.apart - radius - palm_radius[bar])
        else:
            for d in range(hands[own, two].capsule_count):
                other = two * _CAPSULES + d
                both = radius + chain_capsule(hands[own, two], d).radius
                if not barred[row, other] and _within(a, b, ends[i, other, 0], ends[i, other, 1],
                                                      least + both):
                    near = segment_pair(a, b, ends[i, other, 0], ends[i, other, 1])
                    least = wp.min(least, near.apart - both)
    return least


@wp.func
def _note(
    meetings: wp.array2d[ChainMeeting], i: int, count: int, one: int, two: int, depth: real,
    by_one: vec6, by_two: vec6
):
    """Notes a meeting; where there is no room, in place of the shallowest if it is deeper."""
    at = int(count)
    if count >= _MEETINGS:
        at = int(0)
        for k in range(1, _MEETINGS):
            if meetings[i, k].depth < meetings[i, at].depth:
                at = int(k)
        if depth <= meetings[i, at].depth:
            return count
    meetings[i, at].one = one
    meetings[i, at].two = two
    meetings[i, at].depth = depth
    meetings[i, at].by_one = by_one
    meetings[i, at].by_two = by_two
    return wp.min(count + 1, _MEETINGS)


@wp.func
def find_chain_meetings(
    hands: wp.array2d[Chain], own: int, q: hand_angles, palm: wp.array2d[vec3],
    palm_radius: wp.array[real], barred: wp.array2d[wp.bool], near_m: real,
    ends: wp.array3d[vec3], meetings: wp.array2d[ChainMeeting], i: int
):
    """Notes the pairs of capsules that touch or are nearer than `near_m`, in row `i`; returns their
    number."""
    place_capsules(hands, own, q, ends, i)
    still = wp.transform_identity(dtype=wp.float64)
    count = int(0)
    for one in range(hands.shape[1]):
        hand = hands[own, one]
        f = chain_pose(hand, still, angles_of(q, one))
        for c in range(hand.capsule_count):
            row = one * _CAPSULES + c
            capsule = chain_capsule(hand, c)
            a = ends[i, row, 0]
            b = ends[i, row, 1]
            for bar in range(palm.shape[0]):
                both = capsule.radius + palm_radius[bar]
                if not barred[row, hands.shape[1] * _CAPSULES + bar] and _within(
                        a, b, palm[bar, 0], palm[bar, 1], both + near_m):
                    near = segment_pair(a, b, palm[bar, 0], palm[bar, 1])
                    if near.apart < both + near_m:
                        count = _note(meetings, i, count, one, -1, both - near.apart,
                                      chain_jacobian(hand, f, capsule.joint, near.one, near.way),
                                      vec6())
            for two in range(one + 1, hands.shape[1]):
                other = hands[own, two]
                for d in range(other.capsule_count):
                    there = two * _CAPSULES + d
                    both = capsule.radius + chain_capsule(other, d).radius
                    if not barred[row, there] and _within(
                            a, b, ends[i, there, 0], ends[i, there, 1], both + near_m):
                        near = segment_pair(a, b, ends[i, there, 0], ends[i, there, 1])
                        if near.apart < both + near_m:
                            g = chain_pose(other, still, angles_of(q, two))
                            count = _note(
                                meetings, i, count, one, two, both - near.apart,
                                chain_jacobian(hand, f, capsule.joint, near.one, near.way),
                                chain_jacobian(other, g, chain_capsule(other, d).joint, near.two,
                                               -near.way))
    return count
