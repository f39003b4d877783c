"""Recovered superquadrics as surface elements, in kernels: what `fit.superquadric_surface` gives.

A cube's grid is projected onto each body; every quadrilateral is an element with its own point,
normal and area.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import warp as wp

from fit.superquadric_shape import SuperquadricLike, cube_grid
from strategies.body_query import bodies_on
from warpgrasp.launch import launch
from warpgrasp.real import HALF, ZERO, real, transform, vec3
from warpgrasp.sdf_superquadric import (
    SuperquadricShape,
    superquadric_deformed_gauge,
    superquadric_gauge,
    taper_and_bend,
)

_TINY_AREA = wp.constant(real(1e-300))


class Elements(NamedTuple):
    """Elements of each body."""

    point: np.ndarray
    """[m], (world, element, 3)."""
    normal: np.ndarray
    """Outward, unit, (world, element, 3)."""
    area: np.ndarray
    """[m^2], (world, element)."""


@wp.func
def _on_surface(direction: vec3, s: SuperquadricShape):
    """The surface point, in the body's frame, along a direction of the cube's frame."""
    p = wp.cw_mul(direction, s.size)
    return taper_and_bend(p / superquadric_gauge(p, s.size, s.e1, s.e2)[3], s)


@wp.kernel(enable_backward=False)
def _vertex_kernel(
    first: int,
    # Bodies and the grid's vertices in:
    shape: wp.array[SuperquadricShape],
    direction: wp.array[vec3],
    # Vertices on the bodies out, in their frames:
    vertex: wp.array2d[vec3],
):
    w, i = wp.tid()
    w += first
    vertex[w, i] = _on_surface(direction[i], shape[w])


@wp.kernel(enable_backward=False)
def _element_kernel(
    first: int,
    # Bodies, and the grid's quadrilaterals by corners and middles, in:
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    corner: wp.array[wp.vec4i],
    direction: wp.array[vec3],
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
    p = _on_surface(direction[i], shape[w])
    g = superquadric_deformed_gauge(p, shape[w])
    n = vec3(g[0], g[1], g[2])
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
    vertices, corners, middles = _grid(count)
    worlds, elements = len(body.size_m), len(corners)
    shape, pose = bodies_on(body, device)
    on = wp.empty((worlds, len(vertices)), dtype=vec3, device=device)
    launch(_vertex_kernel, {"world": worlds, "vertex": len(vertices)}, {
        "shape": "world", "direction": "vertex", "vertex": "world vertex"}, {
        "shape": shape, "direction": wp.array(vertices, dtype=vec3, device=device), "vertex": on},
        device=device)
    point, normal = (wp.empty((worlds, elements), dtype=vec3, device=device) for _ in range(2))
    area = wp.empty((worlds, elements), dtype=real, device=device)
    launch(_element_kernel, {"world": worlds, "element": elements}, {
        "shape": "world", "pose": "world", "corner": "element", "direction": "element",
        "vertex": "world vertex", "point": "world element",
        "normal": "world element", "area": "world element"}, {
        "shape": shape, "pose": pose, "corner": wp.array(corners, dtype=wp.vec4i, device=device),
        "direction": wp.array(middles, dtype=vec3, device=device), "vertex": on, "point": point,
        "normal": normal, "area": area}, device=device)
    return Elements(point.numpy(), normal.numpy(), area.numpy())


@lru_cache(maxsize=4)
def _grid(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, quadrilaterals by their corners, and middles of the cube's grid."""
    corners, vertices = cube_grid(max(int(np.ceil(np.sqrt(count / 6))), 1))
    return vertices, corners.astype(np.int32), vertices[corners].mean(axis=1)

