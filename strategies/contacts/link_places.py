# type: ignore  # Warp functions, which type checkers cannot follow
"""What placing a contact needs of a finger, for both kinds: the Utah-MIT hand's and chains.

A link of a chain's finger is one of its capsules here.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import (
    Chain,
    ChainPose,
    chain_capsule,
    chain_jacobian,
    chain_turning,
    link_place,
    link_turn,
)
from warpgrasp.core.dtypes import HALF, ONE, ZERO, real, struct, vec3, vec4
from warpgrasp.mechanism.utah_mit_hand_kernel import (
    FingerPose,
    Hand,
    finger_jacobian,
    link_direction,
    link_start,
)

_BALL = wp.constant(real(1e-5))  # [m] what is shorter has no side: a ball has the axis it is given


@struct
class ChainAt:
    """A finger of a chain at given drives."""

    hand: Chain
    pose: ChainPose


@wp.func
def start_at(f: FingerPose, link: int):
    """Where a link's axis starts."""
    return link_start(f, link)


@wp.func
def start_at(f: ChainAt, link: int):  # noqa: F811 (an overload)
    """Where a capsule's axis starts."""
    capsule = chain_capsule(f.hand, link)
    return link_place(f.pose, capsule.joint, capsule.start)


@wp.func
def direction_at(f: FingerPose, link: int):
    """Unit vector along a link."""
    return link_direction(f, link)


@wp.func
def direction_at(f: ChainAt, link: int):  # noqa: F811
    """Unit vector along a capsule; of a ball any."""
    capsule = chain_capsule(f.hand, link)
    along = capsule.end - capsule.start
    if wp.dot(along, along) == ZERO:
        along = wp.cross(capsule.palmar, vec3(ONE, ZERO, ZERO))
        if wp.length(along) < HALF:
            along = wp.cross(capsule.palmar, vec3(ZERO, ONE, ZERO))
    return wp.normalize(wp.quat_rotate(link_turn(f.pose, capsule.joint), along))


@wp.func
def jacobian_at(f: FingerPose, link: int, x: vec3, d: vec3):
    """Motion along `d` of the point `x` of a link per radian a joint."""
    return finger_jacobian(f, link, x, d)


@wp.func
def jacobian_at(f: ChainAt, link: int, x: vec3, d: vec3):  # noqa: F811
    """Motion along `d` of the point `x` of a capsule per radian of each drive."""
    return chain_jacobian(f.hand, f.pose, chain_capsule(f.hand, link).joint, x, d)


@wp.func
def turning_at(f: FingerPose, link: int, d: vec3):
    """Turning about `d` of a link per radian a joint."""
    bent = wp.dot(f.side, d)
    j = vec4(wp.dot(f.abduct, d), bent, ZERO, ZERO)
    if link >= 1:
        j[2] = bent
    if link >= 2:
        j[3] = bent
    return j


@wp.func
def turning_at(f: ChainAt, link: int, d: vec3):  # noqa: F811
    """Turning about `d` of a capsule per radian of each drive."""
    return chain_turning(f.hand, f.pose, chain_capsule(f.hand, link).joint, d)


@wp.func
def servo_ease(hand: Hand, joint: int):
    """How far a joint yields to a torque [rad/(N m)]."""
    return ONE / hand.stiffness


@wp.func
def servo_ease(hand: Chain, joint: int):  # noqa: F811
    """How far a drive yields to a torque."""
    return ONE / hand.stiffness[joint]


@wp.func
def links_of(hand: Hand):
    """How many links a finger has."""
    return 3


@wp.func
def links_of(hand: Chain):  # noqa: F811
    """How many capsules a finger has."""
    return hand.capsule_count


@wp.func
def joint_of(hand: Hand, link: int):
    """Which number of a finger's weights is a link's."""
    return link


@wp.func
def joint_of(hand: Chain, link: int):  # noqa: F811
    """The joint whose link bears a capsule."""
    return chain_capsule(hand, link).joint


@wp.func
def length_of(hand: Hand, link: int):
    """Of a link's axis [m]."""
    return hand.link_length[link]


@wp.func
def length_of(hand: Chain, link: int):  # noqa: F811
    """Of a capsule's axis [m]."""
    capsule = chain_capsule(hand, link)
    return wp.length(capsule.end - capsule.start)


@wp.func
def radius_of(hand: Hand, link: int):
    """Of a link [m]."""
    return hand.link_radius


@wp.func
def radius_of(hand: Chain, link: int):  # noqa: F811
    """Of a capsule [m]."""
    return chain_capsule(hand, link).radius


@wp.func
def round_end(hand: Hand, link: int):
    """What of a link's end touches: nothing 0, a half ball 1."""
    return wp.where(link == 2, 1, 0)


@wp.func
def round_end(hand: Chain, link: int):  # noqa: F811
    """The same of a capsule; 2 of a ball, which touches all around."""
    if length_of(hand, link) < _BALL:
        return 2
    return wp.where(chain_capsule(hand, link).joint == hand.joint_count - 1, 1, 0)


@wp.func
def cell_square(hand: Hand, link: int, step: real):
    """Square of `step`, a share of a link's length [m2]. It is rounded in another order than for
    a chain, and contacts depend on the last bit."""
    return hand.link_length[link] * hand.link_length[link] * step * step


@wp.func
def cell_square(hand: Chain, link: int, step: real):  # noqa: F811
    """The same of a capsule."""
    cell = length_of(hand, link) * step
    return cell * cell
