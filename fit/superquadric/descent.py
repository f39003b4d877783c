"""Descents of superquadric fits in unit frames: screening of starts, descent of the best."""

from functools import lru_cache

import jax
import numpy as np

from fit.arrays import is_valid, row_medians
from fit.fit_status import FitStatus, is_fitted
from fit.optimize.batch import Program, map_lanes, take
from fit.optimize.multistart import Problem, Solution, advance, finish, screen
from fit.optimize.pieces import PIECE, divided, undivided
from fit.prepare import Sets
from fit.rotation import matrix_of_quaternion, quaternion_of_matrix
from fit.superquadric.field import KINDS, widening
from fit.superquadric.parameter_vector import MAX_BEND, TAPER_BOUND, Form
from fit.superquadric.record import (
    MAX_EXPONENT,
    MIN_EXPONENT,
    SuperquadricFit,
    SuperquadricOptions,
)
from fit.superquadric.residuals import (
    BY_POINT,
    FitData,
    arms_of_normals,
    evaluate,
    normal_equations,
)
from fit.superquadric.starts import box_starts, taper_starts

START_EXPONENT_LOGITS = (-2.0, -1.0)
"""e1 = 0.33 and e2 = 0.61: rather flat, but not so flat that descents get stuck."""
MIN_STD = 1e-6
"""Minimum standard deviation of a touch in the unit frame, so that none dominates."""
ROBUST_TUNING = {"none": 1.0, "pseudo_huber": 1.345, "cauchy": 2.385, "geman_mcclure": 3.0}
"""Scale of each loss in standard deviations: 95 % efficiency on Gaussian residuals."""


def fit_sets(
    sets: Sets, options: SuperquadricOptions, start: SuperquadricFit | None = None
) -> dict[str, np.ndarray]:
    """Fits of sets with one padded number of points, by field of the result."""
    residual = options.residual or ("volume_distance" if options.taper else "solina")
    form = Form(options.taper, options.bend, residual, options.loss)
    lanes, theta = _begin(sets, form, options, start)
    lanes, theta = _refresh(lanes, theta, sets, form, options)
    # Weights, loss scale and strength of the priors depend on the shape: fix them first.
    settled = advance(_problem(form), theta, lanes, options.settle_iterations)
    if options.iterations == 0:
        none = np.zeros(len(theta), int)
        end = Solution(settled.theta, settled.cost, none, none + FitStatus.not_converged)
        return _rows(end, lanes, sets, form)
    lanes, theta = _refresh(lanes, settled.theta, sets, form, options)
    end = finish(_problem(form), theta, lanes, settled.damping,
                 at_a_time=options.round_iterations, at_most=options.iterations,
                 least_fall=options.least_fall)
    return _rows(end, lanes, sets, form)


def _begin(sets: Sets, form: Form, options: SuperquadricOptions, start: SuperquadricFit | None):
    """Initial parameters of each fit: those of `start` if fitted, else of the best start."""
    lanes = _lanes(sets, options)
    theta = np.zeros((len(sets.count), form.parameters))
    fresh = np.ones(len(theta), bool)
    if start is not None:
        theta = _parameters_of(start, sets, form)
        rotation = matrix_of_quaternion(start.quaternion_xyzw)
        known = is_valid(theta).all(axis=1) & is_valid(rotation).all(axis=(1, 2))
        fresh = ~(is_fitted(start.status) & known)
        lanes = lanes._replace(rotation=rotation)
    if fresh.any():
        rows = np.flatnonzero(fresh)
        rotation = lanes.rotation.copy()
        rotation[rows], theta[rows] = _screen(sets.subset(rows), form, options)
        lanes = lanes._replace(rotation=rotation)
    return lanes, theta


def _parameters_of(start: SuperquadricFit, sets: Sets, form: Form) -> np.ndarray:
    """Parameter vectors of fits in unit frames, shape [fit, parameter].

    The inverse of `parameter_vector.unpack`, with values clipped away from their bounds.
    """
    size = np.maximum(start.size_m / sets.scale[:, None], 1e-3)
    share = (start.exponents - MIN_EXPONENT) / (MAX_EXPONENT - MIN_EXPONENT)
    share = np.clip(share, 1e-3, 1 - 1e-3)
    theta = np.zeros((len(size), form.parameters))
    theta[:, 0:3] = np.log(size)
    theta[:, 3:5] = np.log(share / (1 - share))
    shift = (start.position_m - sets.origin) / sets.scale[:, None]
    theta[:, 8:11] = np.einsum("fji,fj->fi", matrix_of_quaternion(start.quaternion_xyzw), shift)
    if form.taper:
        theta[:, 11:13] = np.arctanh(np.clip(start.taper / TAPER_BOUND, -0.95, 0.95))
    if form.bend:
        reach = np.linalg.norm(size, axis=1) / MAX_BEND
        bent = np.minimum(start.bend[:, 0] * sets.scale * reach, 0.95)
        v = (bent / np.sqrt(1 - bent**2))[:, None]
        theta[:, -2:] = v * np.stack([np.cos(start.bend[:, 1]), np.sin(start.bend[:, 1])], axis=1)
    return theta


def _lanes(sets: Sets, options: SuperquadricOptions) -> FitData:
    """Data of each fit before its shape is known."""
    n = len(sets.count)
    weight = _unit(sets.mask.astype(float))
    if sets.covariance is not None:
        weight = _weight(np.trace(sets.covariance, axis1=2, axis2=3) / 3, sets, options)
    plane = None
    if sets.plane is not None:
        plane = np.concatenate([sets.plane, np.full((n, 1), options.plane_weight)], axis=1)
    free = None
    if sets.free is not None:
        radius = sets.free[:, 3:4]
        share = (radius > 0) / np.sqrt(np.maximum((radius > 0).sum(2, keepdims=True), 1))
        free = np.concatenate([sets.free, options.free_weight * share], axis=1)
    normals, normal_weight = None, None
    if sets.normals is not None:
        felt = np.isfinite(sets.normals).all(axis=2) & sets.mask
        fallback = np.where(felt[..., None], sets.normals, [0.0, 0.0, 1.0])
        normals = np.moveaxis(fallback, 2, 1).copy()
        normal_weight = options.normal_weight * felt * weight
    return FitData(
        points=np.moveaxis(sets.points, 2, 1).copy(),
        weight=weight,
        rotation=np.tile(np.eye(3), (n, 1, 1)),
        loss_scale=0.1 / np.sqrt(sets.count),
        ridge=np.full(n, 1e-3 * options.prior),
        edge=1e-3 * _edge(options) * np.ones(n),
        upright=_upright(0.01 / np.sqrt(sets.count), sets, options),
        plane=plane,
        normals=normals,
        normal_weight=normal_weight,
        free=free,
    )


def _edge(options: SuperquadricOptions) -> float:
    """Weight of the prior on e1, in standard deviations of the noise."""
    if options.mean_exponent is None:
        return 0.0
    rate = 1.0 / (options.mean_exponent - MIN_EXPONENT)
    return float(np.sqrt(2.0 * rate * (MAX_EXPONENT - MIN_EXPONENT)))


def _upright(deviation: np.ndarray, sets: Sets, options: SuperquadricOptions):
    if options.upright_std_rad is None or sets.plane is None:
        return None
    return np.stack([np.full(len(deviation), options.upright_std_rad), deviation], axis=1)


def _weight(variance: np.ndarray, sets: Sets, options: SuperquadricOptions) -> np.ndarray:
    """Weights of touches with these variances in the unit frame."""
    variance = variance + (options.sigma_floor_m / sets.scale[:, None]) ** 2
    return _unit(sets.mask / np.sqrt(np.maximum(variance, MIN_STD**2)))


def _unit(weight: np.ndarray) -> np.ndarray:
    return weight / np.sqrt((weight**2).sum(axis=1, keepdims=True))


def begin_starts(
    sets: Sets, form: Form, options: SuperquadricOptions
) -> tuple[FitData, np.ndarray]:
    """Starts of each fit: data with a row for every start of every fit, and parameters, shape
    [fit, start, parameter]."""
    down, floor = (None, None) if sets.plane is None else (sets.plane[:, :3], sets.plane[:, 3])
    trim = 0.0 if options.loss == "none" else 0.05
    rotation, half, centre = box_starts(sets.points, sets.mask, down, floor, trim,
                                        options.upright_starts and down is not None)
    n, starts = rotation.shape[:2]
    theta = np.zeros((n, starts, form.parameters))
    if form.taper:
        taper = taper_starts(sets.points, sets.mask, rotation, half, centre)
        theta[..., 11:13] = np.arctanh(taper / TAPER_BOUND)
        # The extents are those of the widest section; sizes are those of the middle one.
        half = half / np.concatenate([1 + np.abs(taper), np.ones((n, starts, 1))], axis=2)
    theta[..., 0:3] = np.log(half)
    theta[..., 3:5] = START_EXPONENT_LOGITS
    theta[..., 8:11] = np.einsum("fsji,fsj->fsi", rotation, centre)
    spread = take(_lanes(sets, options), np.repeat(np.arange(n), starts))
    return spread._replace(rotation=rotation.reshape(-1, 3, 3)), theta


def _screen(sets: Sets, form: Form, options: SuperquadricOptions):
    """Rotation and parameters of each fit's best start after a few iterations."""
    spread, theta = begin_starts(sets, form, options)
    best, found = screen(_problem(form), theta, spread, options.screen_iterations, _badness(form))
    row = np.arange(len(found))
    return spread.rotation.reshape(*theta.shape[:2], 3, 3)[row, best], found


def _badness(form: Form):
    """Ranking criterion of starts: the cost, without the volume factor of volume_distance."""
    if form.residual != "volume_distance":
        return lambda theta, cost: cost

    # A vanishing body has no cost, however far from the touches it is.
    def without(theta: np.ndarray, cost: np.ndarray) -> np.ndarray:
        taper = np.clip(TAPER_BOUND * np.tanh(theta[:, 11:13 if form.taper else 11]), -1.0, 1.0)
        return cost * np.exp(-theta[:, 0:3].sum(axis=1)) / np.prod(widening(taper), axis=1)

    return without


def _refresh(lanes: FitData, theta, sets: Sets, form: Form, options: SuperquadricOptions):
    """Data with tangent frame, weights and loss scale for the shape at `theta`."""
    body, away, normal, raw = _evaluated(theta, lanes, form)
    weight = lanes.weight
    spare = np.maximum(sets.count - form.parameters, 1) / sets.count
    if sets.covariance is not None:
        variance = np.einsum("fip,fpij,fjp->fp", normal, sets.covariance, normal)
        weight = _weight(variance, sets, options)
        sigma = np.hypot(np.sqrt(np.maximum(variance, MIN_STD**2)),
                         options.sigma_floor_m / sets.scale[:, None])
    else:
        sigma = np.maximum(_typical(away, sets.mask, spare), MIN_STD)[:, None]
    deviation = _typical(raw * weight, sets.mask, spare)
    least = 1e-4 / np.sqrt(sets.count)
    scale = lanes.loss_scale
    if form.loss != "none":
        scale = np.clip(ROBUST_TUNING[form.loss] * deviation, least, scale)
    deviation = np.clip(deviation, 0.1 * least, lanes.loss_scale)
    ridge = options.prior * deviation
    upright = _upright(deviation, sets, options)
    normal_weight = _normal_weight(theta, lanes, weight, sigma, form, options)
    theta = theta.copy()
    theta[:, 5:8] = 0.0
    theta[:, 8:11] = np.einsum("fji,fj->fi", body.rotation, body.position)
    return lanes._replace(rotation=body.rotation, weight=weight, loss_scale=scale,
                          ridge=ridge, edge=_edge(options) * deviation,
                          upright=upright, normal_weight=normal_weight), theta


def _typical(residuals: np.ndarray, mask: np.ndarray, spare: np.ndarray) -> np.ndarray:
    """Standard deviations of residuals [fit, point] by their medians; `spare` [fit] is the share of
    points that parameters leave over."""
    size = np.where(mask, np.abs(residuals), np.nan)
    return 1.4826 * row_medians(size) / np.sqrt(spare)


def _normal_weight(theta, lanes: FitData, weight, sigma: np.ndarray, form: Form,
                   options: SuperquadricOptions):
    """Weights of the residuals of normals, shape [fit, point]; None without normals.

    A tangent plane is uncertain by its touch, `sigma` (fit, point or 1) in the unit frame, and by
    its normal times the arm. Normals that err pull a plane inwards whichever way they err, since
    the support is a maximum: by no more than that, so that such planes have to count less.
    """
    if lanes.normals is None or lanes.normal_weight is None:
        return None
    turned = options.normal_std_rad * _arms(theta, lanes, form)
    return (options.normal_weight * (lanes.normal_weight > 0.0) * weight
            * sigma / np.hypot(sigma, turned))


def _rows(end: Solution, lanes: FitData, sets: Sets, form: Form) -> dict[str, np.ndarray]:
    """The fits in metres in the world frame, by field of the result."""
    body, away, _, _ = _evaluated(end.theta, lanes, form)
    n = len(end.status)
    scale = sets.scale
    square = np.where(sets.mask, away**2, 0.0).sum(1) / sets.count
    bend = np.zeros((n, 2)) if body.bend is None else body.bend
    return {
        "size_m": body.size * scale[:, None],
        "exponents": body.exponents,
        "position_m": body.position * scale[:, None] + sets.origin,
        "quaternion_xyzw": quaternion_of_matrix(body.rotation),
        "taper": np.zeros((n, 2)) if body.taper is None else body.taper,
        "bend": np.stack([np.hypot(*bend.T) / scale, np.arctan2(bend[:, 1], bend[:, 0])], axis=1),
        "rms_m": np.sqrt(square) * scale,
        "cost": end.cost,
        "iterations": end.iterations,
        "status": end.status,
        "n_points": sets.count,
    }


def _evaluated(theta, lanes: FitData, form: Form):
    """`evaluate` of every fit."""
    found, pieces, whole = _by_pieces(_evaluate(form.taper, form.bend), theta, lanes,
                                      (lanes.points,), (_kind(form),))
    return take(found[0], np.arange(0, len(theta) * pieces, pieces)), *map(whole, found[1:])


def _arms(theta, lanes: FitData, form: Form) -> np.ndarray:
    """`arms_of_normals` of every fit, shape [fit, point]."""
    found, _, whole = _by_pieces(_arms_program(form.taper, form.bend), theta, lanes,
                                 (lanes.points, lanes.normals))
    return whole(found)


def _by_pieces(program: Program, theta, lanes: FitData, by_point: tuple, shared: tuple = ()):
    """What a program of (theta, rotation, *by_point) finds, each piece of the points of a fit being
    a lane; how many pieces a fit has; and what puts values by point together again."""
    parts = [divided(values) for values in by_point]
    n, pieces = parts[0].shape[:2]
    found = map_lanes(
        program, np.repeat(theta, pieces, axis=0), np.repeat(lanes.rotation, pieces, axis=0),
        *(part.reshape(-1, 3, PIECE) for part in parts), shared=shared)
    whole = lambda values: undivided(  # noqa: E731
        values.reshape(n, pieces, *values.shape[1:]), by_point[0].shape[2])
    return found, pieces, whole


@lru_cache(maxsize=64)
def _arms_program(taper: bool, bend: bool) -> Program:
    form = Form(taper, bend, KINDS[0], "none")
    return Program(f"arms of normals, {taper=}, {bend=}", jax.vmap(
        lambda theta, rotation, points, normals: arms_of_normals(
            theta, rotation, points, normals, form)))


@lru_cache(maxsize=64)
def _evaluate(taper: bool, bend: bool) -> Program:
    form = Form(taper, bend, KINDS[0], "none")
    return Program(f"evaluate superquadrics, {taper=}, {bend=}", jax.vmap(
        lambda theta, rotation, points, kind: evaluate(theta, rotation, points, form, kind),
        in_axes=(0, 0, 0, None)))


def _kind(form: Form) -> np.int32:
    return np.int32(KINDS.index(form.residual))


def _problem(form: Form) -> Problem:
    return _any_residual(form._replace(residual=KINDS[0]))._replace(choice=int(_kind(form)))


@lru_cache(maxsize=64)
def _any_residual(form: Form) -> Problem:
    """The problem of a form, whose residual is a run-time argument."""
    # Jitted so that it is traced once, for the first evaluation and all others.
    equations = jax.jit(
        lambda theta, data, span, kind: normal_equations(theta, data, form, span, kind))
    name = f"superquadrics, taper={form.taper}, bend={form.bend}, loss={form.loss}"
    return Problem(equations, name, BY_POINT)
