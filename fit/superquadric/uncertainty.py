"""Uncertainty of superquadric fits: covariance in tangent coordinates, of volume and of surface.

The information matrix sums the touches' distances to the surface, whitened by their standard
deviations, and the table as one touch at the lowest point. A wide prior over the range of each
parameter keeps the matrix regular, for example if a rotation is undetermined.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fit.arrays import is_valid, row_medians, row_products, row_sums
from fit.fit_status import is_fitted
from fit.option_checks import check_number, checked_array
from fit.prepare import with_covariance
from fit.superquadric.geometry import (
    Superquadric,
    SuperquadricLike,
    as_points,
    superquadric_areas_of,
    superquadric_heights,
    superquadric_points,
    superquadric_volume,
)
from fit.superquadric.record import SuperquadricFit
from fit.superquadric.slopes import radius_slopes

STEP = 5e-6
"""Difference step of exponents and taper."""
FLAT = 0.1
"""Minimum gradient of the scaled radius times the half diagonal, except at the centre."""
MIN_SIGMA_M = 1e-9
"""Minimum standard deviation of a touch [m]."""
_NORMAL_90 = 1.645
Shifts = Float[np.ndarray, "fit point error"]
"""By how much errors move touches along their normals [m]."""


@dataclass(frozen=True)
class SuperquadricUncertainty:
    """Uncertainty of fits, one per row."""

    covariance: Float[np.ndarray, "fit 15 15"]
    """Covariance of the coordinates `TANGENT`; zero for those not fitted."""
    volume_m3: Float[np.ndarray, " fit"]
    log_volume_std: Float[np.ndarray, " fit"]
    """Standard deviation of the logarithm of the volume."""
    log_volume_shift: Float[np.ndarray, " fit"]
    """By how much the logarithm of the true volume is expected to exceed that of the fit."""

    def volume_interval_m3(self) -> np.ndarray:
        """Lower and upper bound of the volume's 90 % interval [m^3], shape [fit, 2]."""
        spread = self.log_volume_shift[:, None] + (
            _NORMAL_90 * self.log_volume_std[:, None] * np.array([-1.0, 1.0]))
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
    shared_m: Shifts | Callable[[np.ndarray], Shifts] | None = None,
) -> SuperquadricUncertainty:
    """Uncertainty of `fit` to `points` [m] with the evidence it was fitted to.

    Without `covariance` [m^2] the noise is estimated from the residuals. With it, the variance of
    each touch is n.C n + sigma_floor^2, scaled up if the residuals are larger. `shared_m` are
    errors that touches share and that do not average out (calibration, skin): by how much one
    standard deviation of each moves each touch along the normal; or a function that says so of the
    unit normals (fit, point, 3).

    A `SuperquadricFit` whose status is no fit has no covariance and no volume (NaN). A touch that
    is no number, or whose covariance is none (NaN, a negative variance: the fit is
    then `bad_points`), counts as not made. Raises ValueError for an array of the wrong shape, for a
    `sigma_floor_m` below zero, a `table_sigma_m` that is not above it, and an array `shared_m` that
    is not finite where a touch is; where a function says so, that fit alone has no covariance.
    """
    check_number("sigma_floor_m", sigma_floor_m)
    check_number("table_sigma_m", table_sigma_m, above=True)
    body = _body(fit)
    points = checked_array("points", points, (len(body.size_m), None, 3))
    shape = points.shape[:2]
    mask = checked_array("mask", np.ones(shape) if mask is None else mask, shape, bool)
    kept = is_valid(points).all(axis=2) & mask
    if covariance is not None:
        covariance = checked_array("covariance", covariance, (*shape, 3, 3))
        kept = with_covariance(kept, covariance)
    points = np.where(kept[..., None], points, body.position_m[:, None] + body.size_m[:, None])
    fitted = np.ones((len(points), 15), bool)
    fitted[:, 11:13] = (body.taper != 0).any(axis=1, keepdims=True)
    fitted[:, 13:15] = (body.bend[:, :1] != 0)
    prior = _prior(body) * np.where(fitted, 1.0, 1e-9)

    away, slope, normal, slopes = _first_order(body, points)
    sigma = _sigma(away / slope, normal, kept, fitted.sum(axis=1), covariance, sigma_floor_m)
    slopes = slopes / slope[..., None] * prior[:, None]
    rows = slopes / sigma[..., None] * kept[..., None]
    information = row_products(rows, rows) + np.eye(15)
    if table_z is not None:
        row = _table_slope(body, prior) / table_sigma_m
        information += row[:, :, None] * row[:, None, :]
    # In units of the prior the matrix is at least the identity, hence regular.
    unit = np.linalg.inv(information)
    if shared_m is not None:
        # What least squares make of each of these errors.
        shifts = checked_array("shared_m", shared_m(normal) if callable(shared_m) else shared_m,
                               (*shape, None))
        if not callable(shared_m):
            _check_shared(shifts, kept)
        moved = np.where(kept[..., None], shifts / sigma[..., None], 0.0)
        shared = unit @ row_products(rows, moved)
        unit = unit + shared @ np.swapaxes(shared, 1, 2)
    cov = unit * prior[:, :, None] * prior[:, None, :]
    volume = superquadric_volume(body)
    if isinstance(fit, SuperquadricFit):
        none = ~is_fitted(fit.status)
        cov[none], volume[none] = np.nan, np.nan
    log_volume_std = _log_volume_std(body, cov)
    return SuperquadricUncertainty(cov, volume, log_volume_std,
                                   np.zeros(len(points)))


def _check_shared(shifts: np.ndarray, kept: np.ndarray) -> None:
    """Raises ValueError where a shared error moves a touch that is `kept` by no number."""
    bad = np.argwhere(kept & ~np.isfinite(shifts).all(axis=2))
    if len(bad):
        row, touch = bad[0]
        raise ValueError(f"shared_m: {shifts[row, touch].tolist()} at touch {touch} of fit {row}, "
                         "should be finite numbers")


def surface_std(
    fit: SuperquadricLike, uncertainty: SuperquadricUncertainty,
    points: Float[np.ndarray, "fit point 3"],
) -> Float[np.ndarray, "fit point"]:
    """Standard deviation [m] of the surface along its normal, at or near `points` [m]."""
    slopes = distance_slopes(_body(fit), points)
    variance = np.einsum("fpi,fpi->fp", slopes @ uncertainty.covariance, slopes)
    return np.sqrt(np.maximum(variance, 0.0))


def _body(fit: SuperquadricLike) -> Superquadric:
    """The bodies, with sizes of at least a micrometre, so that results are finite."""
    return Superquadric(np.maximum(fit.size_m, 1e-6), fit.exponents, fit.position_m,
                        fit.quaternion_xyzw, fit.taper, fit.bend)


def surface_distance(body: SuperquadricLike, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Signed distance [m] to first order, (beta - 1)/|grad beta|, and the unit normal.

    At the centre, where beta has no gradient, the distance is the smallest half extent. Raises
    ValueError for points of another shape than [fit, point, 3].
    """
    away, slope, normal, _ = _first_order(body, points)
    return away / slope, normal


def _first_order(body: SuperquadricLike, points) -> tuple[np.ndarray, ...]:
    """beta - 1 (the scaled radius), |grad beta| [1/m], the unit normal at points, and the slopes of
    beta by `TANGENT`."""
    radius, slopes = radius_slopes(body, as_points(body, points))
    gradient = -slopes[..., 8:11]
    slope = np.linalg.norm(gradient, axis=2)
    flat = slope < FLAT / np.linalg.norm(body.size_m, axis=1)[:, None]
    slope = np.where(flat, 1 / body.size_m.min(axis=1)[:, None], slope)
    return radius - 1, slope, gradient / slope[..., None], slopes


def _prior(body: SuperquadricLike) -> np.ndarray:
    """Prior standard deviations of the tangent coordinates, shape [fit, 15]."""
    n = len(body.size_m)
    length = np.maximum(np.linalg.norm(body.size_m, axis=1), 1e-6)
    one = np.ones(n)
    # Exponents, rotations and tapers: a uniform distribution over their range.
    return np.stack([one, one, one, 0.55 * one, 0.55 * one, 0.9 * one, 0.9 * one, 0.9 * one,
                     length, length, length, 0.58 * one, 0.58 * one, 0.5 / length, 0.5 / length],
                    axis=1)


def distance_slopes(body: SuperquadricLike, points) -> Float[np.ndarray, "fit point 15"]:
    """Derivatives of distances [m] by tangent coordinates, at points [m].

    Raises ValueError for points of another shape.
    """
    _, slope, _, slopes = _first_order(body, points)
    slopes /= slope[..., None]
    return slopes


def _sigma(distance, normal, kept, parameters, covariance, floor) -> np.ndarray:
    count = kept.sum(axis=1)
    spare = np.maximum(count - parameters, 1)
    away = np.where(kept, np.abs(distance), np.nan)
    if covariance is None:
        sigma = np.ones_like(distance)
    else:
        variance = np.einsum("fpi,fpij,fpj->fp", normal, np.nan_to_num(covariance), normal)
        sigma = np.sqrt(np.maximum(np.maximum(variance, 0.0) + floor**2, MIN_SIGMA_M**2))
    with np.errstate(invalid="ignore"):
        away = np.where(kept, np.minimum(away / sigma, 1e6), np.nan)
    typical = np.full(len(count), 1.0)
    some = count > 0
    # The root mean square, clipped at three standard deviations estimated from the median.
    middle = 1.4826 * row_medians(away[some])
    drawn = np.minimum(away[some], 3 * middle[:, None])
    typical[some] = np.sqrt(row_sums(drawn**2) / spare[some])
    least = 1e-7 if covariance is None else 1.0
    return sigma * np.maximum(typical, least)[:, None]


def _table_slope(body: SuperquadricLike, prior) -> np.ndarray:
    """Derivative of the body's lowest height, averaged over points near it."""
    height = superquadric_heights(body, 600)
    low, high = height.min(axis=1, keepdims=True), height.max(axis=1, keepdims=True)
    counts = height - low < 0.01 * (high - low)
    # Only the lowest points are computed further, summed in order, so that fits are independent.
    room = counts.sum(axis=1).max(initial=1)
    lowest = np.argsort(~counts, axis=1, kind="stable")[:, :room]
    weight = np.zeros(counts.shape)
    np.put_along_axis(weight, lowest, superquadric_areas_of(body, 600, lowest), axis=1)
    weight *= counts
    weight = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    weight = np.take_along_axis(weight, lowest, 1)
    slopes = distance_slopes(body, superquadric_points(body, 600, lowest))
    return prior * np.where(weight[..., None] != 0, weight[..., None] * slopes, 0.0).sum(axis=1)


def _log_volume_std(body: Superquadric, cov: np.ndarray) -> np.ndarray:
    slope = np.zeros((len(cov), 15))
    slope[:, :3] = 1.0  # of the logarithms of the sizes
    for first, name in ((3, "exponents"), (11, "taper")):
        value = getattr(body, name)
        for k in range(2):
            step = np.zeros_like(value)
            step[:, k] = STEP
            up, down = (np.log(superquadric_volume(body._replace(**{name: value + s * step})))
                        for s in (1, -1))
            slope[:, first + k] = (up - down) / (2 * STEP)
    return np.sqrt(np.einsum("fi,fij,fj->f", slope, cov, slope))
