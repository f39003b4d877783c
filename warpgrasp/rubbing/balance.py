# type: ignore  # Warp functions, which type checkers cannot follow
"""The balance of torques of a finger whose skin rubs, and how it changes with the joints.

The law is that of `friction`, with nothing lagged: normal forces N, places of contact and
directions along the surface are those of the joints at hand. There is then no energy. What is to
vanish is the sum of torques of servos, weight, stops and skin. Where a contact slides, its force
along the surface changes with N: a row and a column of the derivative that are not the same, so
that it is not symmetric (Alart and Curnier 1991, the derivative of their projected forces).
"""

from typing import Any

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, mat44, real, struct, transform, vec3, vec4
from warpgrasp.finger.energy import Equilibrium, pick, put
from warpgrasp.finger.friction import SHEAR, places
from warpgrasp.geometry.scene import Scene
from warpgrasp.geometry.segment_distance import lower_end, nearest_on_link
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand, beyond_stops
from warpgrasp.rubbing.link_chain import finger_chain, lifted, moved, moved_along

_SHEAR = wp.constant(real(SHEAR))
_UNSTRETCHED = wp.constant(real(1e-12))  # [m]


@struct
class Grip:
    """How the skin of a finger at rest is stretched, as the next step finds it.

    `q` are the joints, `drift` how they would turn in the next step if nothing new came in touch;
    `left` [m] is the stretch at each of six contacts: three links against the body, then the same
    against the table. `touching` has a bit for each contact that touches, `sliding` for each that
    slides. `missed` is how far the joints of a hand's finger rest from where they were
    foreseen to first order [rad], where the contacts did what they had done in the step before.
    """

    q: vec4
    drift: vec4
    left: places
    touching: int
    sliding: int
    missed: vec4


@struct
class Balance:
    """A finger at joints: `rest`, whose `gradient` are the torques that are not in balance [N m]
    and whose `compliance` is the inverse of their derivative, and the `grip` there.

    `near_slope` is what the nearest place that bears no load would change torques by if it were
    pressed in, sliding [N m/m]. `forced` counts contacts that are held with more force than they
    can bear. `settled` is 1 where a search for balance has ended. The fields of `rest` for energies
    are not set.
    """

    rest: Equilibrium
    near_slope: vec4
    grip: Grip
    forced: int
    settled: int


@struct
class Hold:
    """What a pressed place does: torques [N m], their derivative, and how its skin is stretched."""

    torque: vec4
    by_one: vec4
    by_two: vec4
    holds: real
    resists: real
    away: vec4
    slope: vec4
    left: vec3
    slides: int
    forced: int


@wp.func
def start_grip(q: vec4):
    """A finger at joints `q` that touches nothing."""
    grip = Grip()
    grip.q = q
    return grip


@wp.func
def off_balance(rest: Equilibrium, grip: Grip):
    """A finger before its balance is found."""
    at = Balance()
    at.rest = rest
    at.grip = grip
    return at


@wp.func
def yields_by(hand: Hand, by: vec4):
    """How far a place gives by a newton on it, by the servos alone [m/N]; `by` is its Jacobian."""
    return wp.dot(by, by) / hand.stiffness


@wp.func
def hold_of(
    hand: Any, chain: Any, link: int, contact: int, place: vec3, normal: vec3, depth: real,
    turned: Any, grip: Any, tried: Any, begins: int, none: Any
):
    """What skin does that is pressed in by `depth` at a `place` of the surface, the joints `turned`
    since `grip`; less than 0 for a place that is near, which then slides. `none` is an empty Hold,
    or that of a chain."""
    hold = none
    away = moved_along(hand, chain, link, place, normal)
    hold.away = away
    force = hand.skin * depth
    n = wp.normalize(normal)
    turn = turned
    if (grip.touching & (1 << contact)) == 0:
        # It holds from where the link comes in touch on the way of `drift`.
        before = depth + wp.dot(away, turned)
        closes = -wp.dot(away, grip.drift)
        share = real(1.0)
        if closes > ZERO:
            share = wp.clamp(-before / closes, ZERO, ONE)
        turn -= grip.drift * share
    e = grip.left[contact] + moved(hand, chain, link, place, turn)
    e -= n * wp.dot(n, e)
    size = wp.length(e)
    one = e / size
    if size < _UNSTRETCHED:
        one = wp.where(wp.abs(n[0]) < HALF, vec3(ONE, ZERO, ZERO), vec3(ZERO, ONE, ZERO))
        one = wp.normalize(one - n * wp.dot(n, one))
    by_one = moved_along(hand, chain, link, place, one)
    by_two = moved_along(hand, chain, link, place, wp.cross(n, one))
    shear = hand.skin * _SHEAR
    limit = hand.friction * force
    # Torques of the forces across and along the surface; what changes with the depth comes first.
    slope = away * hand.skin
    along = shear * size
    resists = shear
    if along > limit and (tried.sliding & (1 << contact)) != 0 and wp.dot(
            e, tried.left[contact]) < ZERO:
        # It went past where it would have held.
        hold.forced = 1
    if along > limit and hold.forced == 0:
        slope -= by_one * (hand.friction * hand.skin)
        along = limit
        resists = limit / size
        if begins == 1 and (grip.touching & (1 << contact)) == 0:
            # Deep in at first, it will bear what the servos press it with.
            resists = hand.friction * depth / (
                size * (ONE / hand.skin + yields_by(hand, away)))
        hold.left = one * (limit / shear)
        hold.slides = 1 << contact
    else:
        hold.holds = shear
        hold.left = e
    hold.slope = slope
    hold.torque = by_one * along - away * force
    hold.by_one = by_one
    hold.by_two = by_two
    hold.resists = resists
    return hold


@wp.func
def stiffened(compliance: Any, hold: Any):
    """A compliance with a place that is pressed, by the formula of Sherman and Morrison."""
    c = compliance
    yields = c * hold.slope
    c -= wp.outer(yields, (hold.away * c) / (ONE + wp.dot(hold.away, yields)))
    if hold.holds > ZERO:
        yields = c * hold.by_one
        c -= wp.outer(yields, (hold.by_one * c) / (ONE / hold.holds + wp.dot(hold.by_one, yields)))
    yields = c * hold.by_two
    c -= wp.outer(yields, (hold.by_two * c) * (hold.resists / (
        ONE + hold.resists * wp.dot(hold.by_two, yields))))
    return c


@wp.func(inline=False)
def finger_balance(
    scene: Scene, body: int, hand: Hand, base: transform, command: vec4, q: vec4,
    last: Equilibrium, grip: Grip, tried: Grip, samples: int, begins: int
):
    """The torques at joints `q` that are not in balance, their derivative's inverse, and the grip.

    `base`, `last` and `samples` are as for `finger_energy`; `grip` is that of the rest on the
    command before, `tried` that at the joints tried last: a contact that has slid one way and would
    slide the other is held. `begins` is 1 for the first joints that are tried.
    """
    at = Balance()
    none = Hold()
    at.grip.q = q
    at.rest.q = q
    k = hand.stiffness
    chain = finger_chain(hand, base, q)
    past = beyond_stops(hand, q)
    c = k + hand.stop
    loose = ONE / k
    stopped = ONE / c
    at.rest.compliance = mat44(wp.where(past[0] == ZERO, loose, stopped), ZERO, ZERO, ZERO,
                               ZERO, wp.where(past[1] == ZERO, loose, stopped), ZERO, ZERO,
                               ZERO, ZERO, wp.where(past[2] == ZERO, loose, stopped), ZERO,
                               ZERO, ZERO, ZERO, wp.where(past[3] == ZERO, loose, stopped))
    at.rest.drive = (q - command) * k
    if hand.weight[0] > ZERO:
        at.rest.drive += lifted(hand, chain)
    at.rest.gradient = at.rest.drive + past * hand.stop
    turned = q - grip.q
    flexed = vec3(wp.abs(q[1] - last.q[1]), wp.abs(q[2] - last.q[2]), wp.abs(q[3] - last.q[3]))
    at.rest.near_depth = -ONE
    swung = wp.abs(q[0] - last.q[0])
    travel = swung * hand.abduction_offset
    for link in range(3):
        a = chain.starts[link]
        way = chain.ways[link]
        length = pick(hand.link_length, link)
        swung += pick(flexed, link)
        travel += swung * length
        before = pick(last.depth, link)
        depth = before + travel
        along = pick(last.along, link)
        bend = pick(last.bend, link)
        if depth >= ZERO or before >= ZERO:
            near = nearest_on_link(scene, body, a, way, length, along, bend, samples,
                                   hand.link_radius)
            depth = hand.link_radius - near.distance
            along = near.along
            bend = near.bend
            if depth > ZERO:
                hold = hold_of(hand, chain, link, link,
                               a + way * along - near.normal * near.distance, near.normal, depth,
                               turned, grip, tried, begins, none)
                at.forced = at.forced + hold.forced
                at.rest.gradient += hold.torque
                at.rest.compliance = stiffened(at.rest.compliance, hold)
                for j in range(3):
                    at.grip.left[link, j] = hold.left[j]
                at.grip.touching = at.grip.touching | (1 << link)
                at.grip.sliding = at.grip.sliding | hold.slides
            elif depth > at.rest.near_depth:
                hold = hold_of(hand, chain, link, link,
                               a + way * along - near.normal * near.distance, near.normal, depth,
                               turned, grip, tried, 0, none)
                at.rest.near = hold.away
                at.near_slope = hold.slope
                at.rest.near_depth = depth
        low = a + way * lower_end(way, length)
        pressed = hand.link_radius - low[2]
        if pressed > ZERO:
            hold = hold_of(hand, chain, link, link + 3, vec3(low[0], low[1], ZERO),
                         vec3(ZERO, ZERO, ONE), pressed, turned, grip, tried, begins, none)
            at.forced = at.forced + hold.forced
            at.rest.gradient += hold.torque
            at.rest.compliance = stiffened(at.rest.compliance, hold)
            for j in range(3):
                at.grip.left[link + 3, j] = hold.left[j]
            at.grip.touching = at.grip.touching | (1 << (link + 3))
            at.grip.sliding = at.grip.sliding | hold.slides
        at.rest.table = put(at.rest.table, link, pressed)
        at.rest.along = put(at.rest.along, link, along)
        at.rest.bend = put(at.rest.bend, link, bend)
        at.rest.depth = put(at.rest.depth, link, depth)
    return at
