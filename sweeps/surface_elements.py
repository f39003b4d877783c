"""Recovered superquadrics as surface elements, in kernels: what `fit.superquadric_surface` gives.

A cube's grid is projected onto each body; every quadrilateral is an element with its own point,
normal and area. A straight body is the same in all eight octants, so powers are worked out in one.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import warp as wp

from fit.superquadric_shape import SuperquadricLike, cube_grid
from strategies.body_query import bodies_on
from warpgrasp.launch import launch
from warpgrasp.real import HALF, ZERO, real, transform, vec3, vec4
from warpgrasp.sdf_primitive import sign_of
from warpgrasp.sdf_superquadric import (
    SuperquadricShape,
    deformed_gradient,
    straighten,
    superquadric_gauge,
    taper_and_bend,
)

TILE = (4, 4)
"""Elements of a face that follow each other: so many rows and columns of its grid."""
_TINY_AREA = wp.constant(real(1e-300))


class Elements(NamedTuple):
    """Elements of each body, tile by tile."""

    point: np.ndarray
    """[m], (world, element, 3)."""
    normal: np.ndarray
    """Outward, unit, (world, element, 3)."""
    area: np.ndarray
    """[m^2], (world, element)."""


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


def surface_elements(body: SuperquadricLike, count: int, *, device: str) -> Elements:
    """About `count` elements of each body: the least 6 k^2 that are as many."""
    grid = _grid(count)
    worlds, elements, vertices = len(body.size_m), len(grid.middle), len(grid.vertex)
    shape, pose = bodies_on(body, device)
    axes = {"shape": "world", "pose": "world", "gauge": "world octant", "vertex": "world vertex"}
    gauge = wp.empty((worlds, len(grid.octant)), dtype=vec4, device=device)
    launch(_octant_kernel, {"world": worlds, "octant": len(grid.octant)}, {
        **axes, "direction": "octant"}, {
        "shape": shape, "direction": wp.array(grid.octant, dtype=vec3, device=device),
        "gauge": gauge}, device=device)
    on = wp.empty((worlds, vertices), dtype=vec3, device=device)
    launch(_vertex_kernel, {"world": worlds, "vertex": vertices}, {
        **axes, "direction": "vertex", "octant": "vertex"}, {
        "shape": shape, "direction": wp.array(grid.vertex, dtype=vec3, device=device),
        "octant": wp.array(grid.vertex_octant, dtype=int, device=device), "gauge": gauge,
        "vertex": on}, device=device)
    point, normal = (wp.empty((worlds, elements), dtype=vec3, device=device) for _ in range(2))
    area = wp.empty((worlds, elements), dtype=real, device=device)
    launch(_element_kernel, {"world": worlds, "element": elements}, {
        **axes, "corner": "element", "direction": "element", "octant": "element",
        "point": "world element", "normal": "world element", "area": "world element"}, {
        "shape": shape, "pose": pose,
        "corner": wp.array(grid.corner, dtype=wp.vec4i, device=device),
        "direction": wp.array(grid.middle, dtype=vec3, device=device),
        "octant": wp.array(grid.middle_octant, dtype=int, device=device), "gauge": gauge,
        "vertex": on, "point": point, "normal": normal, "area": area}, device=device)
    return Elements(point.numpy(), normal.numpy(), area.numpy())


class _Grid(NamedTuple):
    """The cube's grid: directions of its vertices and of the middles of its quadrilaterals."""

    vertex: np.ndarray
    vertex_octant: np.ndarray
    """Which of `octant` a vertex is, but for signs."""
    middle: np.ndarray
    middle_octant: np.ndarray
    corner: np.ndarray
    """Vertices of each quadrilateral."""
    octant: np.ndarray


@lru_cache(maxsize=4)
def _grid(count: int) -> _Grid:
    cells = max(int(np.ceil(np.sqrt(count / 6))), 1)
    corners, vertices = cube_grid(cells)
    face, i, j = np.unravel_index(np.arange(len(corners)), (6, cells, cells))
    corners = corners[np.lexsort((j, i, j // TILE[1], i // TILE[0], face))]
    middles = vertices[corners].mean(axis=1)
    both = np.abs(np.concatenate([vertices, middles]))
    _, where, which = np.unique(np.round(both, 12), axis=0, return_index=True,
                                return_inverse=True)
    which = which.reshape(-1).astype(np.int32)
    return _Grid(vertices, which[:len(vertices)], middles, which[len(vertices):],
                 corners.astype(np.int32), both[where])
