"""Utah-MIT hand: where every finger's links are, for kernels and on the host.

Hand frame: z is the approach direction along which straight fingers point; the three fingers stand
at x = -gap/2, y = -spacing, 0, +spacing, the thumb at x = +gap/2, palmar sides facing each other.
Finger frame: origin at the finger's base, x palmar, z along the straight finger. Joint 0 abducts
(positive towards the finger's +y), joints 1 to 3 flex (positive inward). All axes of 1 to 3 are
parallel, so a finger lies in one plane, turned by the abduction.
"""

import numpy as np
import warp as wp

from warpgrasp.launch import launch
from warpgrasp.parameters import HandTable
from warpgrasp.real import HALF, ONE, ZERO, quat, real, transform, vec3, vec4
from warpgrasp.sine_cosine import sine_cosine

FINGER_COUNT = 4
LINK_COUNT = 3  # proximal, middle, distal
THUMB = wp.constant(3)


@wp.struct
class Hand:
    """The numbers of a HandTable that kernels need, SI."""

    abduction_offset: real
    link_length: vec3
    link_radius: real
    spacing: real
    gap: real
    palm_thickness: real
    moment_arm: vec4
    co_contraction: real
    tension_low: real
    tension_high: real
    stiffness: real
    skin: real
    friction: real


@wp.struct
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


def hand_of(table: HandTable) -> Hand:
    """The kernels' hand."""
    hand = Hand()
    hand.abduction_offset = table.abduction_offset_m
    hand.link_length = vec3(*table.link_length_m)
    hand.link_radius = table.link_radius_m
    hand.spacing, hand.gap = table.finger_spacing_m, table.palm_gap_m
    hand.palm_thickness = table.palm_thickness_m
    hand.moment_arm = vec4(*table.moment_arm_m)
    hand.co_contraction = table.co_contraction_N
    hand.tension_low, hand.tension_high = table.tension_low_N, table.tension_high_N
    hand.stiffness, hand.skin = table.joint_stiffness_Nm_rad, table.skin_stiffness_N_m
    hand.friction = table.tendon_friction
    return hand


@wp.func
def finger_base(hand: Hand, finger: int):
    """Pose of a finger's base in the hand frame (finger 3 is the thumb)."""
    if finger == THUMB:
        return transform(vec3(hand.gap * HALF, ZERO, ZERO), quat(ZERO, ZERO, ONE, ZERO))
    return transform(vec3(-hand.gap * HALF, hand.spacing * real(finger - 1), ZERO),
                     quat(ZERO, ZERO, ZERO, ONE))


@wp.func
def finger_length(hand: Hand):
    """From a finger's base to the centre of its tip, stretched out [m]."""
    return hand.abduction_offset + hand.link_length[0] + hand.link_length[1] + hand.link_length[2]


@wp.func
def finger_pose(hand: Hand, base: transform, q: vec4):
    """Forward kinematics of one finger, joints (abduction, flexion 1, 2, 3) [rad]."""
    r = wp.transform_get_rotation(base)
    x = wp.quat_rotate(r, vec3(ONE, ZERO, ZERO))
    y0 = wp.quat_rotate(r, vec3(ZERO, ONE, ZERO))
    z0 = wp.quat_rotate(r, vec3(ZERO, ZERO, ONE))
    turn = sine_cosine(q[0])
    z = z0 * turn[1] + y0 * turn[0]
    f = FingerPose()
    f.side = y0 * turn[1] - z0 * turn[0]
    f.abduct = -x
    a = q[1]
    turn = sine_cosine(a)
    f.u1 = x * turn[0] + z * turn[1]
    f.n1 = x * turn[1] - z * turn[0]
    a += q[2]
    turn = sine_cosine(a)
    f.u2 = x * turn[0] + z * turn[1]
    f.n2 = x * turn[1] - z * turn[0]
    a += q[3]
    turn = sine_cosine(a)
    f.u3 = x * turn[0] + z * turn[1]
    f.n3 = x * turn[1] - z * turn[0]
    f.base = wp.transform_get_translation(base)
    f.p1 = f.base + z * hand.abduction_offset
    f.p2 = f.p1 + f.u1 * hand.link_length[0]
    f.p3 = f.p2 + f.u2 * hand.link_length[1]
    f.p4 = f.p3 + f.u3 * hand.link_length[2]
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


def hand_links(
    table: HandTable, hand_pose: np.ndarray, q_rad: np.ndarray, *, device: str = "cpu"
) -> tuple[np.ndarray, np.ndarray]:
    """Places of every joint and tip, and palmar normals, of whole hands.

    `hand_pose` (pose, 7) is position [m] and quaternion xyzw, `q_rad` (pose, finger 4, joint 4).
    Returns points [m], shape (pose, 4, 5, 3): base, three flexion joints, tip centre; and unit
    palmar normals, shape (pose, 4, link 3, 3); both in the frame of `hand_pose`.
    """
    count = len(hand_pose)
    points = wp.empty((count, FINGER_COUNT, 5), dtype=vec3, device=device)
    palmar = wp.empty((count, FINGER_COUNT, LINK_COUNT), dtype=vec3, device=device)
    launch(_links_kernel, {"pose": count, "finger": FINGER_COUNT},
           {"hand_pose": "pose", "q": "pose finger", "joint_point": "pose finger 5",
            "palmar": "pose finger 3"},
           {"hand": hand_of(table),
            "hand_pose": wp.array(hand_pose, dtype=transform, device=device),
            "q": wp.array(q_rad, dtype=vec4, device=device),
            "joint_point": points, "palmar": palmar}, device=device)
    return points.numpy().copy(), palmar.numpy().copy()
