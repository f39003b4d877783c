# type: ignore  # Warp functions, which type checkers cannot follow
"""A capsule and a plain superquadric: what `foresight_kernel` asks place by place, for all places
along the capsule's axis side by side.

C++ for Clang, see `warpgrasp.geometry.superquadric_lanes`. Empty on a GPU.
"""

import warp as wp

from warpgrasp.core.dtypes import real, vec3
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
    double far = __builtin_reduce_min(outside) - radius;
    if (far > enough)
        return far;
    far -= wp::length(b - a) * 0.5 / (L - 1);
    if (far > COARSE)
        return far;
    const bounds first = bound_at(p);
    const reals away = more(first.distance, outside);  // both fall short
    const double least = __builtin_reduce_min(away);
    if (least > radius)
        return least - radius;
    // From there on as far as the formula says, and once more: `_foot`.
    const places half_way = along(p, -first.distance, first.normal);
    const bounds rest = bound_at(half_way);
    const places way = along(from_to(p, half_way), -rest.distance, rest.normal);
    const reals whole = first.distance > 0.0 ? root(dot(way, way)) : first.distance;
    for (int l = 0; l < L; ++l)
        if (away[l] == least)
            return whole[l] - radius;
    return least - radius;
#else
    return 0.0;
#endif
"""


@wp.func_native(_DISTANCE.replace("COARSE", repr(COARSE_M)))
def capsule_distance_in_lanes(
    s: SuperquadricShape, a: vec3, b: vec3, radius: real, enough: real
) -> real:
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
