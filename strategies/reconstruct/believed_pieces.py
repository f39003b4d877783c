"""Which pieces of a free form are believed: an object is where the prior says."""

from dataclasses import replace

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from fit.implicit.record import TriangleMesh
from strategies.poses.waypoints import BoundingCylinder
from strategies.recovery.plausibility import plausible_vertices


def believed_pieces(mesh: TriangleMesh, prior: BoundingCylinder) -> TriangleMesh:
    """The mesh without pieces that the prior of its world, shape (1,), contradicts.

    Far from all touches, or about a single contact that was placed wrongly, the zero set of a
    process may have small pieces of its own, as in corners of its box that no link has swept. The
    largest piece stays whatever the prior says: then it is the whole form that is contradicted.
    """
    if len(mesh.faces) == 0:
        return mesh
    piece = _pieces(mesh)
    size = np.bincount(piece[mesh.faces[:, 0]], minlength=piece.max() + 1)
    kept = np.array([
        number == size.argmax()
        or plausible_vertices([mesh.vertices_m[piece == number]], prior, table_plane=False)[0]
        for number in range(len(size))])
    return mesh if kept.all() else _part(mesh, kept[piece])


def _pieces(mesh: TriangleMesh) -> np.ndarray:
    """To which connected piece of the mesh each vertex belongs, int (vertex,)."""
    begin, end = mesh.faces[:, [0, 1]].reshape(-1), mesh.faces[:, [1, 2]].reshape(-1)
    count = len(mesh.vertices_m)
    edges = coo_array((np.ones(len(begin), bool), (begin, end)), (count, count))
    return connected_components(edges, directed=False)[1]


def _part(mesh: TriangleMesh, kept: np.ndarray) -> TriangleMesh:
    """The mesh of the vertices that are `kept`, bool (vertex,)."""
    number = np.cumsum(kept) - 1
    return replace(mesh, vertices_m=mesh.vertices_m[kept],
                   faces=number[mesh.faces[kept[mesh.faces[:, 0]]]])
