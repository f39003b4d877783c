"""Distances from points to the surface of a true body.

The signed distance of a single primitive is exact. Others are bounds: that of a union inside it,
that of a difference or an intersection everywhere, that of a grid outside its box; that of a
superquadric is of first order. For these bodies the surface is sampled with oriented discs, and
the distance to the nearest disc is used: with v from the disc's centre to the point, n its normal
and r its radius, the distance is that of (v . n, max(|v - (v . n) n| - r, 0)).
"""

import numpy as np

from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of
from warpgrasp.geometry.body_sampling import sample_body

DISCS = 8192
"""Discs of a sampled surface."""


def distance_to_surface(body: Body, points_m: np.ndarray, *, device: str = "cpu") -> np.ndarray:
    """Unsigned distances [m] of points to the body's surface, shape (world, point).

    `points_m` has shape (world, point, 3), in the body's frame. A point that is not finite has a
    distance that is not finite.
    """
    if body.has_exact_distance:
        signed, _ = distance_to_bodies(scene_of([body], device), np.zeros(1, int), points_m,
                                       device=device)
        return np.abs(signed)
    sample = sample_body(body, surface=DISCS)
    known = np.isfinite(points_m).all(-1, keepdims=True)
    away, nearest = sample.tree.query(np.where(known, points_m, 0.0))
    v = points_m - sample.surface_m[nearest]
    height = (v * sample.surface_normal[nearest]).sum(-1)
    aside = np.sqrt(np.maximum(away**2 - height**2, 0.0)) - sample.reach_m[nearest]
    return np.hypot(height, np.maximum(aside, 0.0))
