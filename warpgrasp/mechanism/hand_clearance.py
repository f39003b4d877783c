# type: ignore  # Warp functions, which type checkers cannot follow
"""How far the open hand is from body and table: fingers as capsules, palm and wrist as capsules."""

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, real, transform, vec3, vec4
from warpgrasp.geometry.scene import Scene, body_table_distance
from warpgrasp.geometry.segment_distance import nearest_along
from warpgrasp.mechanism.utah_mit_hand_kernel import (
    Hand,
    finger_base,
    finger_pose,
    link_direction,
    link_start,
)

_PALM_BARS = wp.constant(3)  # across the palm, side by side: a slab with rounded edges
_FAR = wp.constant(real(1e9))


@wp.func
def segment_clearance(
    scene: Scene, body: int, a: vec3, u: vec3, length: real, radius: real, worst: real
):
    """Clearance of a capsule [m], or `worst` where it certainly is larger than that."""
    bound = body_table_distance(scene, body, a + u * (length * HALF)) - length * HALF - radius
    if bound >= worst:
        return worst
    near = nearest_along(scene, body, a, u, length, worst + radius)
    return wp.min(worst, near[1] - radius)


@wp.func
def finger_clearance(scene: Scene, body: int, hand: Hand, base: transform, q: vec4, worst: real):
    """Least clearance of a finger's links [m], at most `worst`; `base` in the body's frame."""
    f = finger_pose(hand, base, q)
    for link in range(3):
        worst = segment_clearance(scene, body, link_start(f, link), link_direction(f, link),
                                  hand.link_length[link], hand.link_radius, worst)
    return worst


@wp.func
def palm_clearance(scene: Scene, body: int, hand: Hand, pose: transform, mount: real, worst: real):
    """Least clearance of palm slab and wrist [m], at most `worst`; `pose` in the body's frame."""
    thick = hand.palm_thickness * HALF
    y = wp.transform_vector(pose, vec3(ZERO, ONE, ZERO))
    z = wp.transform_vector(pose, vec3(ZERO, ZERO, ONE))
    for bar in range(_PALM_BARS):
        x = hand.gap * HALF * real(bar - 1)
        start = wp.transform_point(pose, vec3(x, -hand.spacing, -thick))
        worst = segment_clearance(scene, body, start, y, hand.spacing * real(2.0), thick, worst)
    start = wp.transform_point(pose, vec3(ZERO, ZERO, -wp.max(mount, thick)))
    return segment_clearance(scene, body, start, z, wp.max(mount - thick, ZERO), thick, worst)


@wp.func
def hand_clearance(
    scene: Scene, body: int, hands: wp.array2d[Hand], world: int, pose: transform, mount: real,
    commands: wp.array4d[real], grasp: int
):
    """Clearance of the hand, its fingers at the first command of a grasp; `pose` in body frame."""
    worst = _FAR
    own = world % hands.shape[0]
    for finger in range(4):
        hand = hands[own, finger]
        q = vec4(commands[grasp, finger, 0, 0], commands[grasp, finger, 0, 1],
                 commands[grasp, finger, 0, 2], commands[grasp, finger, 0, 3])
        base = wp.transform_multiply(pose, finger_base(hand, finger))
        worst = finger_clearance(scene, body, hand, base, q - hand.offset, worst)
    return palm_clearance(scene, body, hands[own, 0], pose, mount, worst)
