# type: ignore  # Warp functions, which type checkers cannot follow
"""Where capsules of a hand of chains touch one another or the palm, or are near.

Two skins give in series, and do not rub. Pairs that the hand's build keeps close are no pairs: the
first links of fingers and the palm, and what is as near in the open hand (`chain_meeting.palm_of`).
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
from warpgrasp.core.dtypes import HALF, real, struct, transform, vec3
from warpgrasp.finger.path_record import true_command
from warpgrasp.geometry.segment_pair import segment_pair
from warpgrasp.hand_rest.meetings import (
    MEETINGS,
    base_of,
    find_meetings,
    servo_torques,
    takes_part,
)

FINGERS = 5
"""Fingers of a hand at most."""
_CAPSULES = wp.constant(CAPSULES)
_MEETINGS = wp.constant(MEETINGS)
_FAR = wp.constant(real(1.0))  # [m]
_NEAR = wp.constant(real(2e-3))  # [m]: links nearer than this may meet in a step
hand_angles = wp.types.matrix(shape=(FINGERS, 6), dtype=real)
hand_room = wp.types.vector(length=FINGERS, dtype=real)


@struct
class ChainMeeting:
    """Two capsules that touch or are near: how deep [m], and how their distance changes with the
    drives of each finger [m/rad]; `two` is `PALM` for the palm."""

    one: int
    two: int
    depth: real
    by_one: vec6
    by_two: vec6
    give_one: vec6
    """How far a newton between them turns the drives of each [rad/N]."""
    give_two: vec6


@struct
class CapsulePair:
    """Two capsules that may touch: their fingers, `two` -1 for the palm; their numbers, of a finger
    or of the palm; the sum of their radii [m]."""

    one: int
    two: int
    capsule: int
    other: int
    both: real


@struct
class ChainBuild:
    """What else decides where links meet: the palm's capsules (bar, 2), the pairs, and room for the
    ends of capsules (row, capsule, 2), in the hand's frame [m]."""

    palm: wp.array2d[vec3]
    pairs: wp.array[CapsulePair]
    ends: wp.array3d[vec3]


@wp.func
def takes_part(build: ChainBuild, finger: int):  # noqa: F811 (overloads, from here on)
    """Every finger does."""
    return True


@wp.func
def base_of(hand: Chain, pose: transform, finger: int):  # noqa: F811
    """What the kinematics of a finger start from: the hand's own pose."""
    return pose


@wp.func
def servo_torques(hand: Chain, turn: vec6):  # noqa: F811
    """Torques of servos that are off by a turn [N m]."""
    return wp.cw_mul(turn, hand.stiffness)


@wp.func
def true_command(  # noqa: F811
    hand: Chain, path: wp.array3d[vec6], grasp: int, finger: int, step: int
):
    """The command at which the true drives stand, the errors of their sensors taken off [rad]."""
    return path[grasp, finger, step] - hand.offset


@wp.func
def place_capsules(
    hands: wp.array2d[Chain], own: int, q: hand_angles, ends: wp.array3d[vec3], i: int
):
    """Notes both ends of every capsule in the hand's frame, in row `i` of `ends`."""
    still = wp.transform_identity(dtype=wp.float64)
    for f in range(hands.shape[1]):
        hand = hands[own, f]
        pose = chain_pose(hand, still, q[f])
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
def _pair_end(pair: CapsulePair, palm: wp.array2d[vec3], ends: wp.array3d[vec3], i: int, end: int):
    """An end of a pair's second capsule."""
    if pair.two < 0:
        return palm[pair.other, end]
    return ends[i, pair.two * _CAPSULES + pair.other, end]


@wp.func
def least_gap(build: ChainBuild, i: int, off: hand_room, fingers: int):
    """Least distance between the skins of pairs [m], less what each finger may be `off`; at most a
    metre. Of the pairs of which one is one of `fingers`, a bit each."""
    least = real(_FAR)
    for k in range(build.pairs.shape[0]):
        pair = build.pairs[k]
        own = fingers & (1 << pair.one)
        if pair.two >= 0:
            own = own | (fingers & (1 << pair.two))
        if own != 0:
            reach = pair.both + off[pair.one]
            if pair.two >= 0:
                reach += off[pair.two]
            a = build.ends[i, pair.one * _CAPSULES + pair.capsule, 0]
            b = build.ends[i, pair.one * _CAPSULES + pair.capsule, 1]
            c = _pair_end(pair, build.palm, build.ends, i, 0)
            d = _pair_end(pair, build.palm, build.ends, i, 1)
            if _within(a, b, c, d, least + reach):
                least = wp.min(least, segment_pair(a, b, c, d).apart - reach)
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
def find_meetings(  # noqa: F811
    hands: wp.array2d[Chain], own: int, build: ChainBuild, q: hand_angles,
    meetings: wp.array2d[ChainMeeting], i: int
):
    """Notes the pairs of capsules that touch or are near, in row `i`; returns their number."""
    place_capsules(hands, own, q, build.ends, i)
    still = wp.transform_identity(dtype=wp.float64)
    count = int(0)
    for k in range(build.pairs.shape[0]):
        pair = build.pairs[k]
        a = build.ends[i, pair.one * _CAPSULES + pair.capsule, 0]
        b = build.ends[i, pair.one * _CAPSULES + pair.capsule, 1]
        c = _pair_end(pair, build.palm, build.ends, i, 0)
        d = _pair_end(pair, build.palm, build.ends, i, 1)
        if _within(a, b, c, d, pair.both + _NEAR):
            near = segment_pair(a, b, c, d)
            if near.apart < pair.both + _NEAR:
                hand = hands[own, pair.one]
                by_one = chain_jacobian(
                    hand, chain_pose(hand, still, q[pair.one]),
                    chain_capsule(hand, pair.capsule).joint, near.one, near.way)
                by_two = vec6()
                if pair.two >= 0:
                    other = hands[own, pair.two]
                    by_two = chain_jacobian(
                        other, chain_pose(other, still, q[pair.two]),
                        chain_capsule(other, pair.other).joint, near.two, -near.way)
                count = _note(meetings, i, count, pair.one, pair.two, pair.both - near.apart,
                              by_one, by_two)
    return count
