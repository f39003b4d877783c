# type: ignore  # Warp functions, which type checkers cannot follow
"""The energy of a finger that is a chain of any joints: as `energy`, capsule by capsule.

What `equilibrium` and `equilibrium_refine` need of a finger is overloaded here, so that their
descents serve both kinds. The Utah-MIT hand keeps the shorter mathematics of `energy`, which its
parallel flexion axes allow: one sideways turn, then a plane.
"""

from typing import Any

import warp as wp

from warpgrasp.chain.chain_kernel import (
    CAPSULES,
    Chain,
    chain_beyond_stops,
    chain_capsule,
    chain_jacobian,
    chain_joint,
    chain_pose,
    chain_weight,
    link_place,
    mat66,
    placed,
    vec6,
    vec12,
)
from warpgrasp.core.dtypes import HALF, ONE, ZERO, greater, real, struct, transform, vec3
from warpgrasp.finger.chain_friction import ChainFriction
from warpgrasp.finger.energy import finger_energy, largest_magnitude, loosened
from warpgrasp.finger.friction import rubbed, with_friction
from warpgrasp.finger.valley_energy import refined_energy, secant_compliance
from warpgrasp.geometry.scene import Scene
from warpgrasp.geometry.segment_distance import deepest_valley, lower_end, nearest_on_link
from warpgrasp.mechanism.utah_mit_hand_kernel import finger_length

_CAPSULES = wp.constant(CAPSULES)
_SIX_OF_FOUR = wp.constant(real(1.5))
_PARTS = wp.constant(8)  # of an eighth of a capsule
_FAR = wp.constant(real(1.0))  # [m]
_STIFF = wp.constant(real(1e4))  # a valley already found is not left: steps of micrometres


@struct
class ChainRest:
    """A finger at equilibrium, as `energy.Equilibrium`, with a number for each drive or capsule."""

    q: vec6
    energy: real
    gradient: vec6
    pressed: real
    drive: vec6
    compliance: mat66
    along: vec12
    bend: vec12
    depth: vec12
    table: vec12
    near: vec6
    near_depth: real


@wp.func
def free_chain(q: vec6):
    """A finger at drives `q` without contact, its capsules unknown."""
    rest = ChainRest()
    rest.q = q
    for c in range(_CAPSULES):
        rest.along[c] = -ONE
    rest.near_depth = -ONE
    return rest


@wp.func
def _yielding(compliance: mat66, turns: vec6, skin: real):
    """The compliance with a contact more (Sherman and Morrison), which `turns` the joints."""
    gives = compliance * turns
    return compliance - wp.outer(gives, gives / (ONE / skin + wp.dot(turns, gives)))


@wp.func
def links_moved(hand: Chain, q: vec6, last: vec6):
    """How far each joint's link has turned at most since drives `last` [rad], and how far its joint
    has moved [m]: each joint's turn times what lies beyond it."""
    turned = vec6()
    travel = vec6()
    turn = real(0.0)
    way = real(0.0)
    for j in range(hand.joint_count):
        row = chain_joint(hand, j)
        way += turn * row.arm
        turn += wp.abs(row.factor * (q[row.drive] - last[row.drive]))
        turned[j] = turn
        travel[j] = way
    return turned, travel


@wp.func(inline=False)
def finger_energy(  # noqa: F811 (an overload)
    scene: Scene, body: int, hand: Chain, base: transform, command: vec6, q: vec6,
    last: ChainRest, samples: int
):
    """Energy, gradient, compliance and depths of the capsules at drives `q`.

    `base` is the hand's pose in the body's frame. Otherwise as `energy.finger_energy`.
    """
    rest = ChainRest()
    rest.q = q
    past = chain_beyond_stops(hand, q)
    rest.pressed = HALF * hand.stop * wp.dot(past, past)
    for j in range(len(q)):
        k = hand.stiffness[j]
        lag = command[j] - q[j]
        rest.drive[j] = -lag * k
        rest.energy += HALF * k * lag * lag
        rest.compliance[j, j] = ONE / wp.where(past[j] == ZERO, k, k + hand.stop)
    rest.gradient = past * hand.stop
    pose = chain_pose(hand, base, q)
    turned, travel = links_moved(hand, q, last.q)
    rest.near_depth = -ONE
    for c in range(hand.capsule_count):
        capsule = chain_capsule(hand, c)
        joint = capsule.joint
        at = pose.at[joint]
        turn = pose.turn[joint]
        a = placed(at, turn, capsule.start)
        u = placed(at, turn, capsule.end) - a
        length = wp.length(u)
        if length > ZERO:
            u = u / length
        before = last.depth[c]
        depth = before + travel[joint] + turned[joint] * capsule.far
        along = last.along[c]
        bend = last.bend[c]
        if depth >= ZERO or before >= ZERO:
            near = nearest_on_link(scene, body, a, u, length, along, bend, samples,
                                   capsule.radius)
            depth = capsule.radius - near.distance
            along = near.along
            bend = near.bend
            if depth > rest.near_depth:
                loses = chain_jacobian(hand, pose, joint, a + u * along, near.normal)
                if depth > ZERO:
                    rest.pressed += HALF * hand.skin * depth * depth
                    rest.gradient -= loses * (hand.skin * depth)
                    rest.compliance = _yielding(rest.compliance, loses, hand.skin)
                else:
                    rest.near = loses
                    rest.near_depth = depth
        low = a + u * lower_end(u, length)
        pressed = capsule.radius - low[2]
        if pressed > ZERO:
            sinks = chain_jacobian(hand, pose, joint, low, vec3(ZERO, ZERO, ONE))
            rest.pressed += HALF * hand.skin * pressed * pressed
            rest.gradient -= sinks * (hand.skin * pressed)
            rest.compliance = _yielding(rest.compliance, sinks, hand.skin)
        rest.table[c] = pressed
        rest.along[c] = along
        rest.bend[c] = bend
        rest.depth[c] = depth
    if hand.weighs == 1:
        rest.drive -= chain_weight(hand, pose)
        for j in range(hand.joint_count):
            row = chain_joint(hand, j)
            if row.weight > ZERO:
                rest.energy += row.weight * placed(pose.at[j], pose.turn[j], row.centre)[2]
    rest.energy += rest.pressed
    rest.gradient += rest.drive
    return rest


@wp.func
def largest_magnitude(v: vec6):  # noqa: F811
    """The largest absolute value of six numbers."""
    largest = real(0.0)
    for j in range(len(v)):
        largest = greater(largest, wp.abs(v[j]))
    return largest


@wp.func
def loosened(rest: ChainRest, moved: real):  # noqa: F811
    """`rest` with depths that stay bounds after any place moves by `moved` [m]."""
    loose = rest
    for c in range(_CAPSULES):
        loose.depth[c] = loose.depth[c] + moved
        loose.table[c] = loose.table[c] + moved
    return loose


@wp.func
def with_friction(rest: ChainRest, skin: real, friction: int):  # noqa: F811
    """`rest` as it is: without friction."""
    return rest


@wp.func
def with_friction(rest: ChainRest, skin: real, friction: ChainFriction):  # noqa: F811
    """`rest` of `finger_energy` with energy, slope and stiffness of friction added."""
    return rubbed(rest, skin, friction)


@wp.func
def finger_length(hand: Chain):  # noqa: F811
    """From the first joint to the farthest place of the finger, stretched out [m]; half as much
    again, since `finger_equilibrium` counts on four joints."""
    return hand.reach * _SIX_OF_FOUR


@wp.func
def secant_compliance(compliance: mat66, step: vec6, rise: vec6):  # noqa: F811 (an overload)
    """The BFGS update of an inverse Hessian by a step and the change of slope along it."""
    share = ONE / wp.dot(step, rise)
    keep = -wp.outer(step, rise) * share
    for j in range(len(step)):
        keep[j, j] = keep[j, j] + ONE
    return keep * compliance * wp.transpose(keep) + wp.outer(step, step) * share


@wp.func
def refined_energy(  # noqa: F811
    scene: Scene, body: int, convex: bool, hand: Chain, base: wp.transformd, command: vec6,
    q: vec6, last: ChainRest, friction: Any
):
    """The energy, with every valley of the distance searched, as the overload for a Hand."""
    known = free_chain(last.q)
    known.along = last.along
    known.bend = last.bend
    known.depth = last.depth
    if not convex:
        pose = chain_pose(hand, base, q)
        for c in range(hand.capsule_count):
            capsule = chain_capsule(hand, c)
            a = link_place(pose, capsule.joint, capsule.start)
            u = link_place(pose, capsule.joint, capsule.end) - a
            length = wp.length(u)
            if length > ZERO:
                u = u / length
            along = deepest_valley(scene, body, a, u, length, _PARTS, capsule.radius)
            known.along[c] = along
            known.bend[c] = _STIFF
            known.depth[c] = wp.where(along < ZERO, -_FAR, ZERO)
    return with_friction(finger_energy(scene, body, hand, base, command, q, known, 0), hand.skin,
                         friction)
