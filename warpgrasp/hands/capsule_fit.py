"""Capsules that stand for meshes and cylinders, with the error of each.

The capsule's surface is fitted to points of the mesh's convex hull by least squares of their
signed distances; what lies inside a mesh touches nothing.
"""

import numpy as np
import trimesh
from scipy.optimize import least_squares

from warpgrasp.hands.hand_model import Capsule, vector_of

_POINTS = 1500
_SEED = 0
"""Of the points on the hull: a fit is the same every time."""


def distance_to_capsule(points_m: np.ndarray, start: np.ndarray, end: np.ndarray,
                        radius_m: float) -> np.ndarray:
    """Signed distances of points (n, 3) from a capsule's surface [m]."""
    along = end - start
    length2 = float(along @ along)
    share = np.clip((points_m - start) @ along / length2, 0.0, 1.0) if length2 > 0.0 else 0.0
    nearest = start + np.multiply.outer(np.broadcast_to(share, len(points_m)), along)
    return np.linalg.norm(points_m - nearest, axis=1) - radius_m


def fit_capsule(vertices_m: np.ndarray) -> Capsule:
    """The capsule nearest to the convex hull of points (n, 3) [m], with its largest error.

    Raises ValueError for points in one plane.
    """
    try:
        hull = trimesh.Trimesh(vertices_m, process=False).convex_hull
    except Exception as error:  # Qhull's own error, which SciPy keeps in a private module
        raise ValueError("its points lie in one plane") from error
    points = np.concatenate([hull.vertices, trimesh.sample.sample_surface(
        hull, _POINTS, seed=_SEED)[0]])
    middle = points.mean(0)
    axes = np.linalg.svd(points - middle, full_matrices=False)[2]
    best = min((_descend(points, middle, axis) for axis in axes), key=lambda found: found.cost)
    start, end, radius = best.x[:3], best.x[3:6], abs(float(best.x[6]))
    error = float(np.abs(distance_to_capsule(points, start, end, radius)).max())
    return Capsule(vector_of(start), vector_of(end), radius, error)


def capsule_of_cylinder(radius_m: float, length_m: float) -> tuple[float, float, float]:
    """Half the length between the ends of the nearest capsule along a cylinder's axis, its radius,
    and its largest error [m]; by least squares over the cylinder's surface."""
    u = (np.arange(_POINTS) + 0.5) / _POINTS
    side = np.stack([np.full(_POINTS, radius_m), u * length_m / 2], 1)
    end = np.stack([np.sqrt(u) * radius_m, np.full(_POINTS, length_m / 2)], 1)
    weight = np.sqrt(np.repeat([length_m, radius_m], _POINTS))  # by the areas of side and ends
    points = np.concatenate([side, end])  # off the axis and along it, of one half

    def off(x: np.ndarray) -> np.ndarray:
        beyond = np.maximum(points[:, 1] - x[0], 0.0)
        return np.hypot(points[:, 0], beyond) - x[1]

    found = least_squares(lambda x: weight * off(x), [max(length_m / 2 - radius_m, 0.0), radius_m],
                          x_scale=length_m + radius_m, bounds=(0.0, np.inf)).x.round(9)
    rim = np.array([[radius_m, 0.0], [radius_m, length_m / 2], [0.0, length_m / 2]])
    points = np.concatenate([points, rim])
    return float(found[0]), float(found[1]), float(np.abs(off(found)).max())


def _descend(points: np.ndarray, middle: np.ndarray, axis: np.ndarray):
    """The least squares from a capsule along `axis`."""
    along = (points - middle) @ axis
    across = np.linalg.norm(points - middle - np.outer(along, axis), axis=1)
    radius = float(np.median(across))
    low, high = along.min() + radius, along.max() - radius
    if low > high:
        low = high = (low + high) / 2
    guess = np.concatenate([middle + low * axis, middle + high * axis, [radius]])
    guess[3:6] += 1e-6 * axis  # a ball's axis has no direction to descend by
    scale = float(np.ptp(points, axis=0).max())
    return least_squares(lambda x: distance_to_capsule(points, x[:3], x[3:6], x[6]), guess,
                         x_scale=scale, max_nfev=200)
