# type: ignore  # Warp functions, which type checkers cannot follow
"""Where links touch a believed body: the torques of a finger and the body taken together.

Without friction a contact force acts through the axis of a round link, along the body's normal. So
a place along the axis and a direction around it explain the four torques of a finger, up to the
size of the force. With friction the force leans: by a share of its normal part that is taken as
normally distributed, each way along the surface. The posterior over places and directions is the
likelihood of the torques, whatever the size and the lean of the force, times how well the body
agrees: its surface is one link radius from the axis there, its normal is the direction, and no
capsule beside it is nearer to the body.
"""

from typing import Any

import warp as wp

from strategies.contacts.link_places import (
    cell_square,
    direction_at,
    jacobian_at,
    joint_of,
    length_of,
    links_of,
    radius_of,
    round_end,
    start_at,
)
from strategies.contacts.placing_sums import (
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
from warpgrasp.core.turns import sine_cosine
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape, superquadric_deformed_gauge

ALONG = 12
"""Places along a link's axis."""
AROUND = 7
"""Directions around it."""
STATIONS = ALONG + 1
"""Those places and the link's end."""
CAP = 5
"""Directions over the round tip, each way."""
WIDEST = 2.25
"""Directions tried reach this many standard deviations from the body's normal."""
_ALONG = wp.constant(ALONG)
_AROUND = wp.constant(AROUND)
_STATIONS = wp.constant(STATIONS)
_CAP = wp.constant(CAP)
_STEP = wp.constant(real(1.0 / ALONG))
_WIDEST = wp.constant(real(WIDEST))
_AROUND_STEP = wp.constant(real(2.0 * WIDEST / (AROUND - 1)))
_CAP_STEP = wp.constant(real(2.0 * WIDEST / (CAP - 1)))
_TINY = wp.constant(real(1e-300))
_FLAT = wp.constant(real(1e-9))
_LEAST_SLOPE = wp.constant(real(1e-3))
UNLIKELY = wp.constant(real(1e-3))
_BESIDE = wp.constant(real(2e-3))  # [m] how well a body tells which of two capsules is nearer [est]


@wp.func
def world_radius(p: vec3, shape: SuperquadricShape, pose: transform):
    """Gradient and value of the scaled radius of a body at a point of the world."""
    g = superquadric_deformed_gauge(wp.transform_point(wp.transform_inverse(pose), p), shape)
    turned = wp.quat_rotate(wp.transform_get_rotation(pose), vec3(g[0], g[1], g[2]))
    return vec4(turned[0], turned[1], turned[2], g[3])


@struct
class FieldAt:
    """A believed body of any form, as it is at the stations of one finger's links."""

    stations: wp.array3d[vec4]
    """Outward normal and signed distance [m], (world, point, station)."""
    world: int
    point: int


@wp.func
def body_at(p: vec3, shape: SuperquadricShape, pose: transform):
    """Outward normal and first-order signed distance of a superquadric at a point [m]; no normal
    where it has no gradient."""
    g = world_radius(p, shape, pose)
    slope = wp.length(vec3(g[0], g[1], g[2]))
    n = vec3(g[0], g[1], g[2]) / slope
    away = (g[3] - ONE) / wp.max(slope, _LEAST_SLOPE)
    if wp.isfinite(away):
        return vec4(n[0], n[1], n[2], away)
    return vec4(ZERO, ZERO, ZERO, ONE)


@wp.func
def _unexplained(
    f: Any, link: int, x: vec3, d: vec3, radius: real, lean: real, felt: Any, root: Any,
    total: real
):
    """What the best push along -d at x leaves of the torques: chi-square, and one over how much
    wider a force that leans makes their spread. `lean` is the deviation of its lean."""
    j = wp.cw_mul(jacobian_at(f, link, x, d), root)
    size = wp.max(wp.dot(j, j), _TINY)
    push = wp.max(wp.dot(j, felt), ZERO)
    if lean == ZERO:
        return vec2(total - push * push / size, ONE)
    # Spread of the torques: one, and that of a force along the surface both ways, for the push
    # that explains most without it.
    one = wp.cross(direction_at(f, link), d)
    one *= ONE / wp.max(wp.length(one), _TINY)
    two = wp.cross(d, one)
    skin = x + d * radius
    a = wp.cw_mul(jacobian_at(f, link, skin, one), root) * (lean * push / size)
    b = wp.cw_mul(jacobian_at(f, link, skin, two), root) * (lean * push / size)
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
    push = wp.max(jf, ZERO)
    return vec2(ff - push * push / wp.max(jj, _TINY), wp.sqrt(narrower))


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
    f: Any, hand: Any, link_weight: Any, shape: SuperquadricShape, pose: transform, world: int,
    point: int, field: wp.array3d[vec4]
):
    """A superquadric at the stations that a contact is looked for at."""
    for link in range(links_of(hand)):
        if link_weight[joint_of(hand, link)] >= UNLIKELY:
            a = start_at(f, link)
            u = direction_at(f, link)
            for k in range(_ALONG + wp.min(round_end(hand, link), 1)):
                field[world, point, link * _STATIONS + k] = body_at(
                    a + u * station_along(k, length_of(hand, link)), shape, pose)


@wp.func(inline=False)
def places_of_link(
    f: Any, link: int, ends: int, length: real, radius: real, lean: real, felt: Any, root: Any,
    believed: FieldAt, place_sigma: real, turn_sigma: real, farthest: real
):
    """The posterior over the places of one link; with `ends` 1 it has a round tip, with 2 it is a
    ball."""
    post = Place()
    post.least = WORST
    post.alone_least = WORST
    total = wp.dot(felt, felt)
    a = start_at(f, link)
    u = direction_at(f, link)
    sharp = ONE / (turn_sigma * turn_sigma)
    stations = _ALONG + wp.min(ends, 1)
    for k in range(stations):
        tip = k == _ALONG
        along = station_along(k, length)
        x = a + u * along
        body = believed.stations[believed.world, believed.point, link * _STATIONS + k]
        towards = -vec3(body[0], body[1], body[2])
        inwards = wp.dot(towards, u)
        middle = towards - u * inwards
        if tip:
            middle = towards - u * wp.where(ends == 2, ZERO, wp.min(inwards, ZERO))
        if wp.length(middle) > _FLAT:
            middle = wp.normalize(middle)
            e1 = wp.normalize(wp.cross(u, middle))
            e2 = wp.cross(middle, e1)
            miss = wp.min(wp.abs(body[3] - radius), farthest) / place_sigma
            here = Around()
            here.least = WORST
            area = radius * length * _STEP * _AROUND_STEP * turn_sigma
            if tip:
                area = radius * radius * _CAP_STEP * _CAP_STEP * turn_sigma * turn_sigma
                for i in range(_CAP):
                    for j in range(_CAP):
                        p = (real(i) * _CAP_STEP - _WIDEST) * turn_sigma
                        q = (real(j) * _CAP_STEP - _WIDEST) * turn_sigma
                        d = wp.normalize(middle + e1 * p + e2 * q)
                        if wp.dot(d, u) >= ZERO or ends == 2:
                            off = wp.length_sq(d - towards) * sharp
                            chi = _unexplained(f, link, x, d, radius, lean, felt, root, total)
                            here = with_direction(here, d, chi[0] + off, chi[1])
            else:
                for i in range(_AROUND):
                    turn = sine_cosine((real(i) * _AROUND_STEP - _WIDEST) * turn_sigma)
                    d = middle * turn[1] + e1 * turn[0]
                    off = wp.length_sq(d - towards) * sharp
                    chi = _unexplained(f, link, x, d, radius, lean, felt, root, total)
                    here = with_direction(here, d, chi[0] + off, chi[1])
            if here.weight > ZERO:
                post = with_place(post, here, x, along, area, miss * miss)
    return post


@struct
class Placed:
    """Where a contact is taken to be."""

    point: vec3
    covariance: mat33
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
    f: Any, hand: Any, felt: Any, root: Any, link_weight: Any, logs: Any, lean: real,
    believed: FieldAt, place_sigma: real, turn_sigma: real, farthest: real, normal_variance: real
):
    """The likeliest place of a contact of a finger. `felt` are its torques in units of their
    deviations, `root` one over these; `logs` has room for a number a link."""
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
                                  radius_of(hand, link), lean, felt, root, believed,
                                  place_sigma, turn_sigma, farthest)
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
    return out
