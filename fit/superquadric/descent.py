"""The descents behind a superquadric fit: starts screened, the best finished, in the unit frame."""

from __future__ import annotations

from functools import lru_cache

import jax
import numpy as np

from fit.arrays import row_medians
from fit.fit_status import FitStatus
from fit.optimize import solver
from fit.optimize.batch import Program, map_lanes, take
from fit.optimize.multistart import Finished, Problem, advance, finish, screen
from fit.prepare import Sets
from fit.rotation import matrix_of_quaternion, quaternion_of_matrix
from fit.superquadric.field import widening
from fit.superquadric.parameter_vector import (
    GREATEST_BEND,
    GREATEST_EXPONENT,
    LEAST_EXPONENT,
    TAPER_REACH,
    Form,
)
from fit.superquadric.record import SuperquadricFit, SuperquadricOptions
from fit.superquadric.residuals import Lane, look, normal_equations
from fit.superquadric.starts import box_starts, taper_starts

START_EXPONENT_LOGITS = (-2.0, -1.0)
"""e1 0.33 and e2 0.61: flat rather than round, and not so flat that a descent could not turn."""
LEAST_STD = 1e-6
"""Of a touch, in the unit frame: none outweighs all others."""
ROBUST_TUNING = {"none": 1.0, "pseudo_huber": 1.345, "cauchy": 2.385, "geman_mcclure": 3.0}
"""Standard deviations at which each loss bends: 95 % efficiency on clean Gaussian residuals."""


def fit_sets(
    sets: Sets, options: SuperquadricOptions, start: SuperquadricFit | None = None
) -> dict[str, np.ndarray]:
    """Rows of usable sets that share one padded number of points, by the field of the result."""
    residual = options.residual or ("volume_distance" if options.taper else "solina")
    form = Form(options.taper, options.bend, residual, options.loss)
    lanes, theta = _begin(sets, form, options, start)
    lanes, theta = _refresh(lanes, theta, sets, form, options)
    # Weights, scale and the strength of priors belong to a shape: settle them before the finish.
    settled = advance(_problem(form), theta, lanes, options.settle_iterations)
    if options.iterations == 0:
        none = np.zeros(len(theta), int)
        end = Finished(settled.theta, settled.cost, none, none + FitStatus.not_converged)
        return _rows(end, lanes, sets, form)
    lanes, theta = _refresh(lanes, settled.theta, sets, form, options)
    end = finish(_problem(form), theta, lanes, settled.damping,
                 at_a_time=options.round_iterations, at_most=options.iterations,
                 least_fall=options.least_fall)
    return _rows(end, lanes, sets, form)


def _begin(sets: Sets, form: Form, options: SuperquadricOptions, start: SuperquadricFit | None):
    """Where each fit begins: at its start if it has one, else at the best of its own."""
    lanes = _lanes(sets, options)
    theta = np.zeros((len(sets.count), form.parameters))
    fresh = np.ones(len(theta), bool)
    if start is not None:
        fresh = ~np.isin(start.status, (FitStatus.converged, FitStatus.not_converged))
        theta = _parameters_of(start, sets, form)
        lanes = lanes._replace(rotation=matrix_of_quaternion(start.quaternion_xyzw))
    if fresh.any():
        rows = np.flatnonzero(fresh)
        rotation = lanes.rotation.copy()
        rotation[rows], theta[rows] = _screen(sets.narrow(rows), form, options)
        lanes = lanes._replace(rotation=rotation)
    return lanes, theta


def _parameters_of(start: SuperquadricFit, sets: Sets, form: Form) -> np.ndarray:
    """The parameter vectors of fits in the unit frames, shape [fit, parameter]; the inverse of
    `superquadric_body.unpack`, with what lies on a bound drawn in a little."""
    size = np.maximum(start.size_m / sets.scale[:, None], 1e-3)
    share = (start.exponents - LEAST_EXPONENT) / (GREATEST_EXPONENT - LEAST_EXPONENT)
    share = np.clip(share, 1e-3, 1 - 1e-3)
    theta = np.zeros((len(size), form.parameters))
    theta[:, 0:3] = np.log(size)
    theta[:, 3:5] = np.log(share / (1 - share))
    shift = (start.position_m - sets.origin) / sets.scale[:, None]
    theta[:, 8:11] = np.einsum("fji,fj->fi", matrix_of_quaternion(start.quaternion_xyzw), shift)
    if form.taper:
        theta[:, 11:13] = np.arctanh(np.clip(start.taper / TAPER_REACH, -0.95, 0.95))
    if form.bend:
        reach = np.linalg.norm(size, axis=1) / GREATEST_BEND
        bent = np.minimum(start.bend[:, 0] * sets.scale * reach, 0.95)
        v = (bent / np.sqrt(1 - bent**2))[:, None]
        theta[:, -2:] = v * np.stack([np.cos(start.bend[:, 1]), np.sin(start.bend[:, 1])], axis=1)
    return theta


def _lanes(sets: Sets, options: SuperquadricOptions) -> Lane:
    """The data of each fit before anything is known of its shape."""
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
    return Lane(
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
    rate = 1.0 / (options.mean_exponent - LEAST_EXPONENT)
    return float(np.sqrt(2.0 * rate * (GREATEST_EXPONENT - LEAST_EXPONENT)))


def _upright(deviation: np.ndarray, sets: Sets, options: SuperquadricOptions):
    if options.upright_std_rad is None or sets.plane is None:
        return None
    return np.stack([np.full(len(deviation), options.upright_std_rad), deviation], axis=1)


def _weight(variance: np.ndarray, sets: Sets, options: SuperquadricOptions) -> np.ndarray:
    """Weights of touches with these variances in the unit frame."""
    variance = variance + (options.sigma_floor_m / sets.scale[:, None]) ** 2
    return _unit(sets.mask / np.sqrt(np.maximum(variance, LEAST_STD**2)))


def _unit(weight: np.ndarray) -> np.ndarray:
    return weight / np.sqrt((weight**2).sum(axis=1, keepdims=True))


def begin_starts(sets: Sets, form: Form, options: SuperquadricOptions) -> tuple[Lane, np.ndarray]:
    """The starts of each fit: lanes, a row for every start of every fit, and parameters, shape
    [fit, start, parameter]."""
    down, floor = (None, None) if sets.plane is None else (sets.plane[:, :3], sets.plane[:, 3])
    trim = 0.0 if options.loss == "none" else 0.05
    rotation, half, centre = box_starts(sets.points, sets.mask, down, floor, trim)
    n, starts = rotation.shape[:2]
    theta = np.zeros((n, starts, form.parameters))
    if form.taper:
        taper = taper_starts(sets.points, sets.mask, rotation, half, centre)
        theta[..., 11:13] = np.arctanh(taper / TAPER_REACH)
        # The widest section gave the extents; the sizes belong to the middle one.
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
    """What starts are compared by: the cost, without the volume where that is a mere factor."""
    if form.residual != "volume_distance":
        return lambda theta, cost: cost

    # A body shrunk to nothing costs nothing, however far from the touches it lies.
    def without(theta: np.ndarray, cost: np.ndarray) -> np.ndarray:
        taper = np.clip(TAPER_REACH * np.tanh(theta[:, 11:13 if form.taper else 11]), -1.0, 1.0)
        return cost * np.exp(-theta[:, 0:3].sum(axis=1)) / np.prod(widening(taper), axis=1)

    return without


def _refresh(lanes: Lane, theta, sets: Sets, form: Form, options: SuperquadricOptions):
    """Lanes whose tangent, weights and loss scale belong to the shape at `theta`."""
    body, _, normal, raw = map_lanes(_look(form), theta, lanes)
    weight = lanes.weight
    if sets.covariance is not None:
        variance = np.einsum("fip,fpij,fjp->fp", normal, sets.covariance, normal)
        weight = _weight(variance, sets, options)
    size = np.where(sets.mask, np.abs(raw) * weight, np.nan)
    spare = np.maximum(sets.count - form.parameters, 1) / sets.count
    deviation = 1.4826 * row_medians(size) / np.sqrt(spare)
    least = 1e-4 / np.sqrt(sets.count)
    scale = lanes.loss_scale
    if form.loss != "none":
        scale = np.clip(ROBUST_TUNING[form.loss] * deviation, least, scale)
    deviation = np.clip(deviation, 0.1 * least, lanes.loss_scale)
    ridge = options.prior * deviation
    upright = _upright(deviation, sets, options)
    theta = theta.copy()
    theta[:, 5:8] = 0.0
    theta[:, 8:11] = np.einsum("fji,fj->fi", body.rotation, body.position)
    return lanes._replace(rotation=body.rotation, weight=weight, loss_scale=scale,
                          ridge=ridge, edge=_edge(options) * deviation,
                          upright=upright), theta


def _rows(end: Finished, lanes: Lane, sets: Sets, form: Form) -> dict[str, np.ndarray]:
    """The fits in metres and in the world, by the name of their field."""
    body, away, _, _ = map_lanes(_look(form), end.theta, lanes)
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


# What names the compiled programs: cached, so that each is one object.


@lru_cache(maxsize=64)
def _look(form: Form):
    return Program(f"look {form}", jax.vmap(lambda theta, lane: look(theta, lane, form)))


@lru_cache(maxsize=64)
def _problem(form: Form) -> Problem:
    # Jitted by itself only to be traced once, for the first evaluation and for every other.
    equations = jax.jit(lambda theta, lane: normal_equations(theta, lane, form))
    return Problem(equations, solver.descend, f"{form}")
