# type: ignore  # Warp functions, which type checkers cannot follow
"""The chain of a finger's links as sums over its contacts want it: joints, ways of links, axes.

As `mechanism.finger_pose`, with what those sums do not need left out.
"""

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, mat33, real, struct, transform, vec3, vec4
from warpgrasp.core.turns import frame_axes, sine_cosine
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand


@struct
class LinkChain:
    """A finger's chain in the frame its base is given in [m].

    `origin` is on the abduction axis, along -`x`; flexion axes point along `side`. `starts` has
    the flexion joints as rows, `ways` the directions of the links.
    """

    origin: vec3
    x: vec3
    side: vec3
    starts: mat33
    ways: mat33


@wp.func
def finger_chain(hand: Hand, base: transform, q: vec4):
    """The chain at joints `q`."""
    return _finger_chain(base, hand.abduction_offset, hand.link_length[0], hand.link_length[1],
                         q[0], q[1], q[2], q[3])


@wp.func(inline=False)
def _finger_chain(
    base: transform, offset: real, length_1: real, length_2: real, abduction: real,
    flexion_1: real, flexion_2: real, flexion_3: real
):
    chain = LinkChain()
    axes = frame_axes(wp.transform_get_rotation(base))
    chain.origin = wp.transform_get_translation(base)
    x = axes[0]
    y = axes[1]
    z = axes[2]
    turn = sine_cosine(abduction)
    turn1 = sine_cosine(flexion_1)
    turn2 = sine_cosine(flexion_1 + flexion_2)
    turn3 = sine_cosine(flexion_1 + flexion_2 + flexion_3)
    chain.x = x
    chain.side = y * turn[1] - z * turn[0]
    z = z * turn[1] + y * turn[0]
    u = x * turn1[0] + z * turn1[1]
    u2 = x * turn2[0] + z * turn2[1]
    u3 = x * turn3[0] + z * turn3[1]
    p1 = chain.origin + z * offset
    p2 = p1 + u * length_1
    p3 = p2 + u2 * length_2
    # Rows are looked up: a vector assigned in a branch would be copied at its end.
    chain.starts = mat33(p1[0], p1[1], p1[2], p2[0], p2[1], p2[2], p3[0], p3[1], p3[2])
    chain.ways = mat33(u[0], u[1], u[2], u2[0], u2[1], u2[2], u3[0], u3[1], u3[2])
    return chain


@wp.func
def moved_along(hand: Hand, chain: LinkChain, link: int, at: vec3, d: vec3):
    """How far a turn of each joint moves a place of a link along `d` [m/rad]."""
    swing = wp.cross(d, chain.side)
    return vec4(wp.dot(wp.cross(at - chain.origin, chain.x), d),
                wp.dot(swing, at - chain.starts[0]),
                wp.where(link >= 1, wp.dot(swing, at - chain.starts[1]), ZERO),
                wp.where(link >= 2, wp.dot(swing, at - chain.starts[2]), ZERO))


@wp.func
def moved(hand: Hand, chain: LinkChain, link: int, at: vec3, turn: vec4):
    """How a `turn` of the joints moves a place of a link [m]."""
    arm = (at - chain.starts[0]) * turn[1]
    arm += (at - chain.starts[1]) * wp.where(link >= 1, turn[2], ZERO)
    arm += (at - chain.starts[2]) * wp.where(link >= 2, turn[3], ZERO)
    return wp.cross(at - chain.origin, chain.x) * turn[0] + wp.cross(chain.side, arm)


@wp.func
def lifted(hand: Hand, chain: LinkChain):
    """What a turn of each joint adds to the weight's energy [N m]; the frame has z upwards."""
    # Weights times arms, from the tip inwards: what turns a joint is what lies beyond it.
    up = vec3(ZERO, ZERO, ONE)
    turns = wp.cross(up, chain.side)
    carried = hand.weight[2]
    moment = (chain.ways[2] * (HALF * hand.link_length[2])) * carried
    by_three = wp.dot(moment, turns)
    moment += (chain.starts[2] - chain.starts[1]) * carried + (
        chain.ways[1] * (HALF * hand.link_length[1])) * hand.weight[1]
    carried += hand.weight[1]
    by_two = wp.dot(moment, turns)
    moment += (chain.starts[1] - chain.starts[0]) * carried + (
        chain.ways[0] * (HALF * hand.link_length[0])) * hand.weight[0]
    carried += hand.weight[0]
    by_one = wp.dot(moment, turns)
    moment += (chain.starts[0] - chain.origin) * carried
    return vec4(wp.dot(wp.cross(moment, chain.x), up), by_one, by_two, by_three)
