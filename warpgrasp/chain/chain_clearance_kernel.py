# type: ignore  # Warp functions, which type checkers cannot follow
"""How far an open hand of chains is from body and table, and whether its approach is barred."""

import warp as wp

from warpgrasp.chain.chain_kernel import (
    Chain,
    ChainBar,
    chain_capsule,
    chain_pose,
    link_place,
    vec6,
)
from warpgrasp.core.dtypes import ONE, ZERO, real, transform, vec3
from warpgrasp.geometry.scene import Scene
from warpgrasp.mechanism.arm_motion_kernel import RETREAT_M, approach_left
from warpgrasp.mechanism.hand_clearance import segment_clearance
from warpgrasp.probe_status import ProbeStatus

wp.set_module_options({"max_unroll": 1})
_TRY = wp.constant(int(ProbeStatus.CONTACT))
_COLLISION = wp.constant(int(ProbeStatus.COLLISION))
_RETREAT = wp.constant(real(RETREAT_M))
_FAR = wp.constant(real(1e9))
_MARCHES = wp.constant(int(RETREAT_M / 5e-4) + 2)


@wp.func
def _capsule_clearance(
    scene: Scene, body: int, a: vec3, b: vec3, radius: real, worst: real
):
    length = wp.length(b - a)
    u = vec3(ZERO, ZERO, ONE)
    if length > ZERO:
        u = (b - a) / length
    return segment_clearance(scene, body, a, u, length, radius, worst)


@wp.func
def chain_finger_clearance(
    scene: Scene, body: int, hand: Chain, pose: transform, q: vec6, worst: real
):
    """Least clearance of a finger's capsules [m], at most `worst`; `pose` in the body's frame."""
    f = chain_pose(hand, pose, q)
    for c in range(hand.capsule_count):
        capsule = chain_capsule(hand, c)
        worst = _capsule_clearance(
            scene, body, link_place(f, capsule.joint, capsule.start),
            link_place(f, capsule.joint, capsule.end), capsule.radius, worst)
    return worst


@wp.func
def palm_bars_clearance(
    scene: Scene, body: int, pose: transform, palm: wp.array[ChainBar], worst: real
):
    """The same of palm and wrist."""
    for n in range(palm.shape[0]):
        bar = palm[n]
        worst = _capsule_clearance(scene, body, wp.transform_point(pose, bar.start),
                                   wp.transform_point(pose, bar.end), bar.radius, worst)
    return worst


@wp.func
def chain_hand_clearance(
    scene: Scene, body: int, hands: wp.array2d[Chain], world: int, pose: transform,
    palm: wp.array[ChainBar], path: wp.array3d[vec6], grasp: int
):
    """Clearance of the hand [m], its fingers at the first command of a grasp; `pose` in body frame.
    """
    worst = _FAR
    for finger in range(hands.shape[1]):
        hand = hands[world % hands.shape[0], finger]
        worst = chain_finger_clearance(scene, body, hand, pose,
                                       path[grasp, finger, 0] - hand.offset, worst)
    return palm_bars_clearance(scene, body, pose, palm, worst)


@wp.kernel(enable_backward=False)
def chain_clearance_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Robot:
    hands: wp.array2d[Chain],
    palm: wp.array[ChainBar],
    # Probe in:
    move_status: wp.array2d[int],
    actual: wp.array2d[transform],
    path: wp.array3d[vec6],
    # Status out:
    status: wp.array3d[int],
):
    """COLLISION where the open hand would strike something on its approach."""
    w, p, g = wp.tid()
    w += first
    status[w, p, g] = move_status[w, p]
    if move_status[w, p] != _TRY:
        return
    pose = wp.transform_multiply(wp.transform_inverse(body_pose[w]), actual[w, p])
    z = wp.transform_vector(pose, vec3(ZERO, ZERO, ONE))
    place = wp.transform_get_translation(pose)
    turn = wp.transform_get_rotation(pose)
    left = ZERO
    if g == 0:
        left = _RETREAT  # the first grasp of a probe comes with the approach
    for _ in range(_MARCHES):
        clear = chain_hand_clearance(scene, body[w % body.shape[0]], hands, w,
                                     transform(place - z * left, turn), palm, path, g)
        if clear < ZERO:
            status[w, p, g] = _COLLISION
            return
        if left <= ZERO:
            return
        left = approach_left(left, clear)
