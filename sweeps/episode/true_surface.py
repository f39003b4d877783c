"""Distances to a true body's surface.

A single primitive's signed distance is exact. That of a union is a bound within it, of a difference
or an intersection anywhere, of a grid beyond its box, and a superquadric's is of the first order:
there the nearest of some thousand discs that touch the surface stands for it.
"""

import numpy as np

from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of
from warpgrasp.geometry.body_sampling import sample_body

DISCS = 8192


def distance_to_surface(body: Body, points_m: np.ndarray, *, device: str = "cpu") -> np.ndarray:
    """Unsigned distance [m] of points (world, point, 3) of the body's frame, (world, point).

    Points that are not finite have no finite one.
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
