# type: ignore  # Warp functions, which type checkers cannot follow
"""Surface elements of superquadrics, in kernels."""

import warp as wp

from warpgrasp.core.dtypes import HALF, ZERO, real, transform, vec3, vec4
from warpgrasp.geometry.sdf_primitive import sign_of
from warpgrasp.geometry.sdf_superquadric import (
    SuperquadricShape,
    deformed_gradient,
    straighten,
    superquadric_gauge,
    taper_and_bend,
)

_TINY_AREA = wp.constant(real(1e-300))


@wp.kernel(enable_backward=False)
def _octant_kernel(
    first: int,
    # Bodies, and directions of the cube's frame, in:
    shape: wp.array[SuperquadricShape],
    direction: wp.array[vec3],
    # Gradient and value of the straight body's gauge out:
    gauge: wp.array2d[vec4],
):
    w, i = wp.tid()
    w += first
    s = shape[w]
    gauge[w, i] = superquadric_gauge(wp.cw_mul(direction[i], s.size), s.size, s.e1, s.e2)


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


@wp.kernel(enable_backward=False)
def _element_kernel(
    first: int,
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
    w, i = wp.tid()
    w += first
    c = corner[i]
    facet = HALF * wp.cross(vertex[w, c[2]] - vertex[w, c[0]], vertex[w, c[3]] - vertex[w, c[1]])
    size = wp.length(facet)
    s = shape[w]
    d = direction[i]
    g = gauge[w, octant[i]]
    p = taper_and_bend(wp.cw_mul(d, s.size) / g[3], s)
    # The gauge grows evenly outwards, so its gradient on the surface is the direction's.
    outward = vec4(sign_of(d[0]) * g[0], sign_of(d[1]) * g[1], sign_of(d[2]) * g[2], g[3])
    outward = deformed_gradient(outward, p, straighten(p, s), s)
    n = vec3(outward[0], outward[1], outward[2])
    slope = wp.length(n)
    # Where a deformed corner leaves no gradient, the facet's own normal stands in.
    if wp.isfinite(slope) and slope > ZERO:
        n = n / slope
    else:
        n = facet / wp.max(size, _TINY_AREA)
    point[w, i] = wp.transform_point(pose[w], p)
    normal[w, i] = wp.quat_rotate(wp.transform_get_rotation(pose[w]), n)
    area[w, i] = size
