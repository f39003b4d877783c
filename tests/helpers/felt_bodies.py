"""Contacts on bodies of known shape, for tests of what is made of them."""

from dataclasses import replace

import numpy as np
from beliefs import belief

from fit.arrays import rows_of
from fit.superquadric.geometry import Superquadric, superquadric_areas
from strategies.recovery.evidence import Evidence

HANDLE, HEAD = (0.012, 0.012, 0.06), (0.05, 0.02, 0.02)
"""Half sizes of an upright bar and of one across its top."""


def box_points(half: tuple[float, ...], middle: tuple[float, ...], count: int, seed: int
               ) -> np.ndarray:
    """Points on a box, evenly (point, 3)."""
    rng = np.random.default_rng(seed)
    side = np.array(half)
    area = np.array([side[1] * side[2], side[0] * side[2], side[0] * side[1]])
    axis = rng.choice(3, count, p=area / area.sum())
    points = rng.uniform(-1.0, 1.0, (count, 3))
    points[np.arange(count), axis] = rng.choice([-1.0, 1.0], count)
    return points * side + np.array(middle)


def hammer(count: int = 96) -> np.ndarray:
    """Points on the union of handle and head, which stands on its handle."""
    handle, head = (0.45, 0.0, 0.06), (0.45, 0.0, 0.14)
    points = np.concatenate([box_points(HANDLE, handle, count, 0),
                             box_points(HEAD, head, count, 1)])
    inside = (np.abs(points - handle) < np.array(HANDLE) - 1e-9).all(1)
    inside |= (np.abs(points - head) < np.array(HEAD) - 1e-9).all(1)
    return points[~inside][::2]


def felt_at(points_m: np.ndarray, noise_m: float = 0.0005) -> Evidence:
    noise = np.random.default_rng(2).normal(0.0, noise_m, points_m.shape)
    both = np.repeat((points_m + noise)[None], 2, 0)
    return rows_of(belief(both).evidence, np.array([0]))


def felt_on(body: Superquadric, count: int, seed: int = 1) -> Evidence:
    """Evenly spread contacts of 0.6 mm on a superquadric, with its normals."""
    points, area = superquadric_areas(body, 4096)
    rng = np.random.default_rng(seed)
    chosen = rng.choice(points.shape[1], count, p=area[0] / area[0].sum())
    felt = felt_at(points[0, chosen] + rng.normal(0.0, 0.0006, (count, 3)), 0.0)
    normals = []
    for at in points[0, chosen]:  # across the plane through the nearest points
        near = points[0, np.argsort(np.linalg.norm(points[0] - at, axis=1))[:12]]
        way = np.linalg.svd(near - near.mean(0))[2][2]
        normals.append(way * np.sign(way @ (at - body.position_m[0])))
    return replace(felt, normals=np.array(normals)[None])
