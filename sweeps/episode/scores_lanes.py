# type: ignore  # Warp functions, which type checkers cannot follow
"""Surface elements, distances and signed distances for `LANES` points side by side, of one plain
superquadric: what `surface_elements_kernel` and `scores_kernel` do one by one.

C++ for Clang, see `warpgrasp.geometry.superquadric_lanes`.
"""

import warp as wp

from warpgrasp.core.dtypes import real, transform, vec3, vec4
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape
from warpgrasp.geometry.superquadric_lanes import SUPERQUADRIC_LANES

TILE = (4, 4)
"""Elements of a face that follow each other: so many rows and columns of its grid."""
PATCH = TILE[0] * TILE[1]
"""So many share a ball."""
PROJECTIONS = 2
"""Three and four change no mean by 0.1 %."""
NEAR = 0.1
"""Square of what is left to go, in that of the last step or radius."""
SETTLED = 4e-6
"""[m]: a step aside then gains some two micrometres."""

_GAUGES = SUPERQUADRIC_LANES + """
    const places d = gathered(direction.data + begin, [&](int l) {
        return begin + l < end ? l : 0; });
    const slopes g = gauge(places{d.x * s.size[0], d.y * s.size[1], d.z * s.size[2]});
    wp::vec4d* out = found.data + (size_t)world * found.shape[1] + begin;
    for (int l = 0; l < L && begin + l < end; ++l)
        out[l] = wp::vec4d(g.by.x[l], g.by.y[l], g.by.z[l], g.value[l]);
#endif
"""


@wp.func_native(_GAUGES)
def gauges_in_lanes(
    world: int, begin: int, end: int, s: SuperquadricShape, pose: transform,
    direction: wp.array[vec3], found: wp.array2d[vec4],
):
    """Gradients and values of the gauge in directions of the first octant."""


_ELEMENTS = SUPERQUADRIC_LANES + """
    auto of = [&](int l) { return begin + l < end ? begin + l : begin; };
    const wp::vec3d* vertices = vertex.data + (size_t)world * vertex.shape[1];
    const places d = gathered(direction.data, of);
    slopes g;
    for (int l = 0; l < L; ++l) {
        const wp::vec4d& one = gauge_at.data[(size_t)world * gauge_at.shape[1]
                                             + octant.data[of(l)]];
        g.by.x[l] = one[0];
        g.by.y[l] = one[1];
        g.by.z[l] = one[2];
        g.value[l] = one[3];
    }
    places corners[4];
    for (int c = 0; c < 4; ++c)
        corners[c] = gathered(vertices, [&](int l) { return corner.data[of(l)][c]; });
    const places a = from_to(corners[0], corners[2]), b = from_to(corners[1], corners[3]);
    const places facet = {0.5 * (a.y * b.z - a.z * b.y), 0.5 * (a.z * b.x - a.x * b.z),
                          0.5 * (a.x * b.y - a.y * b.x)};
    const reals size = root(dot(facet, facet)), inward = 1.0 / g.value;
    const places on = tapered(places{d.x * s.size[0] * inward, d.y * s.size[1] * inward,
                                     d.z * s.size[2] * inward});
    // The gauge grows evenly outwards, so its gradient on the surface is the direction's.
    const places by = tapered_slopes(places{d.x < 0.0 ? -g.by.x : g.by.x,
        d.y < 0.0 ? -g.by.y : g.by.y, d.z < 0.0 ? -g.by.z : g.by.z}, on);
    // Where a deformed corner leaves no gradient, the facet's own normal stands in.
    const reals steep = root(dot(by, by)), flat = 1.0 / more(size, (reals)1e-300);
    const flags known = (steep > 0.0) & (steep < 1e300);
    const reals level = 1.0 / steep;
    const places n = {known ? by.x * level : facet.x * flat, known ? by.y * level : facet.y * flat,
                      known ? by.z * level : facet.z * flat};
    const places outward = turned(n), there = turned(on);
    const size_t row = (size_t)world * area.shape[1] + begin;
    for (int l = 0; l < L && begin + l < end; ++l) {
        point.data[row + l] = wp::vec3d(there.x[l], there.y[l], there.z[l]) + pose.p;
        normal.data[row + l] = wp::vec3d(outward.x[l], outward.y[l], outward.z[l]);
        area.data[row + l] = size[l];
    }
#endif
"""


@wp.func_native(_ELEMENTS)
def elements_in_lanes(
    world: int, begin: int, end: int, s: SuperquadricShape, pose: transform,
    corner: wp.array[wp.vec4i], direction: wp.array[vec3], octant: wp.array[int],
    gauge_at: wp.array2d[vec4], vertex: wp.array2d[vec3], point: wp.array2d[vec3],
    normal: wp.array2d[vec3], area: wp.array2d[real],
):
    """Elements `begin` to `end`; as `_element_kernel` goes on."""


_DISTANCES = SUPERQUADRIC_LANES + """
    // The nearest element of each point.
    const int count = end - begin, elements = element.shape[1], patches = ball.shape[2];
    const wp::vec3d* on_body = element.data + (size_t)world * elements;
    const double* balls = ball.data + (size_t)world * 4 * patches;
    places p = gathered(point.data + begin, [&](int l) { return l < count ? l : 0; });
    const wp::vec3d middle = point.data[(begin + end) / 2];
    const places around = {middle[0] - p.x, middle[1] - p.y, middle[2] - p.z};
    const double wide = __builtin_reduce_max(root(dot(around, around)));
    auto apart = [&](int g, int of) {  // to the middles of `L` balls
        return *(const anywhere*)(balls + (size_t)of * patches + g) - middle[of]; };
    auto away_from = [&](int g) {
        const reals x = apart(g, 0), y = apart(g, 1), z = apart(g, 2);
        return x * x + y * y + z * z; };
    reals least = 1e18;
    flags first = 0, number;
    for (int l = 0; l < L; ++l)
        number[l] = l;
    for (int g = 0; g < patches; g += L, number += flags(L)) {
        const reals square = away_from(g);
        first = square < least ? number : first;
        least = less(square, least);
    }
    const double nearest_square = __builtin_reduce_min(least);
    int nearest = 0;
    for (int l = L - 1; l >= 0; --l)
        nearest = least[l] == nearest_square ? first[l] : nearest;

    reals best = 1e18;
    flags found = 0;
    auto look = [&](int g) {
        const int stop = wp::min((g + 1) * PATCH, elements);
        for (int m = g * PATCH; m < stop; ++m) {
            const wp::vec3d& e = on_body[m];
            const reals x = p.x - e[0], y = p.y - e[1], z = p.z - e[2];
            const reals square = x * x + y * y + z * z;
            found = square < best ? flags(m) : found;
            best = less(square, best);
        }
    };
    look(nearest);
    reals away = root(best);
    const double bound = __builtin_reduce_max(away) + wide;
    for (int g = 0; g < patches; g += L) {
        const reals reach = *(const anywhere*)(balls + 3 * (size_t)patches + g) + bound;
        const flags may = away_from(g) < reach * reach;
        if (!__builtin_reduce_or(may))
            continue;
        for (int l = 0; l < L; ++l) {
            if (!may[l] || g + l == nearest)
                continue;
            const double* b = balls + g + l;
            const reals x = p.x - b[0], y = p.y - b[patches], z = p.z - b[2 * patches];
            const reals near = away + b[3 * patches];
            if (__builtin_reduce_or(x * x + y * y + z * z < near * near)) {
                look(g + l);
                away = root(best);
            }
        }
    }

    // `_from_place` in the body's frame.
    auto nearest_one = [&](int l) { return found[l]; };
    places before = in_frame(gathered(on_body, nearest_one));
    places outward = turned_back(gathered(normal.data + (size_t)world * elements, nearest_one));
    p = in_frame(p);
    const places there = from_to(before, p);
    places foot = along(p, -dot(there, outward), outward);
    best = root(dot(there, there));
    flags going = -1;
    for (int n = 0; n < PROJECTIONS && __builtin_reduce_or(going); ++n) {
        const places q = untapered(foot);
        const slopes g = gauge(q);
        going &= g.value > 0.0;
        const reals inward = 1.0 / g.value;
        const places on = tapered(places{q.x * inward, q.y * inward, q.z * inward});
        const places v = from_to(on, p);
        const reals off = root(dot(v, v));
        best = (going & (off < best)) ? off : best;
        const places by = tapered_slopes(g.by, on);
        const reals steep = root(dot(by, by));
        going &= steep > 0.0;
        const places facing = {by.x / steep, by.y / steep, by.z / steep};
        const reals height = dot(v, facing);
        const places aside = along(v, -height, facing);
        const reals left = dot(aside, aside);
        going &= left >= SETTLED * off;
        const places step = from_to(before, on);
        const reals gone = dot(step, step);
        const reals bend = dot(from_to(outward, facing), step) / gone;
        const flags even = (left < NEAR * gone) & (bend >= 0.0) & (bend * bend * left < NEAR);
        const reals rise = 1.0 + bend * height;
        reals round = 2.0 * height + bend * (height * height + left);
        round = size_of(round / (1.0 + root(rise * rise + bend * bend * left)));
        round = rise <= 0.0 ? root(left + height * height) : round;
        best = (going & even & (round < best)) ? round : best;
        going &= ~even;
        before = on;
        outward = facing;
        foot = along(on, (reals)1.0, aside);
    }
    for (int l = 0; l < count; ++l)
        distance.data[(size_t)world * distance.shape[1] + begin + l] = best[l];
#endif
"""
for _name, _value in (("PATCH", PATCH), ("PROJECTIONS", PROJECTIONS), ("NEAR", NEAR),
                      ("SETTLED", SETTLED)):
    _DISTANCES = _DISTANCES.replace(_name, str(_value))


@wp.func_native(_DISTANCES)
def distances_in_lanes(
    world: int, begin: int, end: int, element: wp.array2d[vec3], normal: wp.array2d[vec3],
    ball: wp.array3d[real], s: SuperquadricShape, pose: transform, point: wp.array[vec3],
    distance: wp.array2d[real],
):
    """Of up to `LANES` points; as `_element_distance_kernel` goes on."""


_SIGNED_DISTANCES = SUPERQUADRIC_LANES + """
    auto number = [&](int l) { return order.data[begin + l < end ? begin + l : begin]; };
    const places p = in_frame(gathered(point.data, number)), q = untapered(p);
    flags in = 0;
    if (s.e1 <= 1.0 && s.e2 <= 1.0) {
        const places r = {q.x * across_x, q.y * across_y, q.z * upwards};
        const double least = wp::min(s.size[0], wp::min(s.size[1], s.size[2]))
            * (1.0 - wp::max(wp::abs(s.kx), wp::abs(s.ky)));
        in = (1.0 - root(dot(r, r))) * least > enough;
    }
    reals away = 0.0;
    if (!__builtin_reduce_and(in)) {
        const slopes g = gauge(q);
        const places by = tapered_slopes(g.by, p);
        away = (g.value - 1.0) / more(root(dot(by, by)), (reals)tiny);
        const reals past = size_of(p.z) - s.size[2];
        away = past > more(away, (reals)0.0) ? past : away;
    }
    away = in ? (reals)-enough : away;
    for (int l = 0; l < L && begin + l < end; ++l)
        distance.data[(size_t)world * distance.shape[1] + number(l)] = away[l];
#endif
"""


@wp.func_native(_SIGNED_DISTANCES)
def signed_distances_in_lanes(
    world: int, begin: int, end: int, s: SuperquadricShape, pose: transform,
    point: wp.array[vec3], order: wp.array[int], enough: real, distance: wp.array2d[real],
):
    """`_signed_distance` of up to `LANES` points."""
