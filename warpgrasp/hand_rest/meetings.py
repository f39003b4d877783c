# type: ignore  # Warp functions, which type checkers cannot follow
"""Where links of a Utah-MIT hand touch one another or the palm, or are near."""

from typing import Any

import warp as wp

from warpgrasp.core.dtypes import HALF, ZERO, mat44, real, struct, transform, vec4
from warpgrasp.geometry.segment_pair import segment_pair
from warpgrasp.hand_rest.link_gap import above_palm, link_end, links_within, palm_capsule
from warpgrasp.mechanism.utah_mit_hand_kernel import (
    Hand,
    finger_base,
    finger_jacobian,
    finger_pose,
    link_start,
)

MEETINGS = 8
"""Places where links of a hand touch one another that are resolved; there are hardly three."""
PALM = wp.constant(-1)
"""In the place of a meeting's second finger."""
_MEETINGS = wp.constant(MEETINGS)
_PALM_BIT = wp.constant(4)
_NEAR = wp.constant(real(2e-3))  # [m]: links nearer than this may meet in a step


@struct
class Meeting:
    """Two links that touch or are near: how deep [m], and how their distance changes with the
    joints of each finger [m/rad]; `two` is `PALM` for the palm."""

    one: int
    two: int
    depth: real
    by_one: vec4
    by_two: vec4
    give_one: vec4
    """How far a newton between them turns the joints of each [rad/N]."""
    give_two: vec4


@struct
class HandBuild:
    """What else decides where links meet: from the flange to the hand's frame [m], and a bit for
    each pair of fingers that may meet (`pair_bit`)."""

    mount: real
    pairs: int


@wp.func
def pair_bit(one: int, two: int):
    """The bit of a pair of fingers, `one` < `two`, or of a finger and the palm, `two` 4."""
    return 1 << (5 * one + two)


@wp.func
def in_pairs(pairs: int, finger: int):
    """Whether a finger is one of any pair."""
    mine = pairs & (31 << (5 * finger))
    for one in range(finger):
        mine = mine | (pairs & pair_bit(one, finger))
    return mine != 0


@wp.func
def fingers_met(met: Any):
    """A bit for each finger of a meeting."""
    if met.two == PALM:
        return 1 << met.one
    return (1 << met.one) | (1 << met.two)


@wp.func
def _note(
    meetings: wp.array2d[Meeting], i: int, count: int, one: int, two: int, depth: real,
    by_one: vec4, by_two: vec4
):
    if count < _MEETINGS:
        meetings[i, count].one = one
        meetings[i, count].two = two
        meetings[i, count].depth = depth
        meetings[i, count].by_one = by_one
        meetings[i, count].by_two = by_two
        return count + 1
    return count


@wp.func(inline=False)
def find_meetings(
    hands: wp.array2d[Hand], own: int, build: HandBuild, q: mat44, meetings: wp.array2d[Meeting],
    i: int
):
    """Notes the pairs of links that touch or are near, in row `i`; returns their number."""
    pairs = build.pairs
    count = int(0)
    for one in range(4):
        if (pairs & (31 << (5 * one))) == 0:
            continue
        hand = hands[own, one]
        f = finger_pose(hand, finger_base(hand, one), q[one])
        for two in range(one + 1, 4):
            if (pairs & pair_bit(one, two)) == 0:
                continue
            other = hands[own, two]
            g = finger_pose(other, finger_base(other, two), q[two])
            both = hand.link_radius + other.link_radius
            for a in range(3):
                for b in range(3):
                    if not links_within(hand, f, a, other, g, b, _NEAR):
                        continue
                    near = segment_pair(link_start(f, a), link_end(f, a), link_start(g, b),
                                        link_end(g, b))
                    if near.apart < both + _NEAR:
                        count = _note(meetings, i, count, one, two, both - near.apart,
                                      finger_jacobian(f, a, near.one, near.way),
                                      finger_jacobian(g, b, near.two, -near.way))
        if (pairs & pair_bit(one, _PALM_BIT)) == 0:
            continue
        thick = hand.palm_thickness * HALF
        for a in range(1, 3):
            if above_palm(hand, f, a, _NEAR):
                continue
            for bar in range(4):
                near = segment_pair(
                    link_start(f, a), link_end(f, a), palm_capsule(hand, build.mount, bar, 0),
                    palm_capsule(hand, build.mount, bar, 1))
                if near.apart < hand.link_radius + thick + _NEAR:
                    count = _note(meetings, i, count, one, PALM,
                                  hand.link_radius + thick - near.apart,
                                  finger_jacobian(f, a, near.one, near.way),
                                  vec4(ZERO, ZERO, ZERO, ZERO))
    return count


@wp.func
def takes_part(build: HandBuild, finger: int):
    """Whether a finger may meet any other, or the palm."""
    return in_pairs(build.pairs, finger)


@wp.func
def base_of(hand: Hand, pose: transform, finger: int):
    """Where the base of a finger is that its kinematics start from; `pose` is the hand's."""
    return wp.transform_multiply(pose, finger_base(hand, finger))


@wp.func
def servo_torques(hand: Hand, turn: vec4):
    """Torques of servos that are off by a turn [N m]."""
    return turn * hand.stiffness
