"""Convex polyhedra from the planes of their faces: corners, surface, distances."""

from itertools import combinations, pairwise

import numpy as np
from jaxtyping import Float

from fit.implicit.record import TriangleMesh
from fit.option_checks import checked_array

PARALLEL = 1e-3
"""Two planes leave no way along both where the sine between their normals is below this."""
NO_POINT = 1e-9
"""Three planes meet in no point where the determinant of their unit normals is below this."""
ROUNDED = 1e-6
"""By which the length of a normal may be off 1."""
SAME_M = 1e-9
"""Corners nearer to one another than this are one; one this far beyond a plane is on it [m]. More
than rounding, and less than any edge: of an edge as short as this faces would not agree."""
FEWEST_FACES = 4
"""Of a body that has a volume."""


def polyhedron_faces(
    normals: Float[np.ndarray, "face 3"], offset_m: Float[np.ndarray, " face"],
) -> list[Float[np.ndarray, "_ 3"]]:
    """Corners [m] of each face of the body n.x <= offset, counter-clockwise seen from outside.

    A face without area has no corners, and of planes that have a face in common all but the first.
    `normals` are unit vectors. Raises ValueError for arrays of the wrong shape or with numbers that
    are not finite, normals of another length, and planes that do not close a body.
    """
    normals, offset_m = np.asarray(normals, float), np.asarray(offset_m, float)
    if normals.ndim != 2 or normals.shape[1] != 3 or offset_m.shape != normals.shape[:1]:
        raise ValueError(f"planes: normals {normals.shape}, offsets {offset_m.shape}, should be "
                         "(face, 3) and (face,)")
    if not (np.isfinite(normals).all() and np.isfinite(offset_m).all()):
        raise ValueError("planes: a normal or an offset is not finite; leave that plane out")
    if (np.abs(np.linalg.norm(normals, axis=1) - 1.0) > ROUNDED).any():
        raise ValueError("planes: a normal is no unit vector; divide it, and its offset, by its "
                         "length")
    if not _closed(normals):
        raise ValueError("planes: they close no body; some direction meets none of them")
    three = np.array(list(combinations(range(len(normals)), 3)))
    three = three[np.abs(np.linalg.det(normals[three])) > NO_POINT]
    points = np.linalg.solve(normals[three], offset_m[three][..., None])[..., 0]
    points = points[((points[:, None] * normals).sum(-1) <= offset_m + SAME_M).all(1)]
    faces: list[np.ndarray] = []
    for n, d in zip(normals, offset_m, strict=True):
        corners = _ordered(points[np.abs(points @ n - d) <= 2 * SAME_M], n)
        there = any(_is_same(corners, face) for face in faces)
        faces.append(np.zeros((0, 3)) if there else corners)
    return faces


def _is_same(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two faces have the same corners; those of a body, which has a volume, have the same
    sense then."""
    apart = np.linalg.norm(one[:, None] - other, axis=2)
    return len(one) == len(other) > 0 and bool((apart.min(1) <= 2 * SAME_M).all())


def _closed(normals: np.ndarray) -> bool:
    """Whether no direction makes an obtuse or right angle with every normal.

    If there were such a direction, there would be one along the line where two planes meet.
    """
    one, other = np.array(list(combinations(range(len(normals)), 2)), int).reshape(-1, 2).T
    ways = np.cross(normals[one], normals[other])
    size = np.linalg.norm(ways, axis=1)
    ways = ways[size > PARALLEL] / size[size > PARALLEL, None]
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


def polyhedron_mesh(
    normals: Float[np.ndarray, "face 3"], offset_m: Float[np.ndarray, " face"],
) -> TriangleMesh:
    """The closed surface of the body n.x <= offset, as a fan of triangles a face.

    Without faces where the planes leave no volume. Raises ValueError as `polyhedron_faces` does.
    """
    faces = polyhedron_faces(normals, offset_m)
    sided = [corners for corners in faces if len(corners)]
    if len(sided) < FEWEST_FACES:
        return TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    vertices: list[np.ndarray] = []
    triangles = []
    for corners in sided:
        number = [_number_of(corner, vertices) for corner in corners]
        triangles += [(number[0], a, b) for a, b in pairwise(number[1:])]
    return TriangleMesh(np.array(vertices), np.array(triangles))


def _number_of(corner: np.ndarray, vertices: list[np.ndarray]) -> int:
    """Which vertex a corner is; a new one is appended. Faces share their corners exactly."""
    for number, vertex in enumerate(vertices):
        if np.linalg.norm(vertex - corner) <= 2 * SAME_M:
            return number
    vertices.append(corner)
    return len(vertices) - 1


def polyhedron_distance(
    normals: Float[np.ndarray, "face 3"], offset_m: Float[np.ndarray, " face"],
    points_m: Float[np.ndarray, "point 3"],
) -> Float[np.ndarray, " point"]:
    """Signed distances [m] of points to the body n.x <= offset, negative inside; exact.

    Inside the nearest place lies on the plane that is nearest, outside on a face that faces the
    point or on an edge of one. Infinite where the planes leave no volume. Raises ValueError as
    `polyhedron_faces` does.
    """
    normals, offset_m = np.asarray(normals, float), np.asarray(offset_m, float)
    faces = polyhedron_faces(normals, offset_m)
    points_m = checked_array("points_m", points_m, (None, 3))
    if sum(len(corners) > 0 for corners in faces) < FEWEST_FACES:
        return np.full(len(points_m), np.inf)
    beyond = points_m @ normals.T - offset_m
    signed = beyond.max(1)
    outside = np.flatnonzero(signed > 0.0)
    away = np.full(len(outside), np.inf)
    for face, corners in enumerate(faces):
        if len(corners):
            away = np.minimum(away, _polygon_distance(points_m[outside], corners, normals[face],
                                                      beyond[outside, face]))
    signed[outside] = away
    return signed


def _polygon_distance(points: np.ndarray, corners: np.ndarray, normal: np.ndarray,
                      height: np.ndarray) -> np.ndarray:
    """Distances of points (point, 3), `height` above its plane, to a convex polygon that turns
    counter-clockwise about its normal."""
    edge = np.roll(corners, -1, axis=0) - corners
    arm = points[:, None] - corners
    share = np.clip((arm * edge).sum(-1) / (edge**2).sum(-1), 0.0, 1.0)
    nearest = np.linalg.norm(arm - share[..., None] * edge, axis=-1).min(1)
    over = ((np.cross(edge, arm) @ normal) >= 0.0).all(1)
    return np.where(over, np.abs(height), nearest)
