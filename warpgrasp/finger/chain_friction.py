# type: ignore  # Warp functions, which type checkers cannot follow
"""Friction of a finger that is a chain, capsule by capsule: what `friction` asks of it.

Its contacts are each capsule against the body, then the same against the table.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import (
    CAPSULES,
    JOINTS,
    Chain,
    ChainPose,
    chain_capsule,
    chain_jacobian,
    chain_pose,
    link_place,
    vec6,
)
from warpgrasp.core.dtypes import real, struct, transform, vec3
from warpgrasp.finger.friction import (
    axis_length,
    axis_start,
    axis_way,
    place_jacobian,
    pose_of,
    start_friction,
)

_limits = wp.types.vector(length=2 * CAPSULES, dtype=real)
_pairs = wp.types.matrix(shape=(2 * CAPSULES, 2), dtype=real)
_turns = wp.types.matrix(shape=(2 * CAPSULES, JOINTS), dtype=real)
chain_places = wp.types.matrix(shape=(2 * CAPSULES, 3), dtype=real)


@struct
class ChainFriction:
    """As `friction.Friction`."""

    q: vec6
    drift: vec6
    left: chain_places
    touching: int
    limit: _limits
    one: chain_places
    two: chain_places
    by_one: _turns
    by_two: _turns
    begun: _pairs
    off: real


@wp.func
def start_friction(q: vec6):  # noqa: F811 (overloads, from here on)
    """A finger at drives `q` that touches nothing."""
    friction = ChainFriction()
    friction.q = q
    return friction


@wp.func
def pose_of(hand: Chain, base: transform, q: vec6):  # noqa: F811
    """Where a finger's links are; `base` is the pose of the hand's frame."""
    return chain_pose(hand, base, q)


@wp.func
def axis_start(hand: Chain, f: ChainPose, link: int):  # noqa: F811
    """Where a capsule's axis begins."""
    capsule = chain_capsule(hand, link)
    return link_place(f, capsule.joint, capsule.start)


@wp.func
def axis_way(hand: Chain, f: ChainPose, link: int):  # noqa: F811
    """Unit vector along a capsule's axis."""
    capsule = chain_capsule(hand, link)
    return wp.normalize(link_place(f, capsule.joint, capsule.end)
                        - link_place(f, capsule.joint, capsule.start))


@wp.func
def axis_length(hand: Chain, link: int):  # noqa: F811
    """Length of a capsule's axis [m]."""
    capsule = chain_capsule(hand, link)
    return wp.length(capsule.end - capsule.start)


@wp.func
def place_jacobian(hand: Chain, f: ChainPose, link: int, x: vec3, d: vec3):  # noqa: F811
    """Motion along `d` of the point `x` of a capsule per radian of each drive."""
    return chain_jacobian(hand, f, chain_capsule(hand, link).joint, x, d)
