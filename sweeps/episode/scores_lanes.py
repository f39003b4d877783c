# type: ignore  # Warp functions, which type checkers cannot follow
"""Surface elements, distances and signed distances for `LANES` points side by side, of one plain
superquadric: what `surface_elements_kernel` and `scores_kernel` do one by one.

C++ for Clang, see `warpgrasp.geometry.superquadric_lanes`.
"""

import warp as wp

from warpgrasp.core.dtypes import real, transform, vec3, vec4
from warpgrasp.geometry.body_sampling import GROUP
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape
from warpgrasp.geometry.superquadric_lanes import PLACED_SUPERQUADRIC_LANES, SUPERQUADRIC_LANES

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


_ELEMENTS = PLACED_SUPERQUADRIC_LANES + """
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


_DISTANCES = PLACED_SUPERQUADRIC_LANES + """
    // The nearest element of each point, in single precision: of elements that are as near within
    // a tenth of a micrometre any will do.
    enum { W = GROUP };
    typedef float floats __attribute__((ext_vector_type(W)));
    typedef float floats_anywhere __attribute__((ext_vector_type(W), aligned(4)));
    typedef decltype(floats() < floats()) choices;
    typedef bool bools __attribute__((ext_vector_type(W)));
    auto mask_of = [](choices c) {  // a bit a lane
        return (unsigned)__builtin_bit_cast(unsigned short, __builtin_convertvector(c, bools)); };
    auto lesser = [](floats a, floats b) { return a < b ? a : b; };
    auto float_root = [](floats a) { return __builtin_elementwise_sqrt(a); };
    const int count = end - begin, elements = element.shape[1], patches = ball.shape[2];
    const wp::vec3f* middles = rough.data + (size_t)world * elements;
    const float* balls = ball.data + (size_t)world * 4 * patches;
    floats x, y, z;
    for (int l = 0; l < W; ++l) {
        const wp::vec3d& one = point.data[l < count ? begin + l : begin];
        x[l] = (float)one[0];
        y[l] = (float)one[1];
        z[l] = (float)one[2];
    }
    const wp::vec3d& middle = point.data[(begin + end) / 2];
    const float mx = (float)middle[0], my = (float)middle[1], mz = (float)middle[2];
    const float wide = __builtin_sqrtf(__builtin_reduce_max(
        (x - mx) * (x - mx) + (y - my) * (y - my) + (z - mz) * (z - mz)));
    auto away_from = [&](int g) {  // squares of the middle to the middles of `W` balls
        const floats u = *(const floats_anywhere*)(balls + g) - mx;
        const floats v = *(const floats_anywhere*)(balls + patches + g) - my;
        const floats w = *(const floats_anywhere*)(balls + 2 * patches + g) - mz;
        return u * u + v * v + w * w; };
    floats least = 1e18f;
    choices first = 0, number;
    for (int l = 0; l < W; ++l)
        number[l] = l;
    for (int g = 0; g < patches; g += W, number += choices(W)) {
        const floats square = away_from(g);
        first = square < least ? number : first;
        least = lesser(square, least);
    }
    const float nearest_square = __builtin_reduce_min(least);
    const int nearest = first[__builtin_ctz(mask_of(least == nearest_square))];

    floats closest = 1e18f;
    choices found = 0;
    auto look = [&](int g) {
        const int stop = wp::min((g + 1) * PATCH, elements);
        for (int m = g * PATCH; m < stop; ++m) {
            const wp::vec3f& e = middles[m];
            const floats u = x - e[0], v = y - e[1], w = z - e[2];
            const floats square = u * u + v * v + w * w;
            found = square < closest ? choices(m) : found;
            closest = lesser(square, closest);
        }
    };
    look(nearest);
    floats away = float_root(closest);
    const float bound = __builtin_reduce_max(away) + wide;
    for (int g = 0; g < patches; g += W) {
        const floats reach = *(const floats_anywhere*)(balls + 3 * (size_t)patches + g) + bound;
        for (unsigned may = mask_of(away_from(g) < reach * reach); may; may &= may - 1) {
            const int h = g + __builtin_ctz(may);
            if (h == nearest)
                continue;
            const float* b = balls + h;
            const floats u = x - b[0], v = y - b[patches], w = z - b[2 * patches];
            const floats near = away + b[3 * patches];
            if (mask_of(u * u + v * v + w * w < near * near)) {
                look(h);
                away = float_root(closest);
            }
        }
    }

    for (int from = 0; from < count; from += L) {
        // `_from_place` in the body's frame.
        auto of = [&](int l) { return from + l < count ? from + l : 0; };
        auto nearest_one = [&](int l) { return found[of(l)]; };
        places before = in_frame(gathered(element.data + (size_t)world * elements, nearest_one));
        places outward = turned_back(gathered(normal.data + (size_t)world * elements, nearest_one));
        const places p = in_frame(gathered(point.data + begin, of));
        const places there = from_to(before, p);
        places foot = along(p, -dot(there, outward), outward);
        reals best = root(dot(there, there));
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
        for (int l = 0; l < L && from + l < count; ++l)
            distance.data[(size_t)world * distance.shape[1] + begin + from + l] = best[l];
    }
#endif
"""
for _name, _value in (("GROUP", GROUP), ("PATCH", PATCH), ("PROJECTIONS", PROJECTIONS),
                      ("NEAR", NEAR), ("SETTLED", SETTLED)):
    _DISTANCES = _DISTANCES.replace(_name, str(_value))


@wp.func_native(_DISTANCES)
def distances_in_lanes(
    world: int, begin: int, end: int, element: wp.array2d[vec3], normal: wp.array2d[vec3],
    rough: wp.array2d[wp.vec3f], ball: wp.array3d[wp.float32], s: SuperquadricShape,
    pose: transform, point: wp.array[vec3], distance: wp.array2d[real],
):
    """Of up to `GROUP` points; as `_element_distance_kernel` goes on."""


_SIGNED_DISTANCES = PLACED_SUPERQUADRIC_LANES + """
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
    if (!__builtin_reduce_and(in))
        away = bound_at(p).distance;
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
