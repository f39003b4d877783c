"""Recovered superquadrics as surface elements, in kernels.

They are those that `fit.superquadric.superquadric_surface` gives.

A cube's grid is projected onto each body; every quadrilateral is an element with its own point,
normal and area. A straight body is the same in all eight octants, so powers are computed in one.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import warp as wp

from fit.superquadric.geometry import SuperquadricLike, cube_grid
from strategies.recovery.body_distances import bodies_on
from sweeps.episode.scores_lanes import TILE
from sweeps.episode.surface_elements_kernel import _element_kernel, _octant_kernel, _vertex_kernel
from warpgrasp.core.dtypes import real, vec3, vec4
from warpgrasp.core.kernel_launch import array_of, launch
from warpgrasp.core.lanes import LANES, has_lanes


class Elements(NamedTuple):
    """Elements of each body, tile by tile."""

    point: np.ndarray
    """[m], (world, element, 3)."""
    normal: np.ndarray
    """Outward, unit, (world, element, 3)."""
    area: np.ndarray
    """[m^2], (world, element)."""


def surface_elements(
    body: SuperquadricLike, count: int, *, device: str, graded: bool
) -> Elements:
    """About `count` elements of each body: the least 6 k^2 that are as many.

    `graded`: cells are narrower beside the cube's edges, where a body like a block is rounded, see
    `_graded`.
    """
    grid = _grid(count, graded)
    worlds, elements, vertices = len(body.size_m), len(grid.middle), len(grid.vertex)
    shape, pose = bodies_on(body, device)
    axes = {"shape": "world", "pose": "world", "gauge": "world octant", "vertex": "world vertex"}
    gauge = wp.empty((worlds, len(grid.octant)), dtype=vec4, device=device)
    lanes = has_lanes(device)
    launch(_octant_kernel, {"world": worlds, "block": -(-len(grid.octant) // LANES)}, {
        **axes, "direction": "octant"}, {
        "lanes": lanes, "shape": shape, "pose": pose,
        "direction": array_of(grid.octant, vec3, device),
        "gauge": gauge}, device=device)
    on = wp.empty((worlds, vertices), dtype=vec3, device=device)
    launch(_vertex_kernel, {"world": worlds, "vertex": vertices}, {
        **axes, "direction": "vertex", "octant": "vertex"}, {
        "shape": shape, "direction": array_of(grid.vertex, vec3, device),
        "octant": array_of(grid.vertex_octant, int, device), "gauge": gauge,
        "vertex": on}, device=device)
    point, normal = (wp.empty((worlds, elements), dtype=vec3, device=device) for _ in range(2))
    area = wp.empty((worlds, elements), dtype=real, device=device)
    launch(_element_kernel, {"world": worlds, "block": -(-elements // LANES)}, {
        **axes, "corner": "element", "direction": "element", "octant": "element",
        "point": "world element", "normal": "world element", "area": "world element"}, {
        "lanes": lanes, "shape": shape, "pose": pose,
        "corner": array_of(grid.corner, wp.vec4i, device),
        "direction": array_of(grid.middle, vec3, device),
        "octant": array_of(grid.middle_octant, int, device), "gauge": gauge,
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
def _grid(count: int, graded: bool) -> _Grid:
    cells = max(int(np.ceil(np.sqrt(count / 6))), 1)
    corners, vertices = cube_grid(cells, _graded(np.arange(cells + 1), cells) if graded else None)
    middles = (cube_grid(cells - 1, _graded(np.arange(cells) + 0.5, cells))[1] if graded
               else vertices[corners].mean(axis=1))
    face, i, j = np.unravel_index(np.arange(len(corners)), (6, cells, cells))
    order = np.lexsort((j, i, j // TILE[1], i // TILE[0], face))
    corners, middles = corners[order], middles[order]
    both = np.abs(np.concatenate([vertices, middles]))
    _, where, which = np.unique(np.round(both, 12), axis=0, return_index=True,
                                return_inverse=True)
    which = which.reshape(-1).astype(np.int32)
    return _Grid(vertices, which[:len(vertices)], middles, which[len(vertices):],
                 corners.astype(np.int32), both[where])


def _graded(place: np.ndarray, cells: int) -> np.ndarray:
    """Where a line, `place` of `cells` along a face of the cube, lies in [-1, 1]: at half the sum
    of even and of Chebyshev's places.

    Distances rise steeply beside the edges, with the tenth or twentieth power for exponents of 0.2
    and 0.1.
    """
    even = 2.0 * place / cells - 1.0
    return 0.5 * (even + np.sin(0.5 * np.pi * even))
