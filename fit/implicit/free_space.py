"""Balls of free space: the distance to the body is at least the radius at each centre.

Only balls that the body would enter matter. They are found as an active set: a violated ball
becomes a row of the process, f = its radius at its centre, and stays while its coefficient pushes
the surface away.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from fit.arrays import is_valid, read_only_view
from fit.implicit.process import ProcessData
from fit.implicit.process_rows import FREE_ROWS
from fit.implicit.record import ImplicitOptions, Mean
from fit.option_checks import checked_array, spread_array
from fit.prepare import Sets


@dataclass(frozen=True)
class FreeSpace:
    """Balls of free space of every fit."""

    points_m: Float[np.ndarray, "fit ball 3"]
    radius_m: Float[np.ndarray, "fit ball"]
    mean_m: Float[np.ndarray, "fit ball"]
    """Prior mean at the centres."""
    kept: Bool[np.ndarray, "fit ball"]


def free_space(sets: Sets, mean: Mean, points, radius, mask) -> FreeSpace:
    """Free space from the arguments of a fit. Raises ValueError for a wrong shape."""
    n = len(sets.count)
    points = checked_array("free_points", points, (n, None, 3))
    shape = points.shape[:2]
    radius = spread_array("free_radius", 0.0 if radius is None else radius, shape)
    kept = checked_array("free_mask", np.ones(shape) if mask is None else mask, shape, bool)
    kept = kept & is_valid(points).all(axis=2) & is_valid(radius) & (radius >= 0.0)
    points = np.where(kept[..., None], points, sets.origin[:, None])
    values = checked_array("mean", mean(read_only_view(points), np.arange(n)), shape)
    told = is_valid(values)
    return FreeSpace(points, radius, np.where(told, values, 0.0), kept & told)


def chosen_balls(
    depth: Float[np.ndarray, "fit ball"], chosen: Int[np.ndarray, "fit slot"],
    push: Float[np.ndarray, "fit slot"],
) -> Int[np.ndarray, "fit slot"]:
    """Which balls are rows next, -1 for none: of `chosen` those that push, then the deepest.

    `depth` [m] is by how much each ball is violated, `push` the coefficients of those chosen.
    """
    score = depth.copy()
    fit, slot = np.nonzero(chosen >= 0)
    score[fit, chosen[fit, slot]] = np.where(push[fit, slot] > 0.0, np.inf, -np.inf)
    order = np.argsort(-score, axis=1, kind="stable")[:, :chosen.shape[1]]
    best = np.where(np.take_along_axis(score, order, 1) > 0.0, order, -1)
    out = np.full(chosen.shape, -1)
    out[:, : best.shape[1]] = best
    return out


def with_balls(data: ProcessData, free: FreeSpace, chosen: np.ndarray, index: np.ndarray,
               sets: Sets, options: ImplicitOptions) -> ProcessData:
    """The processes of the fits `index` with their chosen balls as the last `FREE_ROWS` rows."""
    ball = chosen[index]
    used = ball >= 0
    at = index[:, None], np.maximum(ball, 0)
    scale = sets.scale[index, None]
    last = slice(-FREE_ROWS, None)

    def put(given: Any, values: np.ndarray, fill: float) -> np.ndarray:
        rows = np.array(given)
        mine = used if values.ndim == 2 else used[..., None]
        rows[:, last] = np.where(mine, values, fill)
        return rows

    centre = (free.points_m[at] - sets.origin[index][:, None]) / scale[..., None]
    target = (free.radius_m[at] - free.mean_m[at]) / scale
    variance = np.broadcast_to((options.free_sigma_m / scale) ** 2, target.shape)
    return data._replace(
        points=put(data.points, centre, 0.0), target=put(data.target, target, 0.0),
        variance=put(data.variance, variance, 1.0), used=put(data.used, np.ones(used.shape), 0.0))
