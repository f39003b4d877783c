# type: ignore  # Warp functions, which type checkers cannot follow
"""A capsule and a plain superquadric: what `foresight_kernel` asks place by place, for all places
along the capsule's axis side by side.

C++ for Clang, see `warpgrasp.geometry.superquadric_lanes`. Empty on a GPU.
"""

import warp as wp

from warpgrasp.core.dtypes import real, vec3, vec5
from warpgrasp.core.lanes import LANES
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape
from warpgrasp.geometry.superquadric_lanes import SUPERQUADRIC_LANES

PLACES = LANES
"""Along a capsule's axis."""
COARSE_M = 0.005
"""A bound by the box above this is gone on by."""

_ALONG = SUPERQUADRIC_LANES + """
    reals share;
    for (int l = 0; l < L; ++l)
        share[l] = l / (L - 1.0);
    const places p = {a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]),
                      a[2] + share * (b[2] - a[2])};
"""

_DISTANCE = _ALONG + """
    const reals none = 0.0;
    const reals x = size_of(p.x) - s.size[0] * (1.0 + wp::abs(s.kx));
    const reals y = size_of(p.y) - s.size[1] * (1.0 + wp::abs(s.ky));
    const reals z = size_of(p.z) - s.size[2];
    const places out = {more(x, none), more(y, none), more(z, none)};
    const reals outside = less(more(x, more(y, z)), none) + root(dot(out, out));
    auto lowest = [](reals of) {
        const double least = __builtin_reduce_min(of);
        int l = 0;
        while (l < L - 1 && of[l] != least)
            ++l;
        return l;
    };
    auto parted = [](int l, places from, places n, reals distance, double above, double clear) {
        wp::vec_t<5, double> plane;
        plane[0] = n.x[l];
        plane[1] = n.y[l];
        plane[2] = n.z[l];
        plane[3] = n.x[l] * from.x[l] + n.y[l] * from.y[l] + n.z[l] * from.z[l] - distance[l]
                   + above;
        plane[4] = clear;
        return plane;
    };
    auto parted_by_box = [&](int l, double clear) {
        const reals past = root(dot(out, out)), far = more(past, (reals)tiny);
        const places n = {(p.x < 0.0 ? -out.x : out.x) / far, (p.y < 0.0 ? -out.y : out.y) / far,
                          (p.z < 0.0 ? -out.z : out.z) / far};
        return parted(l, p, n, far, 0.0, clear);
    };
    auto parted_by_body = [&](int l, places from, bounds bound, double clear) {
        const double tapers = wp::max(wp::abs(s.kx), wp::abs(s.ky));
        return parted(l, from, bound.normal, bound.distance, tapers * wp::max(clear, 0.0), clear);
    };
    const int first = lowest(outside);
    double far = outside[first] - radius;
    if (far > enough)
        return parted_by_box(first, far);
    far -= wp::length(b - a) * 0.5 / (L - 1);
    if (far > COARSE)
        return parted_by_box(first, far);
    const bounds bound = bound_at(p);
    const reals away = more(bound.distance, outside);  // both fall short
    const int nearest = lowest(away);
    const double least = away[nearest];
    if (least > radius) {
        if (least > bound.distance[nearest])
            return parted_by_box(nearest, least - radius);
        return parted_by_body(nearest, p, bound, least - radius);
    }
    // From there on as far as the formula says, and once more: `_foot`.
    const places half_way = along(p, -bound.distance, bound.normal);
    const bounds rest = bound_at(half_way);
    const places way = along(from_to(p, half_way), -rest.distance, rest.normal);
    const reals whole = bound.distance > 0.0 ? root(dot(way, way)) : bound.distance;
    return parted_by_body(nearest, half_way, rest, whole[nearest] - radius);
#else
    return wp::vec_t<5, double>();
#endif
"""


@wp.func_native(_DISTANCE.replace("COARSE", repr(COARSE_M)))
def capsule_distance_in_lanes(
    s: SuperquadricShape, a: vec3, b: vec3, radius: real, enough: real
) -> vec5:
    """`_capsule_distance` as it goes on from places along the axis; not for bent bodies."""


_SHARE = _ALONG + """
    const reals d = bound_at(p).distance;
    const double least = __builtin_reduce_min(d);
    int best = 0;
    while (best < L - 1 && d[best] != least)
        ++best;
    double t = best;
    if (best > 0 && best < L - 1) {
        const double bend = d[best - 1] + d[best + 1] - least - least;
        if (bend > 0.0)
            t += 0.5 * (d[best - 1] - d[best + 1]) / bend;
    }
    return t / (L - 1);
#else
    return 0.0;
#endif
"""


@wp.func_native(_SHARE)
def nearest_share_in_lanes(s: SuperquadricShape, a: vec3, b: vec3) -> real:
    """`_nearest_share`; not for bent bodies."""
