"""Scores of one recovered body, computed densely and by none of the scorer's distances.

Distances to an object come from formulas (block, prism, profile) or triangles (scan); those to a
recovered body from triangles of its own surface, or its contour. A mean over a surface is a sum
over many small elements, weighed by area.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from fit.superquadric.geometry import Superquadric, from_straight_frame

NEIGHBOURS = 12
CUBE = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
"""Axes of a cube's faces: across, and the two along."""


@dataclass(frozen=True)
class Elements:
    """Small pieces of a surface: middles (element, 3) [m] and shares of the area (element,)."""

    middle: np.ndarray
    share: np.ndarray


class Triangles:
    """A triangle mesh to which distances are exact where triangles are small and even."""

    def __init__(self, corner: np.ndarray) -> None:
        self.corner = corner
        self.tree = KDTree(corner.mean(1))

    def distance(self, points: np.ndarray) -> np.ndarray:
        """Distances [m] of points to the nearest of the `NEIGHBOURS` nearest triangles."""
        near = np.asarray(self.tree.query(points, NEIGHBOURS)[1])
        best = np.full(len(points), np.inf)
        for k in range(NEIGHBOURS):
            best = np.minimum(best, triangle_distance(points, self.corner[near[:, k]]))
        return best


def triangle_distance(points: np.ndarray, corner: np.ndarray) -> np.ndarray:
    """Distance of each point (n, 3) to its own triangle (n, 3, 3)."""
    a, b, c = corner[:, 0], corner[:, 1], corner[:, 2]
    normal = np.cross(b - a, c - a)
    square = (normal**2).sum(1)
    within = square > 1e-30
    best = np.full(len(points), np.inf)
    for p, q in ((a, b), (b, c), (c, a)):
        way, arm = q - p, points - p
        t = np.clip((arm * way).sum(1) / np.maximum((way**2).sum(1), 1e-30), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(arm - t[:, None] * way, axis=1))
        within &= (np.cross(way, arm) * normal).sum(1) >= 0.0
    height = np.abs(((points - a) * normal).sum(1)) / np.sqrt(np.maximum(square, 1e-30))
    return np.where(within, height, best)


def contour_distance(points: np.ndarray, z: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Distance of points to the closed body of revolution about z with the contour (z, r)."""
    p = np.stack([points[:, 2], np.hypot(points[:, 0], points[:, 1])], 1)
    z, r = np.concatenate([z[:1], z, z[-1:]]), np.concatenate([[0.0], r, [0.0]])
    best = np.full(len(p), np.inf)
    for k in range(len(z) - 1):
        start, way = np.array([z[k], r[k]]), np.array([z[k + 1] - z[k], r[k + 1] - r[k]])
        t = np.clip((p - start) @ way / max(way @ way, 1e-18), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(p - start - t[:, None] * way, axis=1))
    return best


def contour_elements(z: np.ndarray, r: np.ndarray, step: float) -> Elements:
    """Rings of the surface about z, cut into pieces about `step` [m] wide."""
    z, r = np.concatenate([z[:1], z, z[-1:]]), np.concatenate([[0.0], r, [0.0]])
    points, areas = [], []
    for k in range(len(z) - 1):
        length = np.hypot(z[k + 1] - z[k], r[k + 1] - r[k])
        count = int(np.ceil(length / step))
        for i in range(count):
            t = (i + 0.5) / count
            radius, height = r[k] + t * (r[k + 1] - r[k]), z[k] + t * (z[k + 1] - z[k])
            around = max(int(np.ceil(2 * np.pi * radius / step)), 6)
            angle = 2 * np.pi * (np.arange(around) + 0.5 * (i % 2)) / around
            points.append(np.stack([radius * np.cos(angle), radius * np.sin(angle),
                                    np.full(around, height)], 1))
            areas.append(np.full(around, 2 * np.pi * radius * length / count / around))
    area = np.concatenate(areas)
    return Elements(np.concatenate(points), area / area.sum())


def superquadric_corners(body: Superquadric, cells: int) -> np.ndarray:
    """Corners (6 cells^2, 4, 3) of quadrilaterals on one body, denser beside its edges."""
    line = np.sin(np.pi / 2 * np.sin(np.linspace(-np.pi / 2, np.pi / 2, cells + 1)))
    u, v = np.meshgrid(line, line, indexing="ij")
    faces = []
    for axes in CUBE:
        for side in (1.0, -1.0):
            d = np.stack([np.full_like(u, side), u, v], -1)[..., np.argsort(np.asarray(axes))]
            s = surface_along(body, d.reshape(-1, 3)).reshape(d.shape)
            faces.append(np.stack([s[:-1, :-1], s[1:, :-1], s[1:, 1:], s[:-1, 1:]], -2))
    return np.concatenate([f.reshape(-1, 4, 3) for f in faces])


def surface_along(body: Superquadric, direction: np.ndarray) -> np.ndarray:
    """Where rays from the middle of the scaled, straight body leave it, then tapered, bent, put."""
    e1, e2 = body.exponents[0]
    x, y, z = np.abs(direction).T
    wide = np.maximum(np.maximum(x, y), 1e-300)
    section = wide * ((x / wide) ** (2 / e2) + (y / wide) ** (2 / e2)) ** (e2 / 2)
    most = np.maximum(section, z)
    f = most * ((section / most) ** (2 / e1) + (z / most) ** (2 / e1)) ** (e1 / 2)
    straight = direction / f[:, None] * body.size_m[0]
    return from_straight_frame(body, straight[None])[0]


def split(quads: np.ndarray) -> np.ndarray:
    """Two triangles a quadrilateral."""
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def elements_of(corner: np.ndarray) -> Elements:
    """Middles and areas of triangles."""
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]),
                          axis=1)
    return Elements(corner.mean(1), area / area.sum())


def thinned(elements: Elements, count: int) -> Elements:
    """So many elements at equal steps of the area, in the order in which they stand."""
    reached = np.cumsum(elements.share)
    chosen = np.searchsorted(reached, (np.arange(count) + 0.5) / count * reached[-1])
    return Elements(elements.middle[chosen], np.full(count, 1.0 / count))


def weighted_quantile(values: np.ndarray, share: np.ndarray, q: float = 0.95) -> float:
    """The value below which lies the share `q` of the area."""
    order = np.argsort(values)
    return float(values[order][np.searchsorted(np.cumsum(share[order]), q)])
