# type: ignore  # Warp functions, which type checkers cannot follow
"""Gauges of a superquadric that stands somewhere, and their gradients, at many points of the world.

On a CPU those of a plain body are taken side by side (`superquadric_lanes`).
"""

import warp as wp

from warpgrasp.core.dtypes import transform, vec3, vec4
from warpgrasp.geometry.sdf_superquadric import (
    SuperquadricShape,
    superquadric_deformed_gauge,
    superquadric_is_plain,
)
from warpgrasp.geometry.superquadric_lanes import PLACED_SUPERQUADRIC_LANES


@wp.func
def world_gauge(p: vec3, shape: SuperquadricShape, pose: transform):
    """Gradient and value of a body's gauge at a point of the world."""
    g = superquadric_deformed_gauge(wp.transform_point(wp.transform_inverse(pose), p), shape)
    turned = wp.quat_rotate(wp.transform_get_rotation(pose), vec3(g[0], g[1], g[2]))
    return vec4(turned[0], turned[1], turned[2], g[3])


_GAUGES = PLACED_SUPERQUADRIC_LANES + """
    wp::vec4d* row = &ROW;
    for (int first = 0; first < count; first += L) {
        places p;
        for (int l = 0; l < L; ++l) {
            const wp::vec4d& one = row[first + l < count ? first + l : first];
            p.x[l] = one[0];
            p.y[l] = one[1];
            p.z[l] = one[2];
        }
        p = in_frame(p);
        const slopes g = gauge(untapered(p));
        const places by = turned(tapered_slopes(g.by, p));
        for (int l = 0; l < L && first + l < count; ++l)
            row[first + l] = wp::vec4d(by.x[l], by.y[l], by.z[l], g.value[l]);
    }
#endif
"""


@wp.func_native(_GAUGES.replace("ROW", "wp::index(place, i, j)"))
def _in_lanes(s: SuperquadricShape, pose: transform, place: wp.array2d[vec4], i: int, j: int,
              count: int):
    """`gauges_at` for a plain body on a CPU."""


@wp.func_native(_GAUGES.replace("ROW", "wp::index(place, i, j, k)"))
def _in_lanes_of_three(s: SuperquadricShape, pose: transform, place: wp.array3d[vec4], i: int,
                       j: int, k: int, count: int):
    """The same of an array of three axes."""


@wp.func
def gauges_at(s: SuperquadricShape, pose: transform, has_lanes: bool, place: wp.array2d[vec4],
              i: int, j: int, count: int):
    """Put `world_gauge` in place of `count` points (x, y, z, any) that follow `place[i, j]`."""
    if has_lanes and superquadric_is_plain(s, pose):
        _in_lanes(s, pose, place, i, j, count)
    else:
        for n in range(count):
            p = place[i, j + n]
            place[i, j + n] = world_gauge(vec3(p[0], p[1], p[2]), s, pose)


@wp.func
def gauges_at(s: SuperquadricShape, pose: transform, has_lanes: bool,  # noqa: F811 (an overload)
              place: wp.array3d[vec4], i: int, j: int, k: int, count: int):
    """The same from `place[i, j, k]` on."""
    if has_lanes and superquadric_is_plain(s, pose):
        _in_lanes_of_three(s, pose, place, i, j, k, count)
    else:
        for n in range(count):
            p = place[i, j, k + n]
            place[i, j, k + n] = world_gauge(vec3(p[0], p[1], p[2]), s, pose)
