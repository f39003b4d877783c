# type: ignore  # Warp functions, which type checkers cannot follow
"""Surface elements of superquadrics, in kernels."""

import warp as wp

from sweeps.episode.scores_lanes import elements_in_lanes, gauges_in_lanes
from warpgrasp.core.dtypes import HALF, ZERO, real, struct, transform, vec3, vec4
from warpgrasp.core.lanes import LANES
from warpgrasp.geometry.sdf_primitive import sign_of
from warpgrasp.geometry.sdf_superquadric import (
    SuperquadricShape,
    deformed_gradient,
    straighten,
    superquadric_gauge,
    superquadric_is_plain,
    taper_and_bend,
)

_LANES = wp.constant(LANES)
_TINY_AREA = wp.constant(real(1e-300))


@wp.kernel(enable_backward=False)
def _octant_kernel(
    first: int,
    lanes: wp.bool,
    # Bodies, and directions of the cube's frame, in:
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    direction: wp.array[vec3],
    # Gradient and value of the straight body's gauge out:
    gauge: wp.array2d[vec4],
):
    """Of `LANES` directions that follow each other."""
    w, i = wp.tid()
    w += first
    s = shape[w]
    begin = i * _LANES
    end = wp.min(begin + _LANES, direction.shape[0])
    if lanes and superquadric_is_plain(s, pose[w]):
        gauges_in_lanes(w, begin, end, s, pose[w], direction, gauge)
        return
    for k in range(begin, end):
        gauge[w, k] = superquadric_gauge(wp.cw_mul(direction[k], s.size), s.size, s.e1, s.e2)


@wp.kernel(enable_backward=False)
def _vertex_kernel(
    first: int,
    # Bodies and the grid's vertices in:
    shape: wp.array[SuperquadricShape],
    direction: wp.array[vec3],
    octant: wp.array[int],
    gauge: wp.array2d[vec4],
    # Vertices on the bodies out, in their frames:
    vertex: wp.array2d[vec3],
):
    w, i = wp.tid()
    w += first
    s = shape[w]
    vertex[w, i] = taper_and_bend(wp.cw_mul(direction[i], s.size) / gauge[w, octant[i]][3], s)


@struct
class _Element:
    """A point with its normal, outwards, and its area."""

    point: vec3
    normal: vec3
    area: real


@wp.func
def _element(
    a: vec3, b: vec3, c: vec3, d: vec3, towards: vec3, g: vec4, s: SuperquadricShape,
    pose: transform,
):
    """The quadrilateral of four corners, and the body in the direction of its middle, where the
    gauge in the first octant is `g`."""
    facet = HALF * wp.cross(c - a, d - b)
    size = wp.length(facet)
    p = taper_and_bend(wp.cw_mul(towards, s.size) / g[3], s)
    # The gauge grows evenly outwards, so its gradient on the surface is the direction's.
    outward = vec4(sign_of(towards[0]) * g[0], sign_of(towards[1]) * g[1],
                   sign_of(towards[2]) * g[2], g[3])
    outward = deformed_gradient(outward, p, straighten(p, s), s)
    n = vec3(outward[0], outward[1], outward[2])
    slope = wp.length(n)
    # Where a deformed corner leaves no gradient, the facet's own normal stands in.
    if wp.isfinite(slope) and slope > ZERO:
        n = n / slope
    else:
        n = facet / wp.max(size, _TINY_AREA)
    found = _Element()
    found.point = wp.transform_point(pose, p)
    found.normal = wp.quat_rotate(wp.transform_get_rotation(pose), n)
    found.area = size
    return found


@wp.kernel(enable_backward=False)
def _element_kernel(
    first: int,
    lanes: wp.bool,
    # Bodies, and the grid's quadrilaterals by corners and middles, in:
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    corner: wp.array[wp.vec4i],
    direction: wp.array[vec3],
    octant: wp.array[int],
    gauge: wp.array2d[vec4],
    vertex: wp.array2d[vec3],
    # Elements out:
    point: wp.array2d[vec3],
    normal: wp.array2d[vec3],
    area: wp.array2d[real],
):
    """Of `LANES` quadrilaterals that follow each other."""
    w, i = wp.tid()
    w += first
    begin = i * _LANES
    end = wp.min(begin + _LANES, direction.shape[0])
    if lanes and superquadric_is_plain(shape[w], pose[w]):
        elements_in_lanes(w, begin, end, shape[w], pose[w], corner, direction, octant, gauge,
                          vertex, point, normal, area)
        return
    for k in range(begin, end):
        c = corner[k]
        found = _element(vertex[w, c[0]], vertex[w, c[1]], vertex[w, c[2]], vertex[w, c[3]],
                         direction[k], gauge[w, octant[k]], shape[w], pose[w])
        point[w, k] = found.point
        normal[w, k] = found.normal
        area[w, k] = found.area
