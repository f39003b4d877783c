"""What a superquadric fit does not know: covariance in its tangent, volume, surface, symmetries.

The information is that of the touches' distances to the surface, whitened by their standard
deviations, plus the table as one more touch at the lowest point. A wide prior stands for the range
each parameter can have at all, so that a turn nobody can see has a large variance and not a
singular matrix. Derivatives are central differences of the geometry, along the tangent.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from jaxtyping import Float, Int

from fit.arrays import plausible, row_medians, row_sums
from fit.rotation import matrix_of_quaternion, quaternion_of_matrix
from fit.superquadric.geometry import (
    Superquadric,
    SuperquadricLike,
    superquadric_areas,
    superquadric_inside_outside,
    superquadric_volume,
)

TANGENT = (
    "log_a1", "log_a2", "log_a3", "eps1", "eps2",
    "turn_x_rad", "turn_y_rad", "turn_z_rad", "px_m", "py_m", "pz_m",
    "kx", "ky", "bend_x_per_m", "bend_y_per_m",
)  # fmt: skip
"""The tangent's coordinates; turns are about the body's own axes, the bend is a vector."""
STEP = 1e-5
"""Difference step in units of the prior's standard deviation."""
FLAT = 0.1
"""Slopes of beta, times half the body's diagonal, are steeper than this but at its very centre."""
LEAST_SIGMA_M = 1e-9
"""Standard deviation [m] of a touch that is said to have none."""


class Symmetry(IntFlag):
    """Turns that leave a fitted body as it is, within its uncertainty."""

    none = 0
    turns_about_z = 1
    """Round across (e2 ~ 1, a1 ~ a2, Kx ~ Ky), no bend: the turn about z is free."""
    quarter_turn = 2
    """a1 ~ a2, Kx ~ Ky, no bend: a quarter turn about z gives the same body."""
    interchange = 4
    """e1 ~ e2, no taper, no bend: any of the three axes may be called z."""


@dataclass(frozen=True)
class SuperquadricUncertainty:
    """Uncertainty of fits, a row each."""

    covariance: Float[np.ndarray, "fit 15 15"]
    """Of the tangent coordinates `TANGENT`; zero for those that were not fitted."""
    volume_m3: Float[np.ndarray, " fit"]
    log_volume_std: Float[np.ndarray, " fit"]
    """Standard deviation of the logarithm of the volume."""
    symmetry: Int[np.ndarray, " fit"]
    """`Symmetry` flags."""

    def volume_interval_m3(self, z: float = 1.645) -> np.ndarray:
        """Lower and upper bound of the volume [m^3], shape [fit, 2]; 90 % for z = 1.645."""
        spread = z * self.log_volume_std[:, None] * np.array([-1.0, 1.0])
        return self.volume_m3[:, None] * np.exp(spread)


def superquadric_uncertainty(
    fit: SuperquadricLike,
    points: Float[np.ndarray, "fit point 3"],
    mask: np.ndarray | None = None,
    *,
    covariance: Float[np.ndarray, "fit point 3 3"] | None = None,
    table_z: float | np.ndarray | None = None,
    sigma_floor_m: float = 1e-3,
    table_sigma_m: float = 5e-4,
    common_sigma_m: float = 0.0,
) -> SuperquadricUncertainty:
    """Uncertainty of `fit` to `points` [m] with the evidence it was fitted to.

    Without `covariance` [m^2] the noise is taken from the residuals (by their median, with the
    parameters counted); with it, each touch has n.C n + sigma_floor^2, enlarged where the residuals
    are larger than it promises. `common_sigma_m` is the standard deviation of an error along the
    normal that all touches share (skin, link radius, calibration): no number of touches averages
    it out, so it is carried to the parameters as a whole.
    """
    body = _body(fit)
    points = np.asarray(points, float)
    mask = np.ones(points.shape[:2], bool) if mask is None else mask
    kept = plausible(points).all(axis=2) & mask
    points = np.where(kept[..., None], points, body.position_m[:, None] + body.size_m[:, None])
    fitted = np.ones((len(points), 15), bool)
    fitted[:, 11:13] = (body.taper != 0).any(axis=1, keepdims=True)
    fitted[:, 13:15] = (body.bend[:, :1] != 0)
    prior = _prior(body) * np.where(fitted, 1.0, 1e-9)

    away, slope, normal = _first_order(body, points)
    sigma = _sigma(away / slope, normal, kept, fitted.sum(axis=1), covariance, sigma_floor_m)
    slopes = _slopes(body, points, prior, slope, normal)
    rows = slopes / sigma[..., None] * kept[..., None]
    information = np.einsum("fpi,fpj->fij", rows, rows) + np.eye(15)
    if table_z is not None:
        row = _table_slope(body, prior) / table_sigma_m
        information += row[:, :, None] * row[:, None, :]
    # In units of the prior the matrix is at least the identity: never singular.
    unit = np.linalg.inv(information)
    if common_sigma_m:
        shared = np.einsum("fij,fpj,fp->fi", unit, rows, kept / sigma) * common_sigma_m
        unit = unit + shared[:, :, None] * shared[:, None, :]
    cov = unit * prior[:, :, None] * prior[:, None, :]
    log_volume_std = _log_volume_std(body, cov, prior)
    return SuperquadricUncertainty(cov, superquadric_volume(body), log_volume_std,
                                   _symmetry(body, cov))


def surface_std(
    fit: SuperquadricLike, uncertainty: SuperquadricUncertainty,
    points: Float[np.ndarray, "fit point 3"],
) -> Float[np.ndarray, "fit point"]:
    """Standard deviation [m] along the normal of the surface at (or near) `points` [m]."""
    body = _body(fit)
    prior = _prior(body)
    slopes = distance_slopes(body, points, prior) / prior[:, None]
    return np.sqrt(np.einsum("fpi,fij,fpj->fp", slopes, uncertainty.covariance, slopes))


def _body(fit: SuperquadricLike) -> Superquadric:
    """The bodies alone; those of sets without extent are given a little, to be finite."""
    return Superquadric(np.maximum(fit.size_m, 1e-6), fit.exponents, fit.position_m,
                        fit.quaternion_xyzw, fit.taper, fit.bend)


def surface_distance(body: SuperquadricLike, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance [m] to first order, (beta - 1)/|grad beta|, and the unit normal there.

    The very centre, where beta has no gradient, is as deep as the least half extent.
    """
    away, slope, normal = _first_order(body, points)
    return away / slope, normal


def _first_order(body: SuperquadricLike, points) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """beta - 1, |grad beta| [1/m] and the unit normal at points."""
    step = 1e-6 * body.size_m.min(axis=1)[:, None]
    gradient = np.empty_like(points)
    for axis in range(3):
        offset = np.zeros((len(points), 1, 3))
        offset[:, :, axis] = step
        up, down = (superquadric_inside_outside(body, points + s * offset) for s in (1, -1))
        gradient[..., axis] = (up - down) / (2 * step)
    slope = np.linalg.norm(gradient, axis=2)
    flat = slope < FLAT / np.linalg.norm(body.size_m, axis=1)[:, None]
    slope = np.where(flat, 1 / body.size_m.min(axis=1)[:, None], slope)
    return superquadric_inside_outside(body, points) - 1, slope, gradient / slope[..., None]


def moved(body: SuperquadricLike, tangent: Float[np.ndarray, "fit 15"]) -> Superquadric:
    """The bodies a step along the tangent away."""
    t = tangent
    rotation = matrix_of_quaternion(body.quaternion_xyzw)
    half = np.concatenate([0.5 * t[:, 5:8], np.ones((len(t), 1))], axis=1)
    turn = matrix_of_quaternion(half / np.linalg.norm(half, axis=1, keepdims=True))
    bend = _bend_vector(body) + t[:, 13:15]
    return Superquadric(
        body.size_m * np.exp(t[:, 0:3]),
        body.exponents + t[:, 3:5],
        body.position_m + t[:, 8:11],
        quaternion_of_matrix(rotation @ turn),
        body.taper + t[:, 11:13],
        np.stack([np.hypot(*bend.T), np.arctan2(bend[:, 1], bend[:, 0])], axis=1),
    )


def _bend_vector(body: SuperquadricLike) -> np.ndarray:
    """The bends [1/m] along x and y, shape [fit, 2]."""
    curvature, direction = body.bend[:, :1], body.bend[:, 1]
    return curvature * np.stack([np.cos(direction), np.sin(direction)], axis=1)


def _prior(body: SuperquadricLike) -> np.ndarray:
    """Standard deviations of the tangent coordinates before any touch, shape [fit, 15]."""
    n = len(body.size_m)
    length = np.maximum(np.linalg.norm(body.size_m, axis=1), 1e-6)
    one = np.ones(n)
    # Exponents, turns and tapers: the spread of an even distribution over their whole range.
    return np.stack([one, one, one, 0.55 * one, 0.55 * one, 0.9 * one, 0.9 * one, 0.9 * one,
                     length, length, length, 0.58 * one, 0.58 * one, 0.5 / length, 0.5 / length],
                    axis=1)


def distance_slopes(body: SuperquadricLike, points, prior) -> Float[np.ndarray, "fit point 15"]:
    """Derivative of each point's distance [m] along the tangent, per prior standard deviation."""
    _, slope, normal = _first_order(body, points)
    return _slopes(body, points, prior, slope, normal)


def _slopes(body: SuperquadricLike, points, prior, slope, normal) -> np.ndarray:
    """`distance_slopes`, from what `_first_order` says of the points."""
    slopes = np.zeros((*points.shape[:2], 15))
    for k in (*range(8), *range(11, 15)):
        if not prior[:, k].any():
            continue
        step = np.zeros((len(points), 15))
        step[:, k] = STEP * prior[:, k]
        up, down = (superquadric_inside_outside(moved(body, s * step), points) for s in (1, -1))
        slopes[..., k] = (up - down) / (2 * STEP) / slope
    # A move of the whole body is exact: the surface moves by its component along the normal.
    slopes[..., 8:11] = -normal * prior[:, None, 8:11]
    return slopes


def _sigma(distance, normal, kept, parameters, covariance, floor) -> np.ndarray:
    count = kept.sum(axis=1)
    spare = np.maximum(count - parameters, 1)
    away = np.where(kept, np.abs(distance), np.nan)
    if covariance is None:
        sigma = np.ones_like(distance)
    else:
        variance = np.einsum("fpi,fpij,fpj->fp", normal, np.nan_to_num(covariance), normal)
        sigma = np.sqrt(np.maximum(np.maximum(variance, 0.0) + floor**2, LEAST_SIGMA_M**2))
    with np.errstate(invalid="ignore"):
        away = np.where(kept, np.minimum(away / sigma, 1e6), np.nan)
    typical = np.full(len(count), 1.0)
    some = count > 0
    # The root mean square, with what lies beyond three deviations by the median drawn in.
    middle = 1.4826 * row_medians(away[some])
    drawn = np.minimum(away[some], 3 * middle[:, None])
    typical[some] = np.sqrt(row_sums(drawn**2) / spare[some])
    least = 1e-7 if covariance is None else 1.0
    return sigma * np.maximum(typical, least)[:, None]


def _table_slope(body: SuperquadricLike, prior) -> np.ndarray:
    """Slope of the body's lowest height, the mean of all points that are nearly lowest."""
    points, area = superquadric_areas(body, 1500)
    height = points[..., 2]
    low, high = height.min(axis=1, keepdims=True), height.max(axis=1, keepdims=True)
    weight = area * (height - low < 0.01 * (high - low))
    weight = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    # Most are not: slopes of the lowest alone, summed one by one, so that no fit hangs on others.
    room = (weight != 0).sum(axis=1).max(initial=1)
    lowest = np.argsort(weight == 0, axis=1, kind="stable")[:, :room]
    weight = np.take_along_axis(weight, lowest, 1)
    slopes = distance_slopes(body, np.take_along_axis(points, lowest[..., None], 1), prior)
    return np.where(weight[..., None] != 0, weight[..., None] * slopes, 0.0).sum(axis=1)


def _log_volume_std(body: SuperquadricLike, cov, prior) -> np.ndarray:
    slope = np.zeros((len(prior), 15))
    for k in (0, 1, 2, 3, 4, 11, 12):
        step = np.zeros_like(slope)
        step[:, k] = STEP * prior[:, k]
        up, down = (np.log(superquadric_volume(moved(body, s * step))) for s in (1, -1))
        slope[:, k] = (up - down) / (2 * step[:, k])
    return np.sqrt(np.einsum("fi,fij,fj->f", slope, cov, slope))


def _symmetry(body: SuperquadricLike, cov) -> np.ndarray:
    """Flags by whether a difference that breaks a symmetry is within two standard deviations."""

    def within(value, weights, least):
        w = np.asarray(weights, float)
        std = np.sqrt(np.einsum("i,fij,j->f", w, cov, w))
        return np.abs(value) < np.maximum(2 * std, least)

    unit = np.eye(15)
    square = within(np.log(body.size_m[:, 0] / body.size_m[:, 1]), unit[0] - unit[1], 0.02)
    round_ = within(body.exponents[:, 1] - 1, unit[4], 0.05)
    alike = within(body.exponents[:, 0] - body.exponents[:, 1], unit[3] - unit[4], 0.03)
    plain = (body.taper == 0).all(axis=1) & (body.bend[:, 0] == 0)
    even = plain | within(body.taper[:, 0] - body.taper[:, 1], unit[11] - unit[12], 0.02)
    # A turn about z would turn the bend.
    along_x, along_y = _bend_vector(body).T
    least = 0.02 / np.linalg.norm(body.size_m, axis=1)
    even &= within(along_x, unit[13], least) & within(along_y, unit[14], least)
    return (Symmetry.turns_about_z * (square & round_ & even)
            + Symmetry.quarter_turn * (square & even) + Symmetry.interchange * (alike & plain))
