"""Which pieces of a free form are believed: an object is where the prior says."""

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
    vertices, faces = mesh.vertices_m, mesh.faces
    if len(faces) == 0:
        return mesh
    begin, end = faces[:, [0, 1]].reshape(-1), faces[:, [1, 2]].reshape(-1)
    edges = coo_array((np.ones(len(begin), bool), (begin, end)), (len(vertices), len(vertices)))
    count, piece = connected_components(edges, directed=False)
    largest = np.bincount(piece[faces[:, 0]], minlength=count).argmax()
    kept = np.array([
        number == largest
        or plausible_vertices([vertices[piece == number]], prior, table_plane=False)[0]
        for number in range(count)])[piece]
    if kept.all():
        return mesh
    return TriangleMesh(vertices[kept], (np.cumsum(kept) - 1)[faces[kept[faces[:, 0]]]])
