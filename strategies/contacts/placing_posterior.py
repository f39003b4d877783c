# type: ignore  # Warp functions, which type checkers cannot follow
"""Where links touch a believed body: the torques of a finger and the body taken together.

Without friction a contact force acts through the axis of a round link, along the body's normal. So
a place along the axis and a direction around it explain the four torques of a finger, up to the
size of the force. With friction the force leans as the link sticks or slides
(`warpgrasp.finger.sliding`): by a share of its normal part that is taken as normally distributed,
along the way it leans and across. The posterior over places and directions is the likelihood of the
torques, whatever the size and the lean of the force, times how well the body agrees: its surface is
one link radius from the axis there, its normal is the direction, and no capsule beside it is nearer
to the body.
"""

from typing import Any

import warp as wp

from strategies.contacts.directions_lanes import directions_in_lanes
from strategies.contacts.link_places import (
    cell_square,
    direction_at,
    jacobian_at,
    joint_of,
    length_of,
    links_of,
    radius_of,
    round_end,
    servo_ease,
    start_at,
    turning_at,
)
from strategies.contacts.placing_sums import (
    AROUND,
    CAP,
    LEVEL,
    NEGLIGIBLE,
    WORST,
    Around,
    Place,
    with_direction,
    with_place,
)
from warpgrasp.core.dtypes import (
    HALF,
    ONE,
    TWO,
    ZERO,
    mat33,
    real,
    struct,
    transform,
    vec2,
    vec3,
    vec4,
)
from warpgrasp.finger.sliding import force_lean
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape
from warpgrasp.geometry.superquadric_gauges import gauges_at

ALONG = 12
"""Places along a link's axis."""
STATIONS = ALONG + 1
"""Those places and the link's end."""
WIDEST = 2.25
"""Directions tried reach this many standard deviations from the body's normal."""
_ALONG = wp.constant(ALONG)
_AROUND = wp.constant(AROUND)
_STATIONS = wp.constant(STATIONS)
_CAP = wp.constant(CAP)
_STEP = wp.constant(real(1.0 / ALONG))
_AROUND_STEP = wp.constant(real(2.0 * WIDEST / (AROUND - 1)))
_CAP_STEP = wp.constant(real(2.0 * WIDEST / (CAP - 1)))
_TINY = wp.constant(real(1e-300))
_HELD = wp.constant(real(1e-100))  # one over the deviation of a torque that says nothing
_LEVEL = wp.constant(real(LEVEL))
_FLAT = wp.constant(real(1e-9))
_LEAST_SLOPE = wp.constant(real(1e-3))
UNLIKELY = wp.constant(real(1e-3))  # of a link, and of a capsule beside the likeliest: left out
_BESIDE = wp.constant(real(2e-3))  # [m] how well a body tells which of two capsules is nearer [est]


@struct
class FieldAt:
    """A believed body of any form, as it is at the stations of one finger's links."""

    stations: wp.array3d[vec4]
    """Outward normal and signed distance [m], (world, point, station)."""
    world: int
    point: int


@struct
class Tried:
    """The directions tried about the body's normal."""

    direction: wp.array[vec3]
    """Those around a link, then those about a tip: how much of the middle direction, of the one
    across it and of that over it."""
    turn_sigma: real
    """How well the body predicts the direction of its surface [rad]."""
    has_lanes: wp.bool
    """Whether the processor's vectors sum them up."""


@wp.func
def _unexplained(
    by_x: Any, by_y: Any, by_z: Any, turn_x: Any, turn_y: Any, turn_z: Any, along: vec3, d: vec3,
    radius: real, felt: Any, step: Any, ease: Any, friction: real
):
    """What the best push along -d leaves of the torques: chi-square, and one over how much wider a
    force that leans makes their spread.

    `by_x` to `turn_z` are the motion of a place of the axis along x, y and z and its turning about
    them, per radian of each joint and in deviations of the torques; `along` points along the link,
    `felt` are the torques, `step` and `ease` how the command turned the joints and how they yield.
    """
    total = wp.dot(felt, felt)
    j = by_x * d[0] + by_y * d[1] + by_z * d[2]
    if friction == ZERO:
        push = wp.max(wp.dot(j, felt), ZERO)
        return vec2(total - push * push / wp.max(wp.dot(j, j), _TINY), ONE)
    # Along the surface both ways, at the skin, a radius off the axis.
    one = wp.cross(along, d)
    one *= ONE / wp.max(wp.length(one), _TINY)
    two = wp.cross(d, one)
    a = (by_x * one[0] + by_y * one[1] + by_z * one[2]
         + (turn_x * two[0] + turn_y * two[1] + turn_z * two[2]) * radius)
    b = (by_x * two[0] + by_y * two[1] + by_z * two[2]
         - (turn_x * one[0] + turn_y * one[1] + turn_z * one[2]) * radius)
    lean = force_lean(j, a, b, step, ease, friction)
    j += a * lean.mean[0] + b * lean.mean[1]
    size = wp.max(wp.dot(j, j), _TINY)
    # Spread of the torques: one, and that of the force's lean along its way and across, for the
    # push that explains most without it.
    push = wp.max(wp.dot(j, felt), ZERO) / size
    ahead = (a * lean.along[0] + b * lean.along[1]) * push
    b = (a * lean.across[0] + b * lean.across[1]) * push
    a = ahead
    aa = ONE + wp.dot(a, a)
    bb = ONE + wp.dot(b, b)
    ab = wp.dot(a, b)
    narrower = ONE / (aa * bb - ab * ab)
    # The inverse of that spread, times j and times the torques (Woodbury).
    ja = wp.dot(j, a)
    jb = wp.dot(j, b)
    fa = wp.dot(felt, a)
    fb = wp.dot(felt, b)
    jj = size - (bb * ja * ja - TWO * ab * ja * jb + aa * jb * jb) * narrower
    jf = wp.dot(j, felt) - (bb * ja * fa - ab * (ja * fb + jb * fa) + aa * jb * fb) * narrower
    ff = total - (bb * fa * fa - TWO * ab * fa * fb + aa * fb * fb) * narrower
    left = wp.max(jf, ZERO)
    return vec2(ff - left * left / wp.max(jj, _TINY), wp.sqrt(narrower))


@wp.func
def station_along(station: int, length: real):
    """Where along a link a station is, from its start; the last one is its end."""
    if station == _ALONG:
        return length
    return (real(station) + HALF) * _STEP * length


@wp.func
def write_stations(f: Any, hand: Any, world: int, point: int, station: wp.array3d[vec3]):
    """Where the stations of a finger's links are, link by link."""
    for link in range(links_of(hand)):
        a = start_at(f, link)
        u = direction_at(f, link)
        for k in range(_STATIONS):
            station[world, point, link * _STATIONS + k] = a + u * station_along(
                k, length_of(hand, link))


@wp.func
def write_field(
    f: Any, hand: Any, link_weight: Any, shape: SuperquadricShape, pose: transform, has_lanes: bool,
    world: int, point: int, field: wp.array3d[vec4]
):
    """A superquadric at the stations that a contact is looked for at: outward normal and
    first-order signed distance [m]; no normal where it has no gradient."""
    for link in range(links_of(hand)):
        if link_weight[joint_of(hand, link)] >= UNLIKELY:
            a = start_at(f, link)
            u = direction_at(f, link)
            first = link * _STATIONS
            stations = _ALONG + wp.min(round_end(hand, link), 1)
            for k in range(stations):
                x = a + u * station_along(k, length_of(hand, link))
                field[world, point, first + k] = vec4(x[0], x[1], x[2], ZERO)
            gauges_at(shape, pose, has_lanes, field, world, point, first, stations)
            for k in range(stations):
                g = field[world, point, first + k]
                slope = wp.length(vec3(g[0], g[1], g[2]))
                away = (g[3] - ONE) / wp.max(slope, _LEAST_SLOPE)
                if wp.isfinite(away):
                    field[world, point, first + k] = vec4(
                        g[0] / slope, g[1] / slope, g[2] / slope, away)
                else:
                    field[world, point, first + k] = vec4(ZERO, ZERO, ZERO, ONE)


@wp.func(inline=False)
def places_of_link(
    f: Any, link: int, ends: int, length: real, radius: real, felt: Any, step: Any, ease: Any,
    root: Any, friction: real, believed: FieldAt, tried: Tried, place_sigma: real, farthest: real
):
    """The posterior over the places of one link; with `ends` 1 it has a round tip, with 2 it is a
    ball."""
    post = Place()
    post.least = WORST
    post.alone_least = WORST
    a = start_at(f, link)
    u = direction_at(f, link)
    # Of its start, and of each metre along it.
    start_x = wp.cw_mul(jacobian_at(f, link, a, vec3(ONE, ZERO, ZERO)), root)
    start_y = wp.cw_mul(jacobian_at(f, link, a, vec3(ZERO, ONE, ZERO)), root)
    start_z = wp.cw_mul(jacobian_at(f, link, a, vec3(ZERO, ZERO, ONE)), root)
    turn_x = wp.cw_mul(turning_at(f, link, vec3(ONE, ZERO, ZERO)), root)
    turn_y = wp.cw_mul(turning_at(f, link, vec3(ZERO, ONE, ZERO)), root)
    turn_z = wp.cw_mul(turning_at(f, link, vec3(ZERO, ZERO, ONE)), root)
    grow_x = turn_y * u[2] - turn_z * u[1]
    grow_y = turn_z * u[0] - turn_x * u[2]
    grow_z = turn_x * u[1] - turn_y * u[0]
    stations = _ALONG + wp.min(ends, 1)
    for k in range(stations):
        tip = k == _ALONG
        along = station_along(k, length)
        body = believed.stations[believed.world, believed.point, link * _STATIONS + k]
        towards = -vec3(body[0], body[1], body[2])
        inwards = wp.dot(towards, u)
        middle = towards - u * inwards
        if tip:
            middle = towards - u * wp.where(ends == 2, ZERO, wp.min(inwards, ZERO))
        if wp.length(middle) > _FLAT:
            middle = wp.normalize(middle)
            across = wp.normalize(wp.cross(u, middle))
            over = wp.cross(middle, across)
            by_x = start_x + grow_x * along
            by_y = start_y + grow_y * along
            by_z = start_z + grow_z * along
            begin = int(0)
            end = int(_AROUND)
            area = radius * length * _STEP * _AROUND_STEP * tried.turn_sigma
            if tip:
                begin = int(_AROUND)
                end = int(_AROUND + _CAP * _CAP)
                area = radius * radius * _CAP_STEP * _CAP_STEP * tried.turn_sigma * tried.turn_sigma
            all_around = not tip or ends == 2
            sharp = ONE / (tried.turn_sigma * tried.turn_sigma)
            here = Around()
            here.least = WORST
            if tried.has_lanes:
                sums = directions_in_lanes(
                    by_x, by_y, by_z, turn_x, turn_y, turn_z, felt, tried.direction, begin, end,
                    all_around, middle, across, over, u, towards, radius, friction, step, ease,
                    sharp)
                here.least = sums[0]
                here.weight = sums[1]
                here.outward = vec3(sums[2], sums[3], sums[4])
                here.most = sums[5]
                here.misfit = sums[6]
            else:
                for n in range(begin, end):
                    share = tried.direction[n]
                    d = middle * share[0] + across * share[1] + over * share[2]
                    if all_around or wp.dot(d, u) >= -_LEVEL:
                        off = wp.length_sq(d - towards) * sharp
                        chi = _unexplained(by_x, by_y, by_z, turn_x, turn_y, turn_z, u, d, radius,
                                           felt, step, ease, friction)
                        here = with_direction(here, d, chi[0] + off, chi[1])
            if here.weight > ZERO:
                miss = wp.min(wp.abs(body[3] - radius), farthest) / place_sigma
                post = with_place(post, here, a + u * along, along, area, miss * miss)
    return post


@struct
class Placed:
    """Where a contact is taken to be."""

    point: vec3
    covariance: mat33
    """About `point` [m2], on whichever capsule of its link the contact may be."""
    normal: vec3
    chance: real
    """Probability of the link that bears it; 0 where none can."""
    misfit: real


@wp.func
def _gap(hand: Any, link: int, believed: FieldAt):
    """How far from the body a link is where it is nearest, less than 0 inside [m]."""
    nearest = WORST
    for k in range(_ALONG + wp.min(round_end(hand, link), 1)):
        nearest = wp.min(nearest, believed.stations[believed.world, believed.point,
                                                    link * _STATIONS + k][3])
    return nearest - radius_of(hand, link)


@wp.func
def _behind(hand: Any, link: int, believed: FieldAt):
    """How much nearer to the body another capsule of the same joint is [m], 0 where none is. A
    body that is off is off by the same for both."""
    most = ZERO
    gap = _gap(hand, link, believed)
    for other in range(links_of(hand)):
        if other != link and joint_of(hand, other) == joint_of(hand, link):
            most = wp.max(most, gap - _gap(hand, other, believed))
    return most


@wp.func(inline=False)
def placed_contact(
    f: Any, hand: Any, torque: Any, root: Any, step: Any, link_weight: Any, logs: Any,
    friction: real, believed: FieldAt, tried: Tried, place_sigma: real, farthest: real,
    normal_variance: real
):
    """The likeliest place of a contact of a finger. `root` is one over the deviations of its
    torques, `step` the command's last one; `logs` has room for a number a link."""
    # In units of these deviations; a joint that its stop holds goes nowhere.
    felt = wp.cw_mul(torque, root)
    went = step * ZERO
    ease = step * ZERO
    for k in range(len(root)):
        if root[k] > _HELD:
            went[k] = step[k] / root[k]
            ease[k] = servo_ease(hand, k) / (root[k] * root[k])
    out = Placed()
    out.covariance = wp.identity(n=3, dtype=wp.float64)
    best = Place()
    best.least = WORST
    best_link = int(-1)
    most = real(-WORST)
    for link in range(links_of(hand)):
        logs[link] = -WORST
        if link_weight[joint_of(hand, link)] >= UNLIKELY:
            post = places_of_link(f, link, round_end(hand, link), length_of(hand, link),
                                  radius_of(hand, link), felt, went, ease, root, friction,
                                  believed, tried, place_sigma, farthest)
            if post.weight > ZERO:
                # Of capsules side by side the one behind cannot have touched.
                behind = wp.min(_behind(hand, link, believed), farthest) / _BESIDE
                logs[link] = wp.log(post.weight) - HALF * (post.least + behind * behind)
                if logs[link] > most:
                    most = logs[link]
                    best = post
                    best_link = link
    if best_link < 0:
        return out
    alike = real(0.0)
    others = real(0.0)
    for link in range(links_of(hand)):
        share = wp.exp(wp.max(logs[link] - most, -NEGLIGIBLE))
        others += share
        if joint_of(hand, link) == joint_of(hand, best_link):
            alike += share
    outward = wp.normalize(best.outward)
    u = direction_at(f, best_link)
    mean = best.alone_along / best.alone
    spread = wp.max(best.alone_square / best.alone - mean * mean,
                    cell_square(hand, best_link, _STEP) / real(12.0))
    out.point = best.axis / best.weight + outward * radius_of(hand, best_link)
    # Of the place along the axis as torques tell it: what the body says is no evidence of its own.
    out.covariance = (wp.identity(n=3, dtype=wp.float64) * normal_variance
                      + wp.outer(u, u) * spread)
    out.normal = -outward
    out.chance = alike / others
    out.misfit = best.misfit
    for link in range(links_of(hand)):
        if link != best_link and joint_of(hand, link) == joint_of(hand, best_link):
            share = wp.exp(wp.max(logs[link] - most, -NEGLIGIBLE))
            if share > UNLIKELY:
                # It may as well be where it would be on this capsule.
                post = places_of_link(f, link, round_end(hand, link), length_of(hand, link),
                                      radius_of(hand, link), felt, went, ease, root, friction,
                                      believed, tried, place_sigma, farthest)
                off = (post.axis / post.weight - out.point
                       + wp.normalize(post.outward) * radius_of(hand, link))
                out.covariance += wp.outer(off, off) * (share / alike)
    return out
