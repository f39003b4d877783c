"""Signed distance of recovered bodies: the prior mean of free-form bodies."""

from dataclasses import dataclass

import numpy as np

from fit.arrays import rows_of
from fit.revolution.geometry import RevolutionBody, revolution_inside
from fit.superquadric.geometry import SuperquadricLike
from strategies.recovery.body_distances import contour_distances, surface_distances
from strategies.recovery.choose_model import Recovered, Shape


@dataclass(frozen=True)
class DistanceToRecovered:
    """Signed distances [m] of points to the body that stands for each world, negative inside.

    Of a contour exact; of a superquadric, and of the prior, of first order in the distance, and
    never deeper than the body's least half extent. A `Mean` that can be pickled.
    """

    recovered: Recovered

    def __call__(self, points_m: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Of the worlds numbered (row,) at points (row, point, 3): (row, point)."""
        recovered, out = self.recovered, np.empty(points_m.shape[:2])
        turned = recovered.shape[rows] == Shape.REVOLUTION
        others = np.flatnonzero(~turned)
        if len(others):
            out[others] = superquadric_distance(
                rows_of(recovered.superquadric, rows[others]), points_m[others])
        mine = np.flatnonzero(turned)
        if len(mine) and recovered.revolution is not None:
            out[mine] = revolution_distance(recovered.revolution[rows[mine]], points_m[mine])
        return out


def superquadric_distance(body: SuperquadricLike, points_m: np.ndarray) -> np.ndarray:
    """First-order signed distances [m], (world, point); at a centre minus the least half extent."""
    every = np.ones(points_m.shape[:2], bool)
    signed, normal = surface_distances(body, points_m, every)
    deepest = -body.size_m.min(axis=1)[:, None]
    known = np.isfinite(signed) & normal.any(axis=2)
    return np.where(known, np.maximum(signed, deepest), deepest)


def revolution_distance(body: RevolutionBody, points_m: np.ndarray) -> np.ndarray:
    """Signed distances [m], (world, point)."""
    away = contour_distances(body, points_m, np.ones(points_m.shape[:2], bool))
    return np.where(revolution_inside(body, points_m), -away, away)
