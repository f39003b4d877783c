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
    link_place,
    link_turn,
)
from warpgrasp.core.dtypes import HALF, ONE, ZERO, struct, vec3
from warpgrasp.mechanism.utah_mit_hand_kernel import (
    FingerPose,
    finger_jacobian,
    link_direction,
    link_start,
)


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
