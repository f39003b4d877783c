"""Free-form bodies from sparse touches, in batch: a Gaussian process over signed distance.

    touches -> unit frame -> rows of the process -> starts -> rounds -> free space -> posterior

A round estimates which touches are outliers, then improves the hyperparameters. Rows are touches
(f = 0), points off the surface along known normals (f = their offset) and, last, the balls of free
space that the body would otherwise enter (f = their radius at the centre).
"""

from collections.abc import Iterator

import jax
import numpy as np
from jaxtyping import Bool, Float

from fit.arrays import with_rows
from fit.fit_status import FitStatus
from fit.implicit.free_space import FreeSpace, chosen_balls, free_space, with_balls
from fit.implicit.outliers import outlier_weights
from fit.implicit.process import (
    LEAST_AMPLITUDE,
    Posterior,
    ProcessData,
    normal_equations,
    posterior,
    slope_at_rows,
)
from fit.implicit.process_rows import FREE_ROWS, Rows, row_bucket, touch_rows, with_normals
from fit.implicit.query import implicit_values, sphere_mean
from fit.implicit.record import ImplicitFit, ImplicitOptions, Mean
from fit.optimize.batch import Program, map_lanes, take
from fit.optimize.multistart import CONCLUSIVE_DAMPING, Problem, advance
from fit.option_checks import check_balls, options_of
from fit.prepare import Sets, prepare

STARTS = (1.0, 3.0)
"""Length scales of the starts, in units of the root mean square distance from the centre."""
NO_TABLE_M = -1e12
FIRST_LENGTH, FIRST_SLOPE = 0.7, 0.4
"""Hyperparameters by which normals are estimated, in unit frames: length scale, and amplitude over
length^1.5 [est]."""
LEAST_SLOPE = 0.2
"""A normal is not estimated where the process rises less than this."""
SETTLED = 0.1
"""The weights of a converged fit changed by less than this in its last round."""
SLOPE_START = 0.4
"""Amplitude over length^1.5 of the starts, in unit frames."""
_PROBLEM = Problem(normal_equations, "implicit process")
_SLOPE = Program("implicit slope at rows", jax.vmap(slope_at_rows))
_POSTERIOR = Program("implicit posterior", jax.vmap(posterior))


def fit_implicit(
    points: Float[np.ndarray, "fit point 3"],
    mask: Bool[np.ndarray, "fit point"] | None = None,
    *,
    covariance: Float[np.ndarray, "fit point 3 3"] | None = None,
    normals: Float[np.ndarray, "fit point 3"] | None = None,
    mean: Mean | None = None,
    table_z: float | Float[np.ndarray, " fit"] | None = None,
    free_points: Float[np.ndarray, "fit free 3"] | None = None,
    free_radius: float | Float[np.ndarray, "fit free"] | None = None,
    free_mask: Bool[np.ndarray, "fit free"] | None = None,
    options: ImplicitOptions | None = None,
) -> ImplicitFit:
    """Fit free-form bodies to sets of touches.

    Args:
        points: touches [m], shape [fit, point, 3]. Exact copies count as touches that agree: they
            make the noise that is found too small.
        mask: which points count, shape [fit, point]; None: all.
        covariance: of each touch [m^2]; what counts is its part along the normal, or along the
            mean's slope where no normal is known.
        normals: outward normals at the touches, NaN where unknown.
        mean: signed distance of the body believed before [m]; None: a sphere about the touches.
            Where touches agree with it, and far from them, the body stays that of the mean. A set
            at a touch of which it is no number is `bad_points`.
        table_z: height of a table, below which nothing of the body is [m].
        free_points, free_radius, free_mask: balls [m] of known free space; one whose place or
            radius is no number, or whose radius is negative, does not count.
        options: see `ImplicitOptions`.

    Returns:
        `ImplicitFit`; a set that cannot be fitted has a `status` that says why.

    Raises:
        ValueError: an array of the wrong shape, a radius or mask of free points without the points,
            or one radius of all that is none.
    """
    options = options_of(options, ImplicitOptions)
    check_balls(free_points, free_radius, free_mask)
    sets = prepare(points, mask, covariance, normals, table_z)
    fits = _placeholder(sets, np.asarray(points).shape[1], table_z)
    mean = mean or sphere_mean(fits)
    free = None
    if free_points is not None:
        free = free_space(sets, mean, free_points, free_radius, free_mask)
        free = free if free.kept.shape[1] and options.free_rounds else None
    if not (fits.status == FitStatus.converged).any():
        return _widened(fits, 1)
    rows = touch_rows(sets, mean, options, 0 if free is None else FREE_ROWS)
    fits.status[~rows.fitted & (fits.status == FitStatus.converged)] = FitStatus.bad_points
    rows = with_normals(rows, sets, mean, _first_normals(rows), options)
    buckets: list[tuple[np.ndarray, np.ndarray, ProcessData]] = []
    for index, data in _buckets(rows):
        theta, data, iterations, status = _hyperparameters(data, options)
        fits.iterations[index], fits.status[index] = iterations, status
        buckets.append((index, theta, data))
    fits = _widened(fits, max([data.target.shape[1] for _, _, data in buckets], default=1))
    for index, theta, data in buckets:
        _put(fits, index, theta, data, sets, rows)
    return fits if free is None else _outside(fits, free, buckets, sets, rows, mean, options)


def _outside(fits: ImplicitFit, free: FreeSpace, buckets, sets: Sets, rows: Rows, mean: Mean,
             options: ImplicitOptions) -> ImplicitFit:
    """The fits kept out of free space; balls tell of the hyperparameters, too."""
    chosen = np.full((len(fits), FREE_ROWS), -1)
    push = np.zeros(chosen.shape)
    for _ in range(options.free_rounds):
        depth = np.where(free.kept, free.radius_m - implicit_values(fits, free.points_m, mean),
                         -np.inf)
        chosen = chosen_balls(depth, chosen, push)
        for index, theta, data in buckets:
            data = with_balls(data, free, chosen, index, sets, options)
            told = np.flatnonzero((chosen[index] >= 0).any(axis=1))
            if len(told):
                theta[told] = _hyperparameters(take(data, told), options)[0]
            push[index] = _put(fits, index, theta, _reweighted(theta, data, options), sets, rows)
    return fits


def _buckets(rows: Rows) -> Iterator[tuple[np.ndarray, ProcessData]]:
    """Indices and processes of the fits that have one padded number of rows."""
    widths = np.array([row_bucket(int(n)) for n in rows.count], int)
    for width in np.unique(widths[rows.fitted]):
        index = np.flatnonzero(rows.fitted & (widths == width))
        yield index, rows.data(index, int(width))


def _first_normals(rows: Rows) -> np.ndarray:
    """Outward normals at the touches by the process of the first hyperparameters; NaN if none."""
    fits, points = rows.mean_slope.shape[:2]
    normals = np.full((fits, points, 3), np.nan)
    for index, data in _buckets(rows):
        theta = np.tile([np.log(FIRST_LENGTH), np.log(FIRST_SLOPE), 0.0], (len(index), 1))
        theta[:, 2] = data.log_noise
        slope = map_lanes(_SLOPE, theta, data)[:, :points]
        slope = slope + rows.mean_slope[index, : slope.shape[1]]
        size = np.linalg.norm(slope, axis=2, keepdims=True)
        sound = np.isfinite(size) & (size > LEAST_SLOPE)
        normals[index, : slope.shape[1]] = np.where(sound, slope / np.where(sound, size, 1.0),
                                                    np.nan)
    return normals


def _hyperparameters(
    data: ProcessData, options: ImplicitOptions
) -> tuple[np.ndarray, ProcessData, np.ndarray, np.ndarray]:
    """theta of each lane, its data with weights, iterations made, and status."""
    lanes, starts = len(data.target), len(STARTS)
    theta = np.zeros((lanes, starts, 3))
    theta[..., 0] = np.log(STARTS)
    theta[..., 1] = np.log(SLOPE_START)
    theta[..., 2] = data.log_noise[:, None]
    begin = _reweighted(theta.reshape(-1, 3), take(data, np.repeat(np.arange(lanes), starts)),
                        options, at_first=True)
    tried = advance(_PROBLEM, theta.reshape(-1, 3), begin, options.start_iterations)
    best = np.argmin(tried.cost.reshape(lanes, starts), axis=1) + starts * np.arange(lanes)
    theta, damping = tried.theta[best], tried.damping[best]
    data = data._replace(weight=np.asarray(begin.weight)[best])
    iterations = np.full(lanes, options.start_iterations)
    status = np.full(lanes, FitStatus.not_converged)
    active = np.arange(lanes)
    for turn in range(options.rounds):
        before = data.weight[active]
        data = with_rows(data, active, _reweighted(theta[active], take(data, active), options))
        moved = advance(_PROBLEM, theta[active], take(data, active), options.round_iterations,
                        damping[active])
        # A round of rejected steps proves convergence only if the steps were short.
        rejected = (moved.theta == theta[active]).all(1) & (moved.damping < CONCLUSIVE_DAMPING)
        theta[active], damping[active] = moved.theta, moved.damping
        iterations[active] += options.round_iterations
        if turn + 1 < options.least_rounds:
            continue
        settled = np.abs(data.weight[active] - before).max(axis=1) < SETTLED
        done = (moved.decrease < options.least_fall) & settled & ~rejected
        status[active[done]] = FitStatus.converged
        active = active[~done]
        if len(active) == 0:
            break
    return theta, _reweighted(theta, data, options), iterations, status


def _reweighted(theta, data: ProcessData, options: ImplicitOptions, *,
                at_first: bool = False) -> ProcessData:
    """The processes with the weights that touches have by what all others predict for them.

    Points off the surface share the error of their touch: they do not vote, and take its weight.
    """
    if options.outlier_share == 0.0:
        return data
    touch = np.asarray(data.touch)
    own = touch == np.arange(touch.shape[1])
    found = _posterior(theta, data._replace(used=data.used * (own | (touch < 0))))
    inlying = data.variance + np.exp(2.0 * theta[:, 2:3])
    weight = outlier_weights(
        np.asarray(found.deleted), np.asarray(found.deleted_variance), inlying,
        options.outlier_share, options.outlier_m * np.exp(data.log_noise[:, None])
        / options.noise_m, at_first=at_first)
    weight = np.take_along_axis(weight, np.maximum(touch, 0), axis=1)
    return data._replace(weight=np.where((touch >= 0) & (data.used > 0), weight, 1.0))


def _posterior(theta, data: ProcessData) -> Posterior:
    return map_lanes(_POSTERIOR, theta, data)


def _put(fits: ImplicitFit, index: np.ndarray, theta: np.ndarray, data: ProcessData, sets: Sets,
         rows: Rows) -> np.ndarray:
    """Overwrite the rows `index` of the fits with what the process of theta says.

    Returns the coefficients of the last `FREE_ROWS` rows, which are those of balls.
    """
    found = _posterior(theta, data)
    scale = sets.scale[index]
    width = data.target.shape[1]
    used = data.used > 0
    fits.points_m[index, :width] = (data.points * scale[:, None, None]
                                    + sets.origin[index][:, None])
    fits.alpha_per_m[index, :width] = found.alpha / scale[:, None]
    fits.noise_m2[index, :width] = np.where(used, found.noise * scale[:, None] ** 2, -1.0)
    length = np.exp(theta[:, 0])
    fits.length_m[index] = length * scale
    fits.amplitude_m[index] = scale * np.sqrt(
        np.exp(2.0 * theta[:, 1]) * length**3 + LEAST_AMPLITUDE**2)
    fits.noise_sigma_m[index] = np.exp(theta[:, 2]) * scale
    fits.cost[index] = found.cost
    touch = rows.touches(width)[index]
    # At a touch the process differs from its target by the noise times alpha.
    miss = found.noise * found.alpha
    weight = np.where(touch, data.weight, 0.0)
    square = (weight * miss**2).sum(1) / np.maximum(weight.sum(1), 1e-12)
    fits.rms_m[index] = np.sqrt(square) * scale
    count = min(sets.order.shape[1], width)
    slots = np.nonzero(touch[:, :count])
    fits.weight[index[slots[0]], sets.order[index[slots[0]], slots[1]]] = weight[slots]
    return np.asarray(found.alpha)[:, -FREE_ROWS:]


def _placeholder(sets: Sets, points: int, table_z) -> ImplicitFit:
    """Results of sets that cannot be fitted: a sphere about their points."""
    n = len(sets.count)
    away = np.where(sets.mask, np.linalg.norm(sets.points, axis=2), np.inf)
    # The sphere inside which few touches lie; inf marks the padding of short rows.
    ordered = np.sort(np.pad(away, [(0, 0), (0, 1)], constant_values=np.inf), axis=1)
    near = ordered[np.arange(n), sets.count // 10]
    radius = np.clip(np.where(np.isfinite(near), near, 0.5), 0.25, 1.0) * sets.scale
    table = np.broadcast_to(np.asarray(NO_TABLE_M if table_z is None else table_z, float), (n,))
    return ImplicitFit(
        points_m=np.zeros((n, 1, 3)), alpha_per_m=np.zeros((n, 1)), noise_m2=np.full((n, 1), -1.0),
        weight=np.zeros((n, points)), length_m=sets.scale.copy(), amplitude_m=sets.scale.copy(),
        noise_sigma_m=np.zeros(n), centre_m=sets.origin.copy(), radius_m=radius,
        low_m=sets.low, high_m=sets.high,
        table_z_m=np.where(np.isfinite(table), table, NO_TABLE_M), cost=np.zeros(n),
        rms_m=np.zeros(n), iterations=np.zeros(n, int), status=sets.status.copy(),
        n_points=sets.count.copy())


def _widened(fits: ImplicitFit, width: int) -> ImplicitFit:
    """The placeholder with `width` empty rows."""
    n = len(fits)
    return ImplicitFit(**{**vars(fits), "points_m": np.tile(fits.centre_m[:, None], (1, width, 1)),
                          "alpha_per_m": np.zeros((n, width)),
                          "noise_m2": np.full((n, width), -1.0)})
