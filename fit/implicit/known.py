"""Free-form bodies with known hyperparameters: one Cholesky factor a body.

For contacts that are still to move, and for many touches with normals: the descent of
`fit_implicit` to the hyperparameters factors its matrices a hundred times. Rows are those of
`fit_implicit`: touches, points off the surface along their normals, and the balls of free space
that the body would enter.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import cho_factor, cho_solve, cholesky, eigh, solve_triangular
from scipy.spatial.distance import cdist

from fit.arrays import is_valid
from fit.fit_status import FitStatus
from fit.implicit.record import ImplicitFit, Mean
from fit.option_checks import check_number, checked_array

SQRT3 = 3.0**0.5  # not that of `process`, which brings JAX's solvers
LEAST_SCALE = 1e-9
"""Of all variances, where touches lie on the mean exactly."""
FEWEST = 4
"""Touches; with fewer there is no body."""
NO_TABLE_M = -1e12
NO_ROWS = np.zeros((0, 3)), np.zeros(0), np.zeros(0), 1.0
"""Of a process that there is none of, as `_fitted` gives them."""


@dataclass(frozen=True)
class KnownProcess:
    """What a process is known to be.

    Raises ValueError for a number that is not positive.
    """

    length_m: float = 0.06
    """Length scale of the kernel [m]."""
    amplitude_m: float = 0.03
    """Standard deviation of the distance before any touch [m]."""
    mean_m: float = 0.02
    """The mean, everywhere [m]: where nothing was felt there is no body."""
    offset_m: float = 0.008
    """How far outwards along normals the distance is given too [m]."""
    slope: float = 0.25
    """Standard deviation of that distance as a share of the offset."""
    free_sigma_m: float = 0.0015
    """Standard deviation of the surface of a ball of free space [m]."""
    free_rows: int = 40
    """Balls at most that become rows at a time."""
    free_rounds: int = 2
    """Times that violated balls are looked for."""

    def __post_init__(self) -> None:
        for name in ("length_m", "amplitude_m", "mean_m", "offset_m", "slope", "free_sigma_m"):
            if not 0.0 < getattr(self, name) < 1e3:
                raise ValueError(f"{name}: {getattr(self, name)}, should be positive")

    def mean(self, points_m: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """The mean of the fits, as `implicit_values` takes it."""
        return np.full(points_m.shape[:2], self.mean_m)


def fit_known(
    points: Float[np.ndarray, "fit point 3"], mask: Bool[np.ndarray, "fit point"],
    normals: Float[np.ndarray, "fit point 3"], sigma_m: Float[np.ndarray, "fit point"],
    process: KnownProcess, *, free_points: Float[np.ndarray, "fit free 3"] | None = None,
    free_radius: float = 0.0, free_mask: Bool[np.ndarray, "fit free"] | None = None,
    table_z: float | None = None, mean: Mean | None = None,
) -> ImplicitFit:
    """Fit free-form bodies to touches [m] with outward normals and deviations `sigma_m`.

    All variances of a body, those of `process` and `sigma_m`, are multiplied by the number that
    makes its touches likeliest, their mean square in units of these variances (Santner, Williams
    and Notz 2003, section 3.3). The body stays the same; how sure it is depends on how well it
    agrees with what was expected.

    Returns `ImplicitFit`, whose mean is `mean`, or `process.mean` where none is given; a set of
    fewer than four touches has the status `too_few_points` and no body, one with a touch whose
    place, deviation or mean is no number `bad_points`. Balls of free space and normals that are
    none do not count; of the balls those of `free_mask` do, or all. Raises ValueError for arrays
    whose shapes disagree, and for a radius that is none.
    """
    if normals.shape != points.shape or not mask.shape == sigma_m.shape == points.shape[:2]:
        raise ValueError(f"shapes disagree: points {points.shape}, mask {mask.shape}, normals "
                         f"{normals.shape}, sigma_m {sigma_m.shape}")
    check_number("free_radius", free_radius)
    if free_points is not None:
        free_points = checked_array("free_points", free_points, (len(points), None, 3))
        free_mask = checked_array(
            "free_mask", np.ones(free_points.shape[:2]) if free_mask is None else free_mask,
            free_points.shape[:2], bool)
    kept = mask & _are_touches(points, sigma_m)
    bad = np.asarray((mask & ~kept).any(axis=1))
    found = []
    for world, own in enumerate(kept):
        free = np.zeros((0, 3))
        if free_points is not None and free_mask is not None:
            free = free_points[world][free_mask[world] & is_valid(free_points[world]).all(1)]
        rows = None if bad[world] else _fitted(
            points[world][own], normals[world][own], sigma_m[world][own], free, free_radius,
            process, of_fit(mean or process.mean, world))
        bad[world] = rows is None
        found.append(rows or NO_ROWS)
    return _record(found, points, kept, bad, process, table_z)


def _are_touches(points: np.ndarray, sigma_m: np.ndarray) -> np.ndarray:
    """Which touches have a place and a deviation that are numbers."""
    return is_valid(points).all(axis=-1) & is_valid(sigma_m)


def of_fit(mean: Mean, number: int) -> Callable[[np.ndarray], np.ndarray]:
    """The mean of the fit of a number, at its points (point, 3) [m]."""
    own = np.array([number])
    return lambda points_m: mean(points_m[None], own)[0]


def known_rows(
    points: Float[np.ndarray, "point 3"], normals: Float[np.ndarray, "point 3"],
    sigma_m: Float[np.ndarray, " point"], process: KnownProcess
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Places [m] (row, 3), distances [m] and variances [m^2] (row,) of touches and of points off
    the surface along known normals, and which touch each of them comes from, int (row,)."""
    known = np.flatnonzero(is_valid(normals).all(1))
    touch = np.concatenate([np.arange(len(points)), known])
    away = np.where(np.arange(len(touch)) < len(points), 0.0, process.offset_m)
    at = points[touch] + away[:, None] * np.nan_to_num(normals[touch])
    return at, away, sigma_m[touch] ** 2 + (process.slope * away) ** 2, touch


def shared_error_means(
    points: Float[np.ndarray, "fit point 3"], mask: Bool[np.ndarray, "fit point"],
    normals: Float[np.ndarray, "fit point 3"], sigma_m: Float[np.ndarray, "fit point"],
    shared_m: Float[np.ndarray, "fit point error"], process: KnownProcess,
) -> Float[np.ndarray, "fit error"]:
    """What touches tell of errors that they share, in standard deviations of each.

    `shared_m` is by how much one standard deviation of each error moves a touch [m] along its
    normal. A touch then says f = -(its share of every error), to first order: beside the kernel of
    the process stands one of rank `error` (a linear model with a Gaussian process as remainder,
    Rasmussen and Williams 2006, section 2.7), and the posterior mean of the errors follows. Sets of
    fewer than four touches, or with one of which a number is none, tell nothing: zeros.
    """
    found = np.zeros((len(points), shared_m.shape[2]))
    sound = (_are_touches(points, sigma_m) & is_valid(shared_m).all(axis=2)) | ~mask
    for world, own in enumerate(mask):
        if own.sum() >= FEWEST and sound[world].all():
            at, away, noise, touch = known_rows(
                points[world][own], normals[world][own], sigma_m[world][own], process)
            share = shared_m[world][own][touch]
            covariance = known_kernel(process, at, at) + np.diag(noise) + share @ share.T
            told = share.T @ cho_solve(cho_factor(covariance, lower=True), away - process.mean_m)
            found[world] = np.round(told, 9)  # products round by where arrays lie in memory
    return found


def log_evidence(
    points: Float[np.ndarray, "point 3"], normals: Float[np.ndarray, "point 3"],
    sigma_m: Float[np.ndarray, " point"], process: KnownProcess,
    means: Sequence[Callable[[np.ndarray], np.ndarray]], amplitudes_m: Sequence[float],
) -> Float[np.ndarray, "mean amplitude"]:
    """Logarithm of the likelihood of touches [m] of one body, with outward normals (NaN where not
    known) and deviations `sigma_m`, about each of the `means` (signed distances [m] at points
    (point, 3) [m]) for each amplitude in place of that of `process`.

    It weighs how near a mean comes to the touches against how much it leaves to explain, the
    amplitude (Rasmussen and Williams 2006, equation 2.30). All means share places, kernel and
    noise: one eigendecomposition serves every mean and every amplitude.
    """
    at, away, noise, _ = known_rows(points, normals, sigma_m, process)
    deviation = np.sqrt(noise)
    ratio, turn = eigh(known_kernel(process, at, at) / deviation[:, None] / deviation
                       / process.amplitude_m**2)
    rest = np.array([(away - mean(at)) / deviation for mean in means]).reshape(-1, len(at)) @ turn
    spread = 1.0 + np.square(amplitudes_m)[:, None] * np.maximum(ratio, 0.0)
    return -0.5 * ((np.square(rest)[:, None] / spread + np.log(spread)).sum(2)
                   + np.log(2.0 * np.pi * noise).sum())


def known_slopes(
    fits: ImplicitFit, row: int, process: KnownProcess, queries_m: Float[np.ndarray, "query 3"]
) -> tuple[Float[np.ndarray, " query"], Float[np.ndarray, "query 3"]]:
    """Signed distances [m] of one of `fit_known`'s bodies, whose mean is that of `process`, at
    queries [m], and their gradients, the table aside.

    As `implicit_slopes`, in double precision, without JAX: for one body at a time.
    """
    used = fits.noise_m2[row] >= 0.0
    at, alpha = fits.points_m[row][used], fits.alpha_per_m[row][used]
    scaled = (SQRT3 / process.length_m) * cdist(queries_m, at)
    weight = fits.amplitude_m[row]**2 * np.exp(-scaled) * alpha
    value = process.mean_m + ((1.0 + scaled) * weight).sum(1)
    towards = weight @ at - weight.sum(1)[:, None] * queries_m
    return value, (SQRT3 / process.length_m) ** 2 * towards


def known_deviations(
    fits: ImplicitFit, row: int, process: KnownProcess, queries_m: Float[np.ndarray, "query 3"]
) -> Float[np.ndarray, " query"]:
    """Posterior standard deviations [m] of the distance of one of `fit_known`'s bodies, (query,),
    that was fitted with `process`.

    Variances are those before any touch less what the rows tell (Rasmussen and Williams 2006,
    equation 2.26), all scaled as the fit's are.
    """
    used = fits.noise_m2[row] >= 0.0
    at, share = fits.points_m[row][used], (fits.amplitude_m[row] / process.amplitude_m) ** 2
    if len(at) == 0:
        return np.full(len(queries_m), fits.amplitude_m[row])
    known = share * known_kernel(process, at, at) + np.diag(fits.noise_m2[row][used])
    told = solve_triangular(cholesky(known, lower=True),
                            share * known_kernel(process, at, queries_m), lower=True)
    return np.sqrt(np.maximum(fits.amplitude_m[row] ** 2 - (told**2).sum(0), 0.0))


def known_kernel(process: KnownProcess, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Covariance of distances at places `a` (row, 3) and `b` (column, 3) [m^2]."""
    scaled = (SQRT3 / process.length_m) * cdist(a, b)
    return process.amplitude_m**2 * (1.0 + scaled) * np.exp(-scaled)


def _fitted(points: np.ndarray, normals: np.ndarray, sigma: np.ndarray, free: np.ndarray,
            radius: float, process: KnownProcess, mean: Callable[[np.ndarray], np.ndarray]
            ) -> tuple[np.ndarray, np.ndarray, np.ndarray, float] | None:
    """Rows of one process, their coefficients [1/m] and variances [m^2], and the number that all
    variances were multiplied by. None where the mean is no number at a touch."""
    if len(points) < FEWEST:
        return NO_ROWS
    at, away, noise, _ = known_rows(points, normals, sigma, process)
    value, clear = away - mean(at), radius - mean(free)
    told, sound = is_valid(value), is_valid(clear)
    if not told[:len(points)].all():
        return None
    if not told.all():  # rows keep their places in memory otherwise: products round by them
        at, value, noise = at[told], value[told], noise[told]
    if not sound.all():
        free, clear = free[sound], clear[sound]
    alpha = _coefficients(process, at, value, noise)
    for _ in range(process.free_rounds if len(free) else 0):
        depth = clear - known_kernel(process, free, at) @ alpha
        deep = np.argsort(-depth, kind="stable")[:process.free_rows]
        deep = deep[depth[deep] > process.free_sigma_m]
        if len(deep) == 0:
            break
        at = np.concatenate([at, free[deep]])
        value = np.concatenate([value, clear[deep]])
        noise = np.concatenate([noise, np.full(len(deep), process.free_sigma_m**2)])
        free, clear = np.delete(free, deep, axis=0), np.delete(clear, deep)
        alpha = _coefficients(process, at, value, noise)
    scale = max(float((value * alpha).sum() / len(value)), LEAST_SCALE)
    return at, alpha / scale, noise * scale, scale


def _coefficients(process: KnownProcess, at: np.ndarray, value: np.ndarray, noise: np.ndarray
                  ) -> np.ndarray:
    return cho_solve(cho_factor(known_kernel(process, at, at) + np.diag(noise), lower=True), value)


def _record(found: list, points: np.ndarray, mask: np.ndarray, bad: np.ndarray,
            process: KnownProcess, table_z: float | None) -> ImplicitFit:
    n, width = len(found), max([len(alpha) for _, alpha, _, _ in found], default=0)
    width = max(width, 1)
    at, alpha, noise = np.zeros((n, width, 3)), np.zeros((n, width)), np.full((n, width), -1.0)
    rms, amplitude = np.zeros(n), np.zeros(n)
    for k, (place, own, variance, scale) in enumerate(found):
        amplitude[k] = process.amplitude_m * np.sqrt(scale)
        rows = len(own)
        at[k, :rows], alpha[k, :rows], noise[k, :rows] = place, own, variance
        # At a touch the process differs from its target by the noise times alpha.
        miss = (variance * own)[: mask[k].sum()]
        rms[k] = np.sqrt((miss**2).mean()) if len(miss) else 0.0
    count = mask.sum(1)
    low = np.where(mask[..., None], points, np.inf).min(1, initial=np.inf)
    high = np.where(mask[..., None], points, -np.inf).max(1, initial=-np.inf)
    any_ = count[:, None] > 0
    low, high = np.where(any_, low, 0.0), np.where(any_, high, 0.0)
    status = np.where(count >= FEWEST, FitStatus.converged, FitStatus.too_few_points)
    return ImplicitFit(
        points_m=at, alpha_per_m=alpha, noise_m2=noise, weight=mask.astype(float),
        length_m=np.full(n, process.length_m), amplitude_m=amplitude,
        noise_sigma_m=np.zeros(n), centre_m=(low + high) / 2, radius_m=np.full(n, 0.03),
        low_m=low, high_m=high, table_z_m=np.full(n, NO_TABLE_M if table_z is None else table_z),
        cost=np.zeros(n), rms_m=rms, iterations=np.zeros(n, int),
        status=np.where(bad, FitStatus.bad_points, status),
        n_points=count)
