# type: ignore  # Warp functions, which type checkers cannot follow
"""How far a hand's links are from one another and from its palm: capsules against capsules."""

import warp as wp

from warpgrasp.core.dtypes import HALF, ZERO, real, transform, vec3
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
def palm_capsule(hand: Hand, mount: real, number: int, end: int):
    """An end of one of the capsules of palm and wrist, hand frame; see `palm_clearance`."""
    thick = hand.palm_thickness * HALF
    if number == 3:
        return vec3(ZERO, ZERO, wp.where(end == 0, -wp.max(mount, thick + real(1e-3)), -thick))
    side = wp.where(end == 0, -hand.spacing, hand.spacing)
    return vec3(hand.gap * HALF * real(number - 1), side, -thick)


@wp.func
def finger_gap(f: FingerPose, radius: real, g: FingerPose, other_radius: real):
    """Least distance between the skins of two fingers [m], at most a metre."""
    least = real(_FAR)
    for a in range(3):
        for b in range(3):
            near = segment_pair(link_start(f, a), link_end(f, a), link_start(g, b), link_end(g, b))
            least = wp.min(least, near.apart)
    return least - radius - other_radius


@wp.func
def palm_gap(hand: Hand, mount: real, pose: transform, f: FingerPose):
    """Least distance between the skin of a finger's outer two links and palm or wrist [m], at most
    a metre; `pose` is the hand's in the frame of `f`."""
    least = real(_FAR)
    for bar in range(4):
        start = wp.transform_point(pose, palm_capsule(hand, mount, bar, 0))
        end = wp.transform_point(pose, palm_capsule(hand, mount, bar, 1))
        for a in range(1, 3):
            near = segment_pair(link_start(f, a), link_end(f, a), start, end)
            least = wp.min(least, near.apart)
    return least - hand.link_radius - hand.palm_thickness * HALF
