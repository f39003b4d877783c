# type: ignore  # Warp functions, which type checkers cannot follow
"""A finger of any hand in kernels: a chain of up to six revolute joints, capsules on its links.

A finger is moved by its drives: a joint that follows another one of its finger turns `factor` times
as far. Vectors of a finger have room for six drives; those that it has not stand at zero. The rows
of joints and capsules are addresses, since Warp passes structs by value (see `geometry.scene`).
"""

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, quat, real, struct, transform, vec3, vec4
from warpgrasp.core.turns import sine_cosine

JOINTS = 6
"""Drives, and joints, of a finger at most."""
CAPSULES = 12
"""Of a finger at most."""
_JOINTS = wp.constant(JOINTS)
vec6 = wp.types.vector(length=JOINTS, dtype=real)
mat66 = wp.types.matrix(shape=(JOINTS, JOINTS), dtype=real)
vec12 = wp.types.vector(length=CAPSULES, dtype=real)
_places = wp.types.matrix(shape=(JOINTS, 3), dtype=real)
_turns = wp.types.matrix(shape=(JOINTS, 4), dtype=real)


@struct
class ChainJoint:
    """A joint and its link."""

    place: transform
    """At angle zero in the frame of the link before it; of the first in the hand's frame."""
    axis: vec3
    drive: int
    factor: real
    shift: real
    """Its angle is `factor` times its drive's plus `shift` [rad]."""
    arm: real
    """From the joint before it [m]; 0 for the first."""
    weight: real
    """Of its link [N]."""
    centre: vec3
    """Of that weight, in its frame [m]."""


@struct
class ChainCapsule:
    """A capsule of the skin, in the frame of its joint's link."""

    joint: int
    start: vec3
    end: vec3
    radius: real
    palmar: vec3
    """The side that the link closes towards, across the capsule: a unit vector."""
    far: real
    """From the joint to the farthest place of the capsule's axis [m]."""


@struct
class ChainBar:
    """A capsule of palm or wrist, in the hand's frame [m]."""

    start: vec3
    end: vec3
    radius: real


@struct
class Chain:
    """One finger, SI; the true one of a world, or the one that is believed, without errors."""

    joints: wp.uint64
    joint_count: int
    capsules: wp.uint64
    capsule_count: int
    drives: int
    stiffness: vec6
    """Of the drives' servos [N m/rad]; 1 where there is none."""
    low: vec6
    high: vec6
    """Stops, in true angles [rad]."""
    stop: real
    """Stiffness of the stops [N m/rad], 0 without."""
    offset: vec6
    """What joint sensors read without noise, less the angles [rad]."""
    skin: real
    friction: real
    weighs: int
    tip: vec3
    """In the frame of the last joint."""
    reach: real
    """From the first joint to the farthest place of the finger, stretched out [m]."""
    levers: vec6
    """How far a radian of each drive moves any place of the skin's axes at most [m]."""


@struct
class ChainPose:
    """A finger at given drives, in the frame that its base is given in: joints' places, axes, and
    the turns of their links (quaternion xyzw), a row each."""

    at: _places
    axis: _places
    turn: _turns


@wp.func
def chain_joint(hand: Chain, number: int):
    """A joint's row."""
    rows = wp.array(ptr=hand.joints, shape=(_JOINTS,), dtype=ChainJoint)
    return rows[number]


@wp.func
def chain_capsule(hand: Chain, number: int):
    """A capsule's row."""
    rows = wp.array(ptr=hand.capsules, shape=(hand.capsule_count,), dtype=ChainCapsule)
    return rows[number]


@wp.func
def chain_pose(hand: Chain, base: transform, q: vec6):
    """Forward kinematics for drives `q` [rad]; `base` is the pose of the hand's frame."""
    pose = ChainPose()
    at = wp.transform_get_translation(base)
    turn = wp.transform_get_rotation(base)
    rows = wp.array(ptr=hand.joints, shape=(_JOINTS,), dtype=ChainJoint)
    for j in range(hand.joint_count):
        place = rows[j].place
        about = rows[j].axis
        at = at + wp.quat_rotate(turn, wp.transform_get_translation(place))
        turn = turn * wp.transform_get_rotation(place)
        axis = wp.quat_rotate(turn, about)
        half = sine_cosine(HALF * (rows[j].factor * q[rows[j].drive] + rows[j].shift))
        turn = turn * quat(about[0] * half[0], about[1] * half[0], about[2] * half[0], half[1])
        pose.at[j] = at
        pose.axis[j] = axis
        pose.turn[j, 0] = turn[0]
        pose.turn[j, 1] = turn[1]
        pose.turn[j, 2] = turn[2]
        pose.turn[j, 3] = turn[3]
    return pose


@wp.func
def link_turn(pose: ChainPose, joint: int):
    """The turn of a joint's link."""
    return quat(pose.turn[joint, 0], pose.turn[joint, 1], pose.turn[joint, 2], pose.turn[joint, 3])


@wp.func
def placed(joint: vec3, turn: vec4, at: vec3):
    """A place of a link whose joint and turn are rows of a ChainPose: where many are wanted, since
    a pose that is handed on is copied."""
    return joint + wp.quat_rotate(quat(turn[0], turn[1], turn[2], turn[3]), at)


@wp.func
def link_place(pose: ChainPose, joint: int, at: vec3):
    """A place of a joint's link."""
    return placed(pose.at[joint], pose.turn[joint], at)


@wp.func
def chain_jacobian(hand: Chain, pose: ChainPose, joint: int, x: vec3, d: vec3):
    """Motion along `d` of the point `x` of a joint's link per radian of each drive."""
    by = vec6()
    rows = wp.array(ptr=hand.joints, shape=(_JOINTS,), dtype=ChainJoint)
    for j in range(joint + 1):
        by[rows[j].drive] += rows[j].factor * wp.dot(wp.cross(pose.axis[j], x - pose.at[j]), d)
    return by


@wp.func
def chain_turning(hand: Chain, pose: ChainPose, joint: int, d: vec3):
    """Turning about `d` of a joint's link per radian of each drive."""
    by = vec6()
    rows = wp.array(ptr=hand.joints, shape=(_JOINTS,), dtype=ChainJoint)
    for j in range(joint + 1):
        by[rows[j].drive] += rows[j].factor * wp.dot(pose.axis[j], d)
    return by


@wp.func
def chain_beyond_stops(hand: Chain, q: vec6):
    """How far each drive is past its upper stop, or, negative, past its lower one [rad]."""
    past = vec6()
    if hand.stop > ZERO:
        for j in range(hand.drives):
            past[j] = q[j] - wp.clamp(q[j], hand.low[j], hand.high[j])
    return past


@wp.func
def weight_along(hand: Chain, pose: ChainPose, up: vec3):
    """Torques of the links' weight about the drives [N m], by the way that is upwards in the frame
    of `pose`."""
    turns = vec6()
    if hand.weighs == 1:
        # From the tip inwards: what turns a joint is what lies beyond it.
        carried = real(0.0)
        moment = vec3(ZERO, ZERO, ZERO)
        rows = wp.array(ptr=hand.joints, shape=(_JOINTS,), dtype=ChainJoint)
        for beyond in range(hand.joint_count):
            j = hand.joint_count - 1 - beyond
            carried += rows[j].weight
            moment += placed(pose.at[j], pose.turn[j], rows[j].centre) * rows[j].weight
            arm = moment - pose.at[j] * carried
            turns[rows[j].drive] -= rows[j].factor * wp.dot(wp.cross(pose.axis[j], arm), up)
    return turns


@wp.func
def chain_weight(hand: Chain, pose: ChainPose):
    """Torques of the links' weight about the drives [N m]; the frame of `pose` has z upwards."""
    return weight_along(hand, pose, vec3(ZERO, ZERO, ONE))


@wp.func
def past_stops(hand: Chain, q: vec6):
    """Where servos that would hold drives at `q` do so with the stops against them."""
    held = vec6(q)
    past = chain_beyond_stops(hand, q)
    for j in range(hand.drives):
        held[j] -= past[j] * (hand.stop / (hand.stop + hand.stiffness[j]))
    return held


@wp.func
def chain_free_joints(hand: Chain, base: transform, command: vec6):
    """Where a finger that touches nothing rests, to second order in what its weight turns.
    `command` is that of the true drives, the errors of their sensors taken off."""
    q = vec6(command)
    if hand.weighs == 1:
        for _pass in range(2):
            turned = chain_weight(hand, chain_pose(hand, base, q))
            for j in range(hand.drives):
                q[j] = command[j] + turned[j] / hand.stiffness[j]
    return past_stops(hand, q)


@wp.func
def turned_by_weight(hand: Chain, base: transform, q: vec6):
    """How far weight turns the drives of a finger at `q` from their commands [rad]."""
    turned = vec6()
    if hand.weighs == 1:
        turned = wp.cw_div(chain_weight(hand, chain_pose(hand, base, q)), hand.stiffness)
    return turned
