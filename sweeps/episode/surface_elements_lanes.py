# type: ignore  # Warp functions, which type checkers cannot follow
"""Surface elements of plain superquadrics, `LANES` side by side: what `surface_elements_kernel`
does one by one.

C++ for Clang, see `warpgrasp.geometry.superquadric_lanes`.
"""

import warp as wp

from warpgrasp.core.dtypes import real, transform, vec3, vec4
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape
from warpgrasp.geometry.superquadric_lanes import SUPERQUADRIC_LANES

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
