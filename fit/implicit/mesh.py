"""The zero set of free-form bodies as closed meshes: marching cubes on a grid refined twice.

The grid of a body spans its touches and a margin. Every fourth node is evaluated first, then every
second and every one only where the surface may pass, for a signed distance rises by at most about
its slope times the way. Elsewhere the coarse values, interpolated, keep their sign.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from fit.arrays import rows_of
from fit.implicit.query import implicit_values, of_rows
from fit.implicit.record import ImplicitFit, Mean, TriangleMesh

CELLS = 32
"""Cells of the grid along each axis, a multiple of 4."""
MARGIN = 0.12
"""Of the grid beyond the touches, as a share of their longest side."""
FITS_AT_ONCE = 16
"""Their grids stay in the processor's cache."""
STEEPEST = 1.1
"""Slope of the distance that the refinement allows for [est]."""
HIDDEN = 0.75
"""A flat sheet through a new node of a cell is in the mean at most this share of the cell's half
diagonal away from its corners."""
APART = 1e-3
"""The surface stays this share of an edge of the grid away from nodes."""


Values = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Signed distances [m] at points (row, point, 3) of the fits numbered (row,), of which the first
so many (row,) are wanted."""


def implicit_meshes(
    fits: ImplicitFit, mean: Mean | None = None, *,
    box_m: tuple[Float[np.ndarray, "fit 3"], Float[np.ndarray, "fit 3"]] | None = None,
    cells: int = CELLS,
) -> list[TriangleMesh]:
    """The surface f = 0 of every fit, closed, in metres; `mean` is that of the fit.

    The grid holds the touches and, if given, the corners `box_m` of the mean's body, with a margin;
    a body that would reach beyond it is cut off there. Pieces that are nearest to no touch
    are left out: there the mean alone speaks. A body whose distance is NaN somewhere has an
    empty mesh. Raises ValueError as `zero_set_meshes` does.
    """
    def values(points: np.ndarray, rows: np.ndarray, counts: np.ndarray) -> np.ndarray:
        return implicit_values(rows_of(fits, rows), points, of_rows(mean, rows), counts=counts)

    low, high = fits.low_m, fits.high_m
    if box_m is not None:
        low, high = np.minimum(low, box_m[0]), np.maximum(high, box_m[1])
    margin = MARGIN * (high - low).max(axis=1, keepdims=True)
    meshes = zero_set_meshes(values, low - margin, high + margin, fits.table_z_m, cells=cells)
    return [felt_pieces(mesh, points[: int(count)]) for mesh, points, count in zip(
        meshes, fits.points_m, np.minimum(fits.n_points, fits.points_m.shape[1]), strict=True)]


def felt_pieces(mesh: TriangleMesh, touches_m: Float[np.ndarray, "touch 3"]) -> TriangleMesh:
    """The connected pieces of a mesh that are nearest to at least one touch."""
    vertices = len(mesh.vertices_m)
    if vertices == 0 or len(touches_m) == 0:
        return mesh
    edges = coo_array((np.ones(2 * len(mesh.faces), bool),
                       (mesh.faces[:, [0, 1]].ravel(), mesh.faces[:, [1, 2]].ravel())),
                      shape=(vertices, vertices))
    count, piece = connected_components(edges, directed=False)
    if count == 1:
        return mesh
    kept = np.zeros(count, bool)
    kept[piece[KDTree(mesh.vertices_m).query(touches_m)[1]]] = True
    number = np.cumsum(kept[piece]) - 1
    return replace(mesh, vertices_m=mesh.vertices_m[kept[piece]],
                   faces=number[mesh.faces[kept[piece[mesh.faces[:, 0]]]]])


def zero_set_meshes(
    values: Values, low_m: Float[np.ndarray, "fit 3"], high_m: Float[np.ndarray, "fit 3"],
    table_z_m: Float[np.ndarray, " fit"] | None = None, *, cells: int = CELLS,
) -> list[TriangleMesh]:
    """The surfaces where signed distances vanish, in boxes from `low_m` to `high_m` [m].

    With `table_z_m` nothing of a body is below that height. Raises ValueError for `cells` that are
    no multiple of 4.
    """
    if cells < 4 or cells % 4:
        raise ValueError(f"cells: {cells}, should be a multiple of 4")
    low, step = _grid(low_m, high_m, table_z_m, cells)
    meshes: list[TriangleMesh] = []
    for first in range(0, len(low), FITS_AT_ONCE):
        rows = np.arange(first, min(first + FITS_AT_ONCE, len(low)))
        field = _field(values, rows, low[rows], step[rows], cells)
        meshes += [_marched(_off_nodes(each), *grid) for each, *grid in zip(
            field, low[rows], step[rows], strict=True)]
    return meshes


def _grid(low: np.ndarray, high: np.ndarray, table_z: np.ndarray | None,
          cells: int) -> tuple[np.ndarray, np.ndarray]:
    """First node and step [m] of each grid, along each axis."""
    side = np.maximum(high - low, 1e-9)
    low, step = low.copy(), side / cells
    if table_z is not None:
        # Below the table a single layer of cells closes the body.
        table = table_z + 1e-9 * side.max(axis=1)
        above = low[:, 2] < table
        step[:, 2] = np.where(above, (high[:, 2] - table) / (cells - 1), step[:, 2])
        low[:, 2] = np.where(above, table - step[:, 2], low[:, 2])
    return low, step


def _field(values: Values, rows: np.ndarray, low: np.ndarray, step: np.ndarray,
           cells: int) -> Float[np.ndarray, "fit x y z"]:
    """Distances at the nodes; on the outermost ones the body ends."""
    n, side = len(rows), cells // 4 + 1
    index = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), -1).reshape(-1, 3)
    field = values(low[:, None] + 4 * step[:, None] * index, rows, np.full(n, len(index)))
    field = field.reshape(n, side, side, side)
    for stride in (2, 1):
        near = _near(field, stride * step)
        field = _refined(field)
        _evaluate(field, near, lambda nodes, counts, stride=stride: values(
            low[:, None] + stride * step[:, None] * nodes, rows, counts))
    rim = 0.01 * step.min(axis=1)[:, None, None]
    for face in (np.s_[:, 0], np.s_[:, -1], np.s_[:, :, 0], np.s_[:, :, -1], np.s_[:, :, :, 0],
                 np.s_[:, :, :, -1]):
        field[face] = np.maximum(field[face], rim)
    return field


def _evaluate(field: np.ndarray, near: np.ndarray,
              values: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> None:
    """Overwrites the nodes `near` of each field by `values(nodes, how many count)`."""
    flat = near.reshape(len(near), -1)
    counts = flat.sum(1)
    fit, node = np.nonzero(flat)
    slot = np.arange(len(fit)) - (np.cumsum(counts) - counts)[fit]
    nodes = np.zeros((len(near), counts.max(initial=0), 3), int)
    nodes[fit, slot] = np.stack(np.unravel_index(node, near.shape[1:]), -1)
    if nodes.shape[1]:
        field.reshape(flat.shape)[fit, node] = values(nodes, counts)[fit, slot]


def _refined(coarse: Float[np.ndarray, "fit x y z"]) -> Float[np.ndarray, "fit X Y Z"]:
    """Coarse values with their linear interpolation between."""
    for axis in (1, 2, 3):
        near = np.moveaxis(coarse, axis, 0)
        fine = np.empty((2 * len(near) - 1, *near.shape[1:]))
        fine[::2], fine[1::2] = near, 0.5 * (near[:-1] + near[1:])
        coarse = np.moveaxis(fine, 0, axis)
    return np.ascontiguousarray(coarse)


def _near(
    coarse: Float[np.ndarray, "fit x y z"], step: np.ndarray
) -> Bool[np.ndarray, "fit X Y Z"]:
    """New nodes of coarse cells through which the surface may pass; `step` is between them."""
    reach = STEEPEST * HIDDEN * np.linalg.norm(step, axis=1)[:, None, None, None]
    below = coarse < 0.0
    cut = (_corners(np.abs(coarse), np.add) < 8.0 * reach) | (
        _corners(below, np.logical_or) & ~_corners(below, np.logical_and))
    n, half = coarse.shape[:2]
    near = np.zeros((n, 2 * half - 1, 2 * half - 1, 2 * half - 1), bool)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                near[:, i:i + 2 * half - 3:2, j:j + 2 * half - 3:2, k:k + 2 * half - 3:2] |= cut
    near[:, ::2, ::2, ::2] = False
    return near


def _corners(node: np.ndarray, join: np.ufunc) -> np.ndarray:
    """`join` of the eight corners of each cell."""
    for axis in (1, 2, 3):
        near = np.moveaxis(node, axis, 0)
        node = np.moveaxis(join(near[:-1], near[1:]), 0, axis)
    return node


def _off_nodes(field: Float[np.ndarray, "x y z"]) -> Float[np.ndarray, "x y z"]:
    """The same field, no node so near to zero beside its neighbours that the surface passes through
    it: there vertices of several edges would coincide in single precision, and the mesh of whoever
    joins them would not be closed. Where a body stands on the table that is at all nodes below it.
    """
    for _ in range(2):  # a node that was moved may leave a neighbour too near
        size = np.abs(field)
        most = size.copy()
        for axis in range(3):
            own, there = np.moveaxis(most, axis, 0), np.moveaxis(size, axis, 0)
            np.maximum(own[1:], there[:-1], out=own[1:])
            np.maximum(own[:-1], there[1:], out=own[:-1])
        field = np.where(field < 0.0, np.minimum(field, -APART * most),
                         np.maximum(field, APART * most))
    return field


def _marched(field: np.ndarray, low: np.ndarray, step: np.ndarray) -> TriangleMesh:
    """Marching cubes of one grid, on the CPU; empty where a distance is no number."""
    import warp as wp
    from warp.geometry import IsoSurfaceMarchingCubes

    wp.config.log_level = wp.LOG_ERROR  # banners are not results
    if np.isnan(field).any() or not (field < 0.0).any():
        return TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    # Unit cells, since Warp keeps vertices in single precision.
    vertices, faces = IsoSurfaceMarchingCubes.extract(
        wp.array(field, dtype=wp.float32, ndim=3, device="cpu"), 0.0)  # type: ignore[arg-type]
    return TriangleMesh(low + step * vertices.numpy().astype(float),
                        faces.numpy().reshape(-1, 3).astype(int), simple=True)
