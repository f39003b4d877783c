"""Superquadrics from touches, in batch: points in, a frozen record of fits out.

    points -> sorted, centred, scaled -> starts -> screened -> the best finished -> result

A fit depends on nothing but its own points and evidence: not on their order, the padding, or the
fits beside it. Each set goes through the program compiled for its own number of points.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Literal

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from fit.batch import map_lanes, take
from fit.descent import Finished, advance, finish, screen
from fit.prepare import Sets, prepare
from fit.rotation import quaternion_of_matrix
from fit.superquadric_model import (
    TAPER_REACH,
    Form,
    Lane,
    distance,
    log_radius_gradient,
    point_residual,
    residuals,
    unpack,
)
from fit.superquadric_starts import box_starts, taper_starts

START_EXPONENT_LOGIT = 0.0
ROBUST_TUNING = {"none": 1.0, "pseudo_huber": 1.345, "cauchy": 2.385, "geman_mcclure": 3.0}
"""Standard deviations at which each loss bends: 95 % efficiency on clean Gaussian residuals."""


@dataclass(frozen=True)
class SuperquadricOptions:
    """How to fit; hashable, for it names the compiled program."""

    taper: bool = False
    """Linear taper Kx, Ky: 13 parameters."""
    bend: bool = False
    """Circular bend: two parameters more."""
    residual: Literal["solina", "radial", "distance", "volume_distance"] | None = None
    """See `superquadric_model.point_residual`; None: solina, or volume_distance with a taper."""
    loss: Literal["none", "pseudo_huber", "cauchy", "geman_mcclure"] = "none"
    """Robust loss of the points' (and normals') residuals, its scale from their median."""
    screen_iterations: int = 5
    round_iterations: int = 6
    """Iterations between two looks at which fits are done."""
    iterations: int = 80
    """Most iterations of the finish."""
    sigma_floor_m: float = 1e-3
    """Standard deviation added to a contact's covariance along the normal [m]."""
    plane_weight: float = 1.0
    """Weight of the support plane, as so many times all the points together."""
    free_weight: float = 1.0
    """Weight of all the free balls together, against all the points."""
    normal_weight: float = 0.3
    """Weight of a normal's tangent-plane residual against its point's."""
    upright_std_rad: float | None = None
    """Standard deviation of the tilt of a body known to stand upright, on whichever of its three
    axes [rad], against the noise that the residuals show; None: it may lie as it likes."""
    prior: float = 0.1
    """Inverse standard deviation of the prior on the exponents' logits, the taper's arctanh and
    the bend, against the noise that the residuals show; 0 switches it off."""


@dataclass(frozen=True)
class SuperquadricFit:
    """Fits, a row each; every field is finite whatever the status."""

    size_m: Float[np.ndarray, "fit 3"]
    """Half extents a1, a2, a3 [m]."""
    exponents: Float[np.ndarray, "fit 2"]
    """e1 along z, e2 across; a z-axis cylinder has e1 ~ 0.1, e2 ~ 1."""
    position_m: Float[np.ndarray, "fit 3"]
    """Centre [m], in the frame of the points."""
    quaternion_xyzw: Float[np.ndarray, "fit 4"]
    """Orientation, body to world."""
    taper: Float[np.ndarray, "fit 2"]
    """Kx, Ky in [-1, 1]."""
    bend: Float[np.ndarray, "fit 2"]
    """Curvature [1/m] and direction [rad]."""
    rms_m: Float[np.ndarray, " fit"]
    """Root mean square distance of the points to the surface, to first order [m]."""
    cost: Float[np.ndarray, " fit"]
    """Half the sum of squared residuals in the unit frame, evidence included."""
    iterations: Int[np.ndarray, " fit"]
    """Iterations of the finish."""
    status: Int[np.ndarray, " fit"]
    """`FitStatus` of each fit."""
    n_points: Int[np.ndarray, " fit"]
    """Points that took part."""

    def __len__(self) -> int:
        return len(self.status)

    def __getitem__(self, index) -> SuperquadricFit:
        """The fits `index` (a slice, a mask, an array, or a number) as a smaller record."""
        rows = np.atleast_1d(np.arange(len(self))[index])
        return SuperquadricFit(**{f.name: getattr(self, f.name)[rows] for f in fields(self)})


def fit_superquadric(
    points: Float[np.ndarray, "fit point 3"],
    mask: Bool[np.ndarray, "fit point"] | None = None,
    *,
    covariance: Float[np.ndarray, "fit point 3 3"] | None = None,
    normals: Float[np.ndarray, "fit point 3"] | None = None,
    table_z: float | Float[np.ndarray, " fit"] | None = None,
    free_points: Float[np.ndarray, "fit free 3"] | None = None,
    free_radius: float | Float[np.ndarray, "fit free"] | None = None,
    free_mask: Bool[np.ndarray, "fit free"] | None = None,
    options: SuperquadricOptions | None = None,
) -> SuperquadricFit:
    """Superquadrics of sets of points, all sets at once.

    Args:
        points: touches [m], shape [fit, point, 3].
        mask: which of them count, shape [fit, point]; all where None.
        covariance: of each touch [m^2]; its residual is divided by the standard deviation along
            the model's normal there, sqrt(n.C n + sigma_floor^2).
        normals: outward normals felt at the touches (NaN where not), through the dual superquadric.
        table_z: height of the table the body stands on [m], one or one a fit; None: no table.
        free_points, free_radius, free_mask: balls [m] known to lie outside the body.
        options: see `SuperquadricOptions`.

    Returns:
        `SuperquadricFit`, whose `status` says what became of each set; no set raises.

    Raises:
        ValueError: an array of the wrong shape.
    """
    options = options or SuperquadricOptions()
    sets = prepare(points, mask, covariance, normals, table_z, free_points, free_radius, free_mask)
    rows = _placeholder(sets)
    for index, bucket in sets.buckets():
        for name, values in _fit_bucket(bucket, options).items():
            rows[name][index] = values
    return SuperquadricFit(**rows)


def _placeholder(sets: Sets) -> dict[str, np.ndarray]:
    """Rows of sets that cannot be fitted: the box of their finite points."""
    n = len(sets.count)
    return {
        "size_m": np.maximum(0.5 * (sets.high - sets.low), 0.0),
        "exponents": np.ones((n, 2)),
        "position_m": 0.5 * (sets.high + sets.low),
        "quaternion_xyzw": np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)),
        "taper": np.zeros((n, 2)),
        "bend": np.zeros((n, 2)),
        "rms_m": np.zeros(n),
        "cost": np.zeros(n),
        "iterations": np.zeros(n, int),
        "status": sets.status.copy(),
        "n_points": sets.count.copy(),
    }


def _fit_bucket(sets: Sets, options: SuperquadricOptions) -> dict[str, np.ndarray]:
    """Rows of usable sets that share one padded number of points."""
    residual = options.residual or ("volume_distance" if options.taper else "solina")
    form = Form(options.taper, options.bend, residual, options.loss)
    lanes = _lanes(sets, options)
    lanes, theta = _screen(lanes, sets, form, options)
    lanes, theta = _refresh(lanes, theta, sets, form, options)
    if form.loss != "none" or sets.covariance is not None:
        # Weights and scale belong to a shape: settle both before the finish.
        theta = advance(_residual(form), theta, lanes, options.round_iterations).theta
        lanes, theta = _refresh(lanes, theta, sets, form, options)
    end = finish(_residual(form), theta, lanes, at_a_time=options.round_iterations,
                 at_most=options.iterations)
    return _rows(end, lanes, sets, form)


def _lanes(sets: Sets, options: SuperquadricOptions) -> Lane:
    """The data of each fit before anything is known of its shape."""
    n = len(sets.count)
    weight = sets.mask.astype(float)
    if sets.covariance is not None:
        variance = np.trace(sets.covariance, axis1=2, axis2=3) / 3
        weight = weight / np.sqrt(variance + (options.sigma_floor_m / sets.scale[:, None]) ** 2)
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
        normal_weight = options.normal_weight * felt * _unit(weight)
    return Lane(
        points=np.moveaxis(sets.points, 2, 1).copy(),
        weight=_unit(weight),
        rotation=np.tile(np.eye(3), (n, 1, 1)),
        loss_scale=0.1 / np.sqrt(sets.count),
        ridge=np.full(n, 1e-3 * options.prior),
        upright=None if options.upright_std_rad is None else 0.1 / np.sqrt(sets.count),
        plane=plane,
        normals=normals,
        normal_weight=normal_weight,
        free=free,
    )


def _unit(weight: np.ndarray) -> np.ndarray:
    return weight / np.sqrt((weight**2).sum(axis=1, keepdims=True))


def _screen(lanes: Lane, sets: Sets, form: Form, options: SuperquadricOptions):
    """The best start of each fit after a few iterations."""
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
    theta[..., 3:5] = START_EXPONENT_LOGIT
    theta[..., 8:11] = centre
    spread = take(lanes, np.repeat(np.arange(n), starts))
    spread = spread._replace(rotation=rotation.reshape(-1, 3, 3))
    badness = _badness(form)
    best, found = screen(_residual(form), theta, spread, options.screen_iterations, badness)
    return lanes._replace(rotation=rotation[np.arange(n), best]), found


def _badness(form: Form):
    """What starts are compared by: the cost, without the volume where that is a mere factor."""
    if form.residual != "volume_distance":
        return lambda theta, cost: cost
    # A body shrunk to nothing costs nothing, however far from the touches it lies.
    return lambda theta, cost: cost * np.exp(-theta[:, 0:3].sum(axis=1))


def _refresh(lanes: Lane, theta, sets: Sets, form: Form, options: SuperquadricOptions):
    """Lanes whose tangent, weights and loss scale belong to the shape at `theta`."""
    body, _, normal, raw = map_lanes(_look(form), theta, lanes)
    weight = lanes.weight
    if sets.covariance is not None:
        variance = np.einsum("fip,fpij,fjp->fp", normal, sets.covariance, normal)
        variance = variance + (options.sigma_floor_m / sets.scale[:, None]) ** 2
        weight = _unit(sets.mask / np.sqrt(variance))
    size = np.where(sets.mask, np.abs(raw) * weight, np.nan)
    spare = np.maximum(sets.count - form.parameters, 1) / sets.count
    deviation = 1.4826 * np.nanmedian(size, axis=1) / np.sqrt(spare)
    least = 1e-4 / np.sqrt(sets.count)
    scale = lanes.loss_scale
    if form.loss != "none":
        scale = np.clip(ROBUST_TUNING[form.loss] * deviation, least, scale)
    deviation = np.clip(deviation, 0.1 * least, lanes.loss_scale)
    ridge = options.prior * deviation
    upright = lanes.upright
    if options.upright_std_rad is not None:
        upright = deviation / options.upright_std_rad
    theta = theta.copy()
    theta[:, 5:8] = 0.0
    return lanes._replace(rotation=body.rotation, weight=weight, loss_scale=scale,
                          ridge=ridge, upright=upright), theta


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


# The lane functions: cached, since each names one compiled program.


@lru_cache(maxsize=64)
def _look(form: Form):
    """The body; each point's distance, the normal there, and its unweighted residual."""

    def look(theta, lane):
        body = unpack(theta, lane.rotation, form)
        gradient = log_radius_gradient(body, lane.points)
        length = jnp.sqrt(jnp.sum(gradient**2, axis=0) + 1e-24)
        raw = point_residual(body, lane.points, form)
        return body, distance(body, lane.points), gradient / length, raw

    return look


@lru_cache(maxsize=64)
def _residual(form: Form):
    return lambda theta, lane: residuals(theta, lane, form)
