"""Convex polyhedra from the planes of their faces: which corners each face has."""

from itertools import combinations

import numpy as np
from jaxtyping import Float

PARALLEL = 1e-3
"""Three planes meet in no point where the determinant of their unit normals is below this."""
SAME_M = 1e-6
"""Corners nearer to one another than this are one; one this far beyond a plane is on it [m]."""


def polyhedron_faces(
    normals: Float[np.ndarray, "face 3"], offset_m: Float[np.ndarray, " face"],
) -> list[Float[np.ndarray, "corner 3"]]:
    """Corners [m] of each face of the body n.x <= offset, counter-clockwise seen from outside.

    A face without area has no corners. `normals` are unit vectors. Raises ValueError for arrays of
    the wrong shape, and for planes that do not close a body.
    """
    normals, offset_m = np.asarray(normals, float), np.asarray(offset_m, float)
    if normals.ndim != 2 or normals.shape[1] != 3 or offset_m.shape != normals.shape[:1]:
        raise ValueError(f"planes: normals {normals.shape}, offsets {offset_m.shape}, should be "
                         "(face, 3) and (face,)")
    if not _closed(normals):
        raise ValueError("planes: they close no body; some direction meets none of them")
    corners = []
    for three in combinations(range(len(normals)), 3):
        rows = normals[list(three)]
        if abs(np.linalg.det(rows)) > PARALLEL:
            point = np.linalg.solve(rows, offset_m[list(three)])
            if (normals @ point <= offset_m + SAME_M).all():
                corners.append(point)
    points = np.array(corners).reshape(-1, 3)
    return [_ordered(points[np.abs(points @ n - d) <= 2 * SAME_M], n)
            for n, d in zip(normals, offset_m, strict=True)]


def _closed(normals: np.ndarray) -> bool:
    """Whether no direction makes an obtuse or right angle with every normal.

    If there were such a direction, there would be one along the line where two planes meet.
    """
    ways = [np.cross(a, b) for a, b in combinations(normals, 2)]
    ways = np.array([w / np.linalg.norm(w) for w in ways if np.linalg.norm(w) > PARALLEL])
    if len(ways) == 0:
        return False
    ways = np.concatenate([ways, -ways])
    return bool((ways @ normals.T > PARALLEL).any(1).all())


def _ordered(points: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Different corners of one face, turning about its outward normal."""
    kept: list[np.ndarray] = []
    for point in points:
        if all(np.linalg.norm(point - other) > 2 * SAME_M for other in kept):
            kept.append(point)
    if len(kept) < 3:
        return np.zeros((0, 3))
    corners = np.array(kept)
    arms = corners - corners.mean(axis=0)
    u = arms[0] / np.linalg.norm(arms[0])
    return corners[np.argsort(np.arctan2(arms @ np.cross(normal, u), arms @ u))]
