# type: ignore  # Warp functions, which type checkers cannot follow
"""What a guarded line asks of a finger, of the Utah-MIT hand or of a chain.

Each function has an overload for both, so that one algorithm moves and feels with either.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import (
    Chain,
    ChainPose,
    chain_capsule,
    chain_free_joints,
    chain_jacobian,
    chain_pose,
    link_place,
    vec6,
)
from warpgrasp.core.dtypes import HALF, ONE, ZERO, quat, real, transform, vec3, vec4
from warpgrasp.core.random_kernel import counter_key, counter_normal
from warpgrasp.geometry.scene import Scene
from warpgrasp.geometry.segment_distance import LINK_SAMPLES, nearest_on_link
from warpgrasp.mechanism.utah_mit_hand_kernel import (
    FingerPose,
    Hand,
    finger_base,
    finger_jacobian,
    finger_pose,
    free_joints,
    link_direction,
    link_start,
)
from warpgrasp.touch.pad_kernel import Pad, PadLink, pad_link

_PADS = wp.constant(3)


@wp.func
def finger_root(hand: Hand, finger: int):
    """Where a finger's frame stands in the hand's."""
    return finger_base(hand, finger)


@wp.func
def finger_root(hand: Chain, finger: int):  # noqa: F811 (an overload)
    """A chain's first joint is placed in the hand's frame."""
    return transform(vec3(ZERO, ZERO, ZERO), quat(ZERO, ZERO, ZERO, ONE))


@wp.func
def posed(hand: Hand, base: transform, q: vec4):
    """Forward kinematics of a finger."""
    return finger_pose(hand, base, q)


@wp.func
def posed(hand: Chain, base: transform, q: vec6):  # noqa: F811
    """The same of a chain."""
    return chain_pose(hand, base, q)


@wp.func
def hanging(hand: Hand, base: transform, command: vec4):
    """Where a finger that touches nothing rests."""
    return free_joints(hand, base, command)


@wp.func
def hanging(hand: Chain, base: transform, command: vec6):  # noqa: F811
    """The same of a chain."""
    return chain_free_joints(hand, base, command)


@wp.func
def pad_moves(hand: Hand, f: FingerPose, at: PadLink, x: vec3, d: vec3):
    """Motion along `d` of the point `x` of a link with a pad, per radian of each joint."""
    return finger_jacobian(f, at.slot, x, d)


@wp.func
def pad_moves(hand: Chain, f: ChainPose, at: PadLink, x: vec3, d: vec3):  # noqa: F811
    """The same of a chain, per radian of each drive."""
    return chain_jacobian(hand, f, at.joint, x, d)


@wp.func
def _capsule_free(scene: Scene, body: int, a: vec3, u: vec3, length: real, radius: real):
    """A lower bound of the distance from a capsule to any obstacle, its axis from `a` along `u`."""
    near = nearest_on_link(scene, body, a, u, length, -ONE, ONE, LINK_SAMPLES,
                           length * HALF + radius)
    return wp.min(near.distance, a[2] + wp.min(u[2], ZERO) * length) - radius


@wp.func
def finger_free(scene: Scene, body: int, hand: Hand, pad: Pad, base: transform, q: vec4):
    """A lower bound of the distance from a finger's skin and pads to any obstacle [m]."""
    f = finger_pose(hand, base, q)
    free = real(1e9)
    for link in range(3):
        radius = hand.link_radius
        if pad.on[link] != 0:
            radius += pad.thickness + wp.abs(pad.shift[link, 0])
        free = wp.min(free, _capsule_free(scene, body, link_start(f, link), link_direction(f, link),
                                          hand.link_length[link], radius))
    return free


@wp.func
def finger_free(  # noqa: F811
    scene: Scene, body: int, hand: Chain, pad: Pad, base: transform, q: vec6
):
    """The same of a chain: of its capsules, and of those that its pads are bent about."""
    f = chain_pose(hand, base, q)
    free = real(1e9)
    for c in range(hand.capsule_count):
        capsule = chain_capsule(hand, c)
        a = link_place(f, capsule.joint, capsule.start)
        way = link_place(f, capsule.joint, capsule.end) - a
        length = wp.length(way)
        free = wp.min(free, _capsule_free(scene, body, a, way / length, length, capsule.radius))
    for link in range(_PADS):
        if pad.on[link] != 0:
            at = pad_link(hand, pad, f, link)
            radius = at.radius + pad.thickness + wp.abs(pad.shift[link, 0])
            free = wp.min(free, _capsule_free(scene, body, at.foot, at.along, at.length, radius))
    return free


@wp.func
def tip_centre(hand: Hand, pad: Pad, pose: transform, finger: int, q: vec4):
    """The centre of a fingertip."""
    f = finger_pose(hand, wp.transform_multiply(pose, finger_base(hand, finger)), q)
    return f.p4


@wp.func
def tip_centre(hand: Chain, pad: Pad, pose: transform, finger: int, q: vec6):  # noqa: F811
    """The same of a chain: the end of what its outermost pad is bent about."""
    f = chain_pose(hand, pose, q)
    centre = link_place(f, hand.joint_count - 1, hand.tip)
    for link in range(_PADS):
        if pad.on[link] != 0:
            centre = pad_link(hand, pad, f, link).tip
    return centre


@wp.func
def joints_read(hand: Hand, q: vec4, noise: real, reading: wp.uint64):
    """Joint angles as the sensors read them."""
    return q + noise * vec4(
        counter_normal(counter_key(reading, 0)), counter_normal(counter_key(reading, 1)),
        counter_normal(counter_key(reading, 2)), counter_normal(counter_key(reading, 3)))


@wp.func
def joints_read(hand: Chain, q: vec6, noise: real, reading: wp.uint64):  # noqa: F811
    """The same of a chain's drives."""
    read = vec6(q)
    for d in range(hand.drives):
        read[d] = read[d] + noise * counter_normal(counter_key(reading, d))
    return read


@wp.func
def unexplained(hand: Hand, base: transform, command: vec4, off: vec4):
    """How far joints are off their commands, beside what the robot knows to turn them: all of it,
    since weight turns this hand's by less than a reading's noise."""
    return off


@wp.func
def unexplained(hand: Chain, base: transform, command: vec6, off: vec6):  # noqa: F811
    """The same of a chain, whose believed weight is taken off; `base` is as believed."""
    return off - (chain_free_joints(hand, base, command) - command)


@wp.func
def six_of(q: vec4):
    """Angles with zeros up to six."""
    return vec6(q[0], q[1], q[2], q[3], ZERO, ZERO)


@wp.func
def six_of(q: vec6):  # noqa: F811
    """Six angles."""
    return q


@wp.func
def command_at(commands: wp.array3d[real], finger: int, step: int):
    """The command of a finger at a step; the last one is held."""
    k = wp.min(step, commands.shape[1] - 1)
    return vec4(commands[finger, k, 0], commands[finger, k, 1], commands[finger, k, 2],
                commands[finger, k, 3])


@wp.func
def command_at(commands: wp.array2d[vec6], finger: int, step: int):  # noqa: F811
    """The same of a chain's drives."""
    return commands[finger, wp.min(step, commands.shape[1] - 1)]
