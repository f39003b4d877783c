# type: ignore  # Warp functions, which type checkers cannot follow
"""The balance of a finger that is a chain and whose skin rubs: as `balance`, capsule by capsule.

What the searches of `balance_newton` and `friction_step` need of a finger is overloaded here and in
`finger.chain_energy`, so that they serve both kinds.
"""

import warp as wp

from warpgrasp.chain.chain_kernel import (
    Chain,
    ChainPose,
    chain_beyond_stops,
    chain_capsule,
    chain_free_joints,
    chain_joint,
    chain_pose,
    chain_weight,
    placed,
    vec6,
)
from warpgrasp.core.dtypes import ONE, ZERO, real, struct, transform, vec3
from warpgrasp.finger.chain_energy import ChainRest, free_chain, links_moved
from warpgrasp.finger.chain_friction import chain_places, place_jacobian
from warpgrasp.geometry.scene import Scene
from warpgrasp.geometry.segment_distance import lower_end, nearest_on_link
from warpgrasp.mechanism.utah_mit_hand_kernel import beyond_stops, free_joints
from warpgrasp.rubbing.balance import (
    finger_balance,
    hold_of,
    off_balance,
    start_grip,
    stiffened,
    yields_by,
)
from warpgrasp.rubbing.friction_step import predicted, start_rubbed
from warpgrasp.rubbing.link_chain import moved, moved_along


@struct
class ChainGrip:
    """As `balance.Grip`: each capsule against the body, then the same against the table."""

    q: vec6
    drift: vec6
    left: chain_places
    touching: int
    sliding: int
    missed: vec6


@struct
class ChainBalance:
    """As `balance.Balance`."""

    rest: ChainRest
    near_slope: vec6
    grip: ChainGrip
    forced: int
    settled: int


@struct
class ChainHold:
    """As `balance.Hold`."""

    torque: vec6
    by_one: vec6
    by_two: vec6
    holds: real
    resists: real
    away: vec6
    slope: vec6
    left: vec3
    slides: int
    forced: int


@struct
class ChainRubbed:
    """As `friction_step.Rubbed`."""

    command: vec6
    rest: ChainRest
    grip: ChainGrip
    left: ChainGrip
    pressed: int
    missed: vec6


@wp.func
def beyond_stops(hand: Chain, q: vec6):  # noqa: F811 (overloads, from here on)
    """How far each drive is past its upper stop, or, negative, past its lower one [rad]."""
    return chain_beyond_stops(hand, q)


@wp.func
def free_joints(hand: Chain, base: transform, command: vec6):  # noqa: F811
    """Where a finger that touches nothing rests."""
    return chain_free_joints(hand, base, command)


@wp.func
def moved_along(hand: Chain, chain: ChainPose, link: int, at: vec3, d: vec3):  # noqa: F811
    """How far a turn of each drive moves a place of a capsule along `d` [m/rad]."""
    return place_jacobian(hand, chain, link, at, d)


@wp.func
def moved(hand: Chain, chain: ChainPose, link: int, at: vec3, turn: vec6):  # noqa: F811
    """How a `turn` of the drives moves a place of a capsule [m]."""
    way = vec3(ZERO, ZERO, ZERO)
    for j in range(chain_capsule(hand, link).joint + 1):
        row = chain_joint(hand, j)
        way += wp.cross(chain.axis[j], at - chain.at[j]) * (row.factor * turn[row.drive])
    return way


@wp.func
def yields_by(hand: Chain, by: vec6):  # noqa: F811
    """How far a place gives by a newton on it, by the servos alone [m/N]."""
    return wp.dot(by, wp.cw_div(by, hand.stiffness))


@wp.func
def predicted(hand: Chain, command: vec6, rest: ChainRest, other: vec6):  # noqa: F811
    """Drives on another command to first order, from `rest` on `command`."""
    return rest.q + rest.compliance * wp.cw_mul(other - command, hand.stiffness)


@wp.func
def start_grip(q: vec6):  # noqa: F811
    """A finger at drives `q` that touches nothing."""
    grip = ChainGrip()
    grip.q = q
    return grip


@wp.func
def off_balance(rest: ChainRest, grip: ChainGrip):  # noqa: F811
    """A finger before its balance is found."""
    at = ChainBalance()
    at.rest = rest
    at.grip = grip
    return at


@wp.func
def start_rubbed(hand: Chain, base: transform, command: vec6):  # noqa: F811
    """A finger on a command that touches nothing."""
    free = ChainRubbed()
    free.command = command
    free.rest = free_chain(chain_free_joints(hand, base, command))
    free.grip = start_grip(free.rest.q)
    free.left = free.grip
    return free


@wp.func(inline=False)
def finger_balance(  # noqa: F811
    scene: Scene, body: int, hand: Chain, base: transform, command: vec6, q: vec6,
    last: ChainRest, grip: ChainGrip, tried: ChainGrip, samples: int, begins: int
):
    """The torques at drives `q` that are not in balance, their derivative's inverse, and the grip;
    `base` is the hand's pose in the body's frame, the rest as for the overload for a Hand."""
    at = ChainBalance()
    none = ChainHold()
    at.grip.q = q
    at.rest.q = q
    past = chain_beyond_stops(hand, q)
    for d in range(len(q)):
        k = hand.stiffness[d]
        at.rest.drive[d] = (q[d] - command[d]) * k
        at.rest.compliance[d, d] = ONE / wp.where(past[d] == ZERO, k, k + hand.stop)
    pose = chain_pose(hand, base, q)
    if hand.weighs == 1:
        at.rest.drive -= chain_weight(hand, pose)
    at.rest.gradient = at.rest.drive + past * hand.stop
    turned = q - grip.q
    swung, travel = links_moved(hand, q, last.q)
    at.rest.near_depth = -ONE
    table = len(at.rest.depth)  # the contacts with it come after those with the body
    for c in range(hand.capsule_count):
        capsule = chain_capsule(hand, c)
        joint = pose.at[capsule.joint]
        turn = pose.turn[capsule.joint]
        a = placed(joint, turn, capsule.start)
        u = placed(joint, turn, capsule.end) - a
        length = wp.length(u)
        u = wp.normalize(u)
        before = last.depth[c]
        depth = before + travel[capsule.joint] + swung[capsule.joint] * capsule.far
        along = last.along[c]
        bend = last.bend[c]
        if depth >= ZERO or before >= ZERO:
            near = nearest_on_link(scene, body, a, u, length, along, bend, samples,
                                   capsule.radius)
            depth = capsule.radius - near.distance
            along = near.along
            bend = near.bend
            place = a + u * along - near.normal * near.distance
            if depth > ZERO:
                hold = hold_of(hand, pose, c, c, place, near.normal, depth, turned, grip, tried,
                               begins, none)
                at.forced = at.forced + hold.forced
                at.rest.gradient += hold.torque
                at.rest.compliance = stiffened(at.rest.compliance, hold)
                at.grip.left[c] = hold.left
                at.grip.touching = at.grip.touching | (1 << c)
                at.grip.sliding = at.grip.sliding | hold.slides
            elif depth > at.rest.near_depth:
                hold = hold_of(hand, pose, c, c, place, near.normal, depth, turned, grip, tried, 0,
                               none)
                at.rest.near = hold.away
                at.near_slope = hold.slope
                at.rest.near_depth = depth
        low = a + u * lower_end(u, length)
        pressed = capsule.radius - low[2]
        if pressed > ZERO:
            hold = hold_of(hand, pose, c, c + table, vec3(low[0], low[1], ZERO),
                           vec3(ZERO, ZERO, ONE), pressed, turned, grip, tried, begins, none)
            at.forced = at.forced + hold.forced
            at.rest.gradient += hold.torque
            at.rest.compliance = stiffened(at.rest.compliance, hold)
            at.grip.left[c + table] = hold.left
            at.grip.touching = at.grip.touching | (1 << (c + table))
            at.grip.sliding = at.grip.sliding | hold.slides
        at.rest.table[c] = pressed
        at.rest.along[c] = along
        at.rest.bend[c] = bend
        at.rest.depth[c] = depth
    return at
