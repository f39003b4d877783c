# type: ignore  # Warp functions, which type checkers cannot follow
"""How far a hand's links are from one another and from its palm: capsules against capsules."""

import warp as wp

from warpgrasp.core.dtypes import HALF, ZERO, real, vec3
from warpgrasp.geometry.segment_pair import segment_pair
from warpgrasp.mechanism.utah_mit_hand_kernel import FingerPose, Hand, link_start

_FAR = wp.constant(real(1.0))  # [m]


@wp.func
def link_end(f: FingerPose, link: int):
    """Where a link ends."""
    if link == 0:
        return f.p2
    if link == 1:
        return f.p3
    return f.p4


@wp.func
def _within(middles: vec3, reach: real):
    return wp.dot(middles, middles) < reach * reach


@wp.func
def links_within(hand: Hand, f: FingerPose, a: int, other: Hand, g: FingerPose, b: int, gap: real):
    """Whether the skins of two links may be nearer than `gap` [m]: by balls around them."""
    middles = (link_start(f, a) + link_end(f, a) - link_start(g, b) - link_end(g, b)) * HALF
    return _within(middles, (hand.link_length[a] + other.link_length[b]) * HALF
                   + hand.link_radius + other.link_radius + gap)


@wp.func
def above_palm(hand: Hand, f: FingerPose, link: int, gap: real):
    """Whether a link's skin is farther than `gap` [m] above the plane that the palm is under; `f`
    in the hand's frame."""
    low = wp.min(link_start(f, link)[2], link_end(f, link)[2])
    return low > hand.link_radius + gap


@wp.func
def palm_capsule(hand: Hand, mount: real, number: int, end: int):
    """An end of one of the capsules of palm and wrist, hand frame; see `palm_clearance`."""
    thick = hand.palm_thickness * HALF
    if number == 3:
        return vec3(ZERO, ZERO, wp.where(end == 0, -wp.max(mount, thick + real(1e-3)), -thick))
    side = wp.where(end == 0, -hand.spacing, hand.spacing)
    return vec3(hand.gap * HALF * real(number - 1), side, -thick)


@wp.func
def finger_gap(hand: Hand, f: FingerPose, other: Hand, g: FingerPose):
    """Least distance between the skins of two fingers [m], at most a metre."""
    least = real(_FAR)
    for inward in range(9):  # the outermost links first: the others are then mostly farther
        a = 2 - inward // 3
        b = 2 - inward % 3
        if links_within(hand, f, a, other, g, b, least):
            near = segment_pair(link_start(f, a), link_end(f, a), link_start(g, b), link_end(g, b))
            least = wp.min(least, near.apart - hand.link_radius - other.link_radius)
    return least


@wp.func
def palm_gap(hand: Hand, mount: real, f: FingerPose):
    """Least distance between the skin of a finger's outer two links and palm or wrist [m], at most
    a metre; `f` in the hand's frame."""
    least = real(_FAR)
    for bar in range(4):
        start = palm_capsule(hand, mount, bar, 0)
        end = palm_capsule(hand, mount, bar, 1)
        for a in range(1, 3):
            near = segment_pair(link_start(f, a), link_end(f, a), start, end)
            least = wp.min(least, near.apart)
    return least - hand.link_radius - hand.palm_thickness * HALF
