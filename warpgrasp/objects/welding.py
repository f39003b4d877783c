"""Welding of mesh vertices that differ by rounding: the same corner, written once for each face."""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

WELDED = 1e-5
"""Of the longest side of a mesh: vertices nearer to one another are one. Single precision rounds to
6e-8 of a coordinate; the nodes of a grid of distances are 1e-2 apart."""
MOST_PAIRS = 20_000_000
"""Of vertices so near; a mesh that has more is not one that rounding opened."""


def edge_counts(faces: Int[np.ndarray, "face 3"]) -> Int[np.ndarray, " edge"]:
    """How many faces each edge borders; two everywhere on a closed surface."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def three_corners(faces: Int[np.ndarray, "face 3"]) -> Int[np.ndarray, "face 3"]:
    """The faces that name three different vertices; another closes nothing."""
    a, b, c = faces.T
    return faces[(a != b) & (b != c) & (c != a)]


def welded_faces(
    vertices: Float[np.ndarray, "vertex 3"], faces: Int[np.ndarray, "face 3"]
) -> Int[np.ndarray, "face 3"]:
    """The faces of an open mesh with vertices welded that are nearer to one another than `WELDED`,
    in any unit of length, if that closes it; otherwise `faces` as they are.

    Of vertices that are one the first stands for all; none is moved.
    """
    # Imported here: only meshes that are open need them, and they take time to import.
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    near = WELDED * float(np.ptp(vertices, axis=0).max())
    tree = KDTree(vertices)
    if tree.count_neighbors(tree, near) > 2 * MOST_PAIRS:
        return faces
    one, other = tree.query_pairs(near, output_type="ndarray").T
    _, corner = connected_components(
        coo_array((np.ones(len(one), bool), (one, other)), shape=(len(vertices),) * 2),
        directed=False)
    _, first = np.unique(corner, return_index=True)
    welded = three_corners(first[corner][faces])
    closed = len(welded) > 0 and (edge_counts(welded) == 2).all()
    return welded if closed else faces
