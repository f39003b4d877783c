# type: ignore  # Warp functions, which type checkers cannot follow
"""Utah-MIT hand in kernels: where a finger's links are, and its Jacobian."""

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, quat, real, struct, transform, vec3, vec4
from warpgrasp.core.turns import frame_axes, sine_cosine

THUMB = wp.constant(3)


@struct
class Hand:
    """The numbers of a HandTable that kernels need, SI, and one finger's errors.

    The true hand is four of these, one a finger; the hand that is believed has no errors.
    """

    abduction_offset: real
    link_length: vec3
    link_radius: real
    spacing: real
    gap: real
    palm_thickness: real
    stiffness: real
    skin: real
    friction: real
    """Coefficient of friction of the skin."""
    base_shift: vec3
    """Of the finger's base, hand frame [m]."""
    offset: vec4
    """Of the joint sensors: what they read without noise, less the joints' angles [rad]."""
    stop: real
    """Stiffness of the joints' stops [N m/rad], 0 without; where they are, true angles [rad]."""
    low: vec4
    high: vec4
    weight: vec3
    """Of each link [N]."""
    sag: vec3
    """How far any place of a link is at most from where the believed hand has it on the same
    commands, touching nothing: by weight and errors of calibration [m]."""
    lean: real
    """How far weight turns any place of it sideways, at most [m]."""
    askew: real
    """How far its links stand askew of the believed hand's [rad], and how much longer they are,
    relatively: the largest sum; and what weight changes of that on the way."""


@struct
class FingerPose:
    """A finger's chain in the frame its base is given in: joints, link directions, palmar normals.

    `p1` to `p3` are the flexion joints, `p4` the tip's centre; `u` point along the links, `n` to
    the palmar side; `side` is the flexion axis, `abduct` the abduction axis.
    """

    base: vec3
    p1: vec3
    p2: vec3
    p3: vec3
    p4: vec3
    u1: vec3
    u2: vec3
    u3: vec3
    n1: vec3
    n2: vec3
    n3: vec3
    side: vec3
    abduct: vec3


@wp.func
def finger_base(hand: Hand, finger: int):
    """Pose of a finger's base in the hand frame (finger 3 is the thumb)."""
    if finger == THUMB:
        return transform(vec3(hand.gap * HALF, ZERO, ZERO) + hand.base_shift,
                         quat(ZERO, ZERO, ONE, ZERO))
    return transform(vec3(-hand.gap * HALF, hand.spacing * real(finger - 1), ZERO)
                     + hand.base_shift, quat(ZERO, ZERO, ZERO, ONE))


@wp.func
def finger_length(hand: Hand):
    """From a finger's base to the centre of its tip, stretched out [m]."""
    return hand.abduction_offset + hand.link_length[0] + hand.link_length[1] + hand.link_length[2]


@wp.func
def finger_pose(hand: Hand, base: transform, q: vec4):
    """Forward kinematics of one finger, joints (abduction, flexion 1, 2, 3) [rad]."""
    return _finger_pose(base, hand.abduction_offset, hand.link_length[0], hand.link_length[1],
                        hand.link_length[2], q[0], q[1], q[2], q[3])


@wp.func(inline=False)
def _finger_pose(
    base: transform, offset: real, length_1: real, length_2: real, length_3: real, abduction: real,
    flexion_1: real, flexion_2: real, flexion_3: real
):
    return _chain_pose(base, offset, length_1, length_2, length_3, abduction, flexion_1, flexion_2,
                       flexion_3)


@wp.func
def _pose_in_place(hand: Hand, base: transform, q: vec4):
    """`finger_pose` computed in place: what is not asked for is left out."""
    return _chain_pose(base, hand.abduction_offset, hand.link_length[0], hand.link_length[1],
                       hand.link_length[2], q[0], q[1], q[2], q[3])


@wp.func
def _chain_pose(
    base: transform, offset: real, length_1: real, length_2: real, length_3: real, abduction: real,
    flexion_1: real, flexion_2: real, flexion_3: real
):
    axes = frame_axes(wp.transform_get_rotation(base))
    x = axes[0]
    y0 = axes[1]
    z0 = axes[2]
    turn = sine_cosine(abduction)
    z = z0 * turn[1] + y0 * turn[0]
    f = FingerPose()
    f.side = y0 * turn[1] - z0 * turn[0]
    f.abduct = -x
    a = flexion_1
    turn = sine_cosine(a)
    f.u1 = x * turn[0] + z * turn[1]
    f.n1 = x * turn[1] - z * turn[0]
    a += flexion_2
    turn = sine_cosine(a)
    f.u2 = x * turn[0] + z * turn[1]
    f.n2 = x * turn[1] - z * turn[0]
    a += flexion_3
    turn = sine_cosine(a)
    f.u3 = x * turn[0] + z * turn[1]
    f.n3 = x * turn[1] - z * turn[0]
    f.base = wp.transform_get_translation(base)
    f.p1 = f.base + z * offset
    f.p2 = f.p1 + f.u1 * length_1
    f.p3 = f.p2 + f.u2 * length_2
    f.p4 = f.p3 + f.u3 * length_3
    return f


@wp.func
def link_start(f: FingerPose, link: int):
    """Joint a link starts from."""
    if link == 0:
        return f.p1
    if link == 1:
        return f.p2
    return f.p3


@wp.func
def link_direction(f: FingerPose, link: int):
    """Unit vector along a link."""
    if link == 0:
        return f.u1
    if link == 1:
        return f.u2
    return f.u3


@wp.func
def finger_jacobian(f: FingerPose, link: int, x: vec3, d: vec3):
    """Motion along `d` of the point `x` of a link (0 proximal to 2 distal) per radian a joint."""
    c = wp.cross(d, f.side)
    j = vec4(wp.dot(wp.cross(f.abduct, x - f.base), d), wp.dot(c, x - f.p1), ZERO, ZERO)
    if link >= 1:
        j[2] = wp.dot(c, x - f.p2)
    if link >= 2:
        j[3] = wp.dot(c, x - f.p3)
    return j


@wp.func
def beyond_stops(hand: Hand, q: vec4):
    """How far each joint is past its upper stop, or, negative, past its lower one [rad]."""
    if hand.stop == ZERO:
        return vec4(ZERO, ZERO, ZERO, ZERO)
    return q - vec4(wp.clamp(q[0], hand.low[0], hand.high[0]),
                    wp.clamp(q[1], hand.low[1], hand.high[1]),
                    wp.clamp(q[2], hand.low[2], hand.high[2]),
                    wp.clamp(q[3], hand.low[3], hand.high[3]))


@wp.func
def _weighed(moments: vec4, hand: Hand, f: FingerPose, link: int, weight: real):
    """`moments` with those of one link's weight; the frame of `f` has z upwards."""
    centre = link_start(f, link) + link_direction(f, link) * (hand.link_length[link] * HALF)
    return moments - finger_jacobian(f, link, centre, vec3(ZERO, ZERO, ONE)) * weight


@wp.func
def weight_moments(hand: Hand, f: FingerPose):
    """Torques of the links' weight about the joints [N m]; the frame of `f` has z upwards."""
    # Written out, so that a link's number is known when this is compiled.
    moments = _weighed(vec4(ZERO, ZERO, ZERO, ZERO), hand, f, 0, hand.weight[0])
    moments = _weighed(moments, hand, f, 1, hand.weight[1])
    return _weighed(moments, hand, f, 2, hand.weight[2])


@wp.func
def free_joints(hand: Hand, base: transform, command: vec4):
    """Where a finger that touches nothing rests: to first order in what its weight turns. `command`
    is that of the true joints, the errors of their sensors taken off.

    By the defaults weight turns joints by less than a hundredth of a radian, and what it turns them
    by changes as little with that: the rest is right to some 1e-4 rad, and tips of hands that
    `weight_misfit` lets pass to 0.1 mm.
    """
    q = vec4(command)
    if hand.weight[0] > ZERO:
        q += weight_moments(hand, _pose_in_place(hand, base, command)) / hand.stiffness
    return q - beyond_stops(hand, q) * (hand.stop / (hand.stop + hand.stiffness))


@wp.func
def free_pose(hand: Hand, base: transform, command: vec4):
    """The pose of a finger that touches nothing, in place: of its links only those asked for."""
    return _pose_in_place(hand, base, free_joints(hand, base, command))


@wp.func
def fingertip_point(hand: Hand, f: FingerPose):
    """Palmar surface point of the fingertip: the contact as the paper takes it."""
    return f.p4 + f.n3 * hand.link_radius


@wp.kernel(enable_backward=False)
def _links_kernel(
    first: int,
    hand: Hand,
    # Pose in:
    hand_pose: wp.array[transform],
    q: wp.array2d[vec4],
    # Links out:
    joint_point: wp.array3d[vec3],
    palmar: wp.array3d[vec3],
):
    i, finger = wp.tid()
    i += first
    base = wp.transform_multiply(hand_pose[i], finger_base(hand, finger))
    f = finger_pose(hand, base, q[i, finger])
    joint_point[i, finger, 0] = f.base
    joint_point[i, finger, 1] = f.p1
    joint_point[i, finger, 2] = f.p2
    joint_point[i, finger, 3] = f.p3
    joint_point[i, finger, 4] = f.p4
    palmar[i, finger, 0] = f.n1
    palmar[i, finger, 1] = f.n2
    palmar[i, finger, 2] = f.n3
