"""Values of fitted processes at points: distance, its gradient and its standard deviation."""

from dataclasses import dataclass
from typing import Literal

import jax
import numpy as np
from jaxtyping import Float, Int

from fit.arrays import read_only_view
from fit.implicit.process import predict, predict_with_slope, slope
from fit.implicit.record import ImplicitFit, Mean
from fit.optimize.batch import Program, map_lanes
from fit.option_checks import checked_array

CHUNK = 512
"""Queries of a lane."""
STEP_M = 1e-5
"""Of the differences that give the mean's gradient [m]."""
_VALUES = Program("implicit values", jax.vmap(predict))
_SLOPES = Program("implicit slopes", jax.vmap(predict_with_slope))
_GRADIENTS = Program("implicit gradients", jax.vmap(slope))


@dataclass(frozen=True)
class ImplicitValues:
    """Signed distances at queries, negative inside."""

    distance_m: Float[np.ndarray, "fit query"]
    gradient: Float[np.ndarray, "fit query 3"]
    std_m: Float[np.ndarray, "fit query"]
    """Posterior standard deviation of the distance [m]."""


def sphere_mean(fits: ImplicitFit) -> Mean:
    """The mean of fits that were given none: the signed distance of a sphere about the touches."""
    def distance(points: np.ndarray, rows: np.ndarray) -> np.ndarray:
        arms = points - fits.centre_m[rows, None]
        return np.sqrt(np.einsum("fpi,fpi->fp", arms, arms)) - fits.radius_m[rows, None]

    return distance


def of_rows(mean: Mean | None, rows: np.ndarray) -> Mean | None:
    """The mean of the fits `rows`, numbered anew."""
    return None if mean is None else lambda points, own: mean(points, rows[own])


def implicit_values(
    fits: ImplicitFit, queries_m: Float[np.ndarray, "fit query 3"], mean: Mean | None = None,
    *, counts: Int[np.ndarray, " fit"] | None = None,
) -> Float[np.ndarray, "fit query"]:
    """Signed distances [m] at queries [m]; `mean` is that of the fit. Below the table all is free.

    Of each fit the first `counts` queries are wanted; values of the others are of no meaning.
    The process is computed in single precision, to some micrometres. Raises ValueError where shapes
    disagree.
    """
    value = _asked(fits, queries_m, mean, "value", counts=counts)[0]
    return np.maximum(value, fits.table_z_m[:, None] - queries_m[..., 2])


def implicit_distance(
    fits: ImplicitFit, queries_m: Float[np.ndarray, "fit query 3"], mean: Mean | None = None
) -> ImplicitValues:
    """Signed distances with gradients and standard deviations; otherwise as `implicit_values`.

    Where the table decides, the gradient is that of the table; the deviation is the process'.
    """
    value, gradient, variance = _asked(fits, queries_m, mean, "variance")
    gradient = gradient + mean_gradient(mean or sphere_mean(fits), queries_m)
    below = fits.table_z_m[:, None] - queries_m[..., 2]
    table = below > value
    return ImplicitValues(np.where(table, below, value),
                          np.where(table[..., None], [0.0, 0.0, -1.0], gradient),
                          np.sqrt(variance))


def implicit_slopes(
    fits: ImplicitFit, queries_m: Float[np.ndarray, "fit query 3"], mean: Mean | None = None
) -> tuple[Float[np.ndarray, "fit query"], Float[np.ndarray, "fit query 3"]]:
    """Signed distances [m] and their gradients, the table aside, without deviations, whose cost
    grows with the cube of the touches. Raises ValueError where shapes disagree."""
    value, gradient = _asked(fits, queries_m, mean, "gradient")
    return value, gradient + mean_gradient(mean or sphere_mean(fits), queries_m)


def mean_gradient(
    mean: Mean, queries_m: Float[np.ndarray, "fit query 3"]
) -> Float[np.ndarray, "fit query 3"]:
    """Gradient of a mean by central differences; 0 where it has none."""
    steps = STEP_M * np.eye(3)
    around = np.concatenate([queries_m + s for s in (*steps, *-steps)], axis=1)
    values = mean(around, np.arange(len(around))).reshape(
        len(queries_m), 6, queries_m.shape[1])
    gradient = (values[:, :3] - values[:, 3:]) / (2.0 * STEP_M)
    return np.nan_to_num(np.moveaxis(gradient, 1, 2), posinf=0.0, neginf=0.0)


def _asked(fits: ImplicitFit, queries_m: np.ndarray, mean: Mean | None,
           most: Literal["value", "gradient", "variance"], *, counts: np.ndarray | None = None
           ) -> list[np.ndarray]:
    """Of every query the distance and, up to `most`, the process' gradient and its variance."""
    queries_m = checked_array("queries_m", queries_m, (len(fits), None, 3))
    n, count = queries_m.shape[:2]
    given = checked_array("mean", (mean or sphere_mean(fits))(
        read_only_view(queries_m), np.arange(n)), (n, count))
    chunks = max(-(-count // CHUNK), 1)
    room = np.zeros((n, chunks * CHUNK, 3))
    room[:, :count] = queries_m - fits.centre_m[:, None]
    wanted = np.full(n, count) if counts is None else counts
    lane = np.flatnonzero((np.arange(chunks) * CHUNK < wanted[:, None]).ravel())
    queries, each = room.reshape(n * chunks, CHUNK, 3)[lane], lane // chunks
    used = fits.noise_m2 >= 0.0
    width = int(np.max(np.where(used.any(0), np.arange(used.shape[1]) + 1, 1), initial=1))
    width = min(-(-width // 32) * 32, used.shape[1])
    points = np.where(used[..., None], fits.points_m - fits.centre_m[:, None], 0.0)[:, :width]
    lanes = [fits.length_m[each], fits.amplitude_m[each], points[each],
             fits.alpha_per_m[each, :width]]
    if len(lane) == 0:
        none = {"value": given, "gradient": np.zeros((n, count, 3)),
                "variance": np.zeros((n, count))}
        return list(none.values())[:list(none).index(most) + 1]
    if most == "variance":
        noise = np.where(used, fits.noise_m2, 1.0)[each, :width]
        found = map_lanes(_SLOPES, *lanes, noise, used[each, :width].astype(float), queries)
    else:
        found = [map_lanes(_VALUES, *lanes, queries)]
        if most == "gradient":
            found.append(map_lanes(_GRADIENTS, *lanes, queries))
    out = []
    for values in found:
        whole = np.zeros((n * chunks, *values.shape[1:]))
        whole[lane] = values
        out.append(whole.reshape(n, chunks * CHUNK, *values.shape[2:])[:, :count])
    out[0] = out[0] + given
    return out
