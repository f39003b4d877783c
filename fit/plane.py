"""Planes from touches, in batch: robust total least squares, with extents and covariance.

Orthogonal regression has a closed form, the eigenvector of the scatter with the least eigenvalue.
Outliers are found by a search over triples of points (least trimmed squares, Rousseeuw 1984). Of
many touches they are then weighted by Tukey's biweight. Few tell no scale to weigh by: there the
nearest half of them grows as long as the next touch passes a deletion test (Hadi and Simonoff 1993,
Procedures for the identification of multiple outliers in linear models), and all that passed count
alike. Without outliers that is least squares.
"""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.special import stdtrit

from fit.fit_status import FitStatus
from fit.option_checks import checked_array
from fit.plane_record import PlaneFit
from fit.prepare import Sets, prepare
from fit.rotation import is_upward

TRIPLES = 96
"""Candidate planes per set: with 40 % outliers, all fail with probability 2e-11."""
SLIVER = 0.1
"""A triangle is a sliver if its relative width is below this fraction of the widest."""
NARROW = 0.05
"""Touches near a plane lie along a line if narrower than this fraction of the widest."""
TUKEY = 4.685
"""Standard deviations at which the weight is zero: 95 % efficiency on Gaussian residuals."""
ROUNDS = 25
SETTLED = 1e-8
"""Largest change of the weights in a round at convergence."""
MANY = 16
"""Touches from which on their median distance tells a scale to weigh them by."""
LEVEL = 0.01
"""Probability that a test of the next of few touches rejects it although it is no outlier."""
NO_NOISE = 1e-7
"""Standard deviations of touches below this, in the unit frame, are rounding of eigenvalues."""
NORMAL_90 = 1.645


def fit_plane(
    points: Float[np.ndarray, "fit point 3"],
    mask: Bool[np.ndarray, "fit point"] | None = None,
    *,
    robust: bool = True,
) -> PlaneFit:
    """Fit a plane to each set of at least three points [m]; without `robust`, all weights are 1.

    Of touches at the same place one counts: three copies would be an exact plane. Raises ValueError
    for an array of the wrong shape; any other problem of a set is its status.
    """
    once, first = _once(points, mask)
    sets = prepare(points, once, least_points=3, solid=False)
    n, width = np.shape(points)[:2]
    rows: dict[str, np.ndarray] = {
        "normal": np.tile([0.0, 0.0, 1.0], (n, 1)),
        "offset_m": 0.5 * (sets.high + sets.low)[:, 2],
        "centre_m": 0.5 * (sets.high + sets.low),
        "axes": np.tile([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], (n, 1, 1)),
        "extent_m": np.zeros((n, 2)),
        "rms_m": np.zeros(n),
        "covariance": np.zeros((n, 3, 3)),
        "weight": np.zeros((n, width)),
        "status": sets.status.copy(),
        "n_points": sets.count.copy(),
    }
    for index, bucket in sets.buckets():
        weight = _weights(bucket, robust)
        for name, values in _describe(bucket, weight).items():
            rows[name][index] = values
        kept = min(width, weight.shape[1])
        slots = sets.order[index][:, :kept]
        rows["weight"][index[:, None], slots] = weight[:, :kept]
    rows["weight"] = np.take_along_axis(rows["weight"], first, 1)
    return PlaneFit(**rows)


def _once(points: Any, mask: Any) -> tuple[np.ndarray, np.ndarray]:
    """`mask` without touches at a place where another one stands before them, bool [fit, point];
    all of touches at one or two places, which have statuses of their own. And of every touch the
    first one at its place, [fit, point]."""
    points = checked_array("points", points, (None, None, 3))
    shape = points.shape[:2]
    mask = checked_array("mask", np.ones(shape) if mask is None else mask, shape, bool)
    there = np.where(mask[..., None], points, np.nan)  # which equals nothing
    order = np.lexsort(np.moveaxis(there, 2, 0), axis=-1)  # stable: of equal ones the first leads
    ordered = np.take_along_axis(there, order[..., None], 1)
    new = np.ones(shape, bool)
    new[:, 1:] = (ordered[:, 1:] != ordered[:, :-1]).any(2)
    leads = np.maximum.accumulate(np.where(new, np.arange(shape[1]), 0), axis=1)
    first = np.zeros(shape, int)
    np.put_along_axis(first, order, np.take_along_axis(order, leads, 1), 1)
    once = mask & (first == np.arange(shape[1]))
    return np.where(once.sum(axis=1, keepdims=True) > 2, once, mask), first


def _weights(sets: Sets, robust: bool) -> np.ndarray:
    """Weights of few touches by tests, 0 or 1; of many at the fixed point of iteratively reweighted
    total least squares."""
    if not robust:
        return sets.mask.astype(float)
    normal, offset = _best_triple(sets)
    weight = np.zeros(sets.mask.shape)
    few = np.flatnonzero(sets.count < MANY)
    weight[few] = _tested(sets.subset(few), normal[few], offset[few])
    active = np.flatnonzero(sets.count >= MANY)
    normal, offset = normal[active], offset[active]
    for _ in range(ROUNDS):
        points, mask = sets.points[active], sets.mask[active]
        away = np.abs(np.einsum("fpi,fi->fp", points, normal) - offset[:, None])
        typical = _typical(away, mask)
        scale = np.maximum(TUKEY * typical, 1e-9)
        new = np.where(mask, np.maximum(1 - (away / scale[:, None]) ** 2, 0.0) ** 2, 0.0)
        moves = np.abs(new - weight[active]).max(axis=1) > SETTLED
        weight[active] = new
        active = active[moves]
        if len(active) == 0:
            break
        mean, axes, _ = _scatter(points[moves], new[moves])
        normal = axes[:, :, 0]
        offset = np.einsum("fi,fi->f", mean, normal)
    return weight


def _tested(sets: Sets, normal: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Touches of small sets that are no outliers, bool [fit, point], from planes near their nearest
    halves. Halves along a line grow until they span a plane."""
    near = np.abs(np.einsum("fpi,fi->fp", sets.points, normal) - offset[:, None])
    # Half of the touches, and one of which three leave a distance from their plane.
    size = np.minimum(np.maximum((sets.count + 2) // 2, 4), sets.count)
    clean = _nearest(np.where(sets.mask, near, np.inf), size)
    active = np.flatnonzero(size < sets.count)
    while len(active):
        many = size[active]
        away, flat = _deleted(sets.points[active], clean[active])
        away = np.where(flat[:, None], away, near[active])
        away = np.where(sets.mask[active], away, np.inf)
        next_away = np.take_along_axis(np.sort(away, axis=1), many[:, None], axis=1)[:, 0]
        grows = ~flat | (next_away < -stdtrit(many - 3, LEVEL / (2 * (many + 1))))
        active = active[grows]
        size[active] += 1
        clean[active] = _nearest(away[grows], size[active])
        active = active[size[active] < sets.count[active]]
    return clean


def _nearest(away: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Which touches are the `size` [fit] nearest ones, bool [fit, point]."""
    rank = np.argsort(np.argsort(away, axis=1, kind="stable"), axis=1, kind="stable")
    return rank < size[:, None]


def _deleted(points: np.ndarray, clean: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Studentized distances from the plane of the touches `clean` [fit, point], [fit, point], and
    whether these span a plane, [fit].

    Of clean touches residuals, of others errors of prediction.
    """
    mean, axes, values = _scatter(points, clean.astype(float))
    count = clean.sum(axis=1)[:, None]
    along = np.einsum("fpi,fik->fpk", points - mean[:, None], axes)
    noise = np.maximum(values[:, :1] / np.maximum(count - 3, 1), NO_NOISE**2)
    lever = 1 / count + (along[:, :, 1:] ** 2 / np.maximum(values[:, None, 1:], 1e-300)).sum(axis=2)
    share = np.where(clean, np.maximum(1 - lever, 1e-9), 1 + lever)
    flat = values[:, 1] > count[:, 0] * NO_NOISE**2
    return np.abs(along[:, :, 0]) / np.sqrt(noise * share), flat


def _best_triple(sets: Sets) -> tuple[np.ndarray, np.ndarray]:
    """Normal and offset of the plane through three touches with the least trimmed squares."""
    pick = np.random.default_rng(3).random((TRIPLES, 3))
    count = sets.count[:, None, None]
    index = np.minimum((pick * count).astype(int), count - 1)
    corners = np.take_along_axis(sets.points[:, None], index[..., None], axis=2)
    normal = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    length = np.linalg.norm(normal, axis=2)
    normal = normal / np.maximum(length, 1e-300)[..., None]
    offset = np.einsum("fti,fti->ft", normal, corners[:, :, 0])
    square = (np.einsum("fpi,fti->ftp", sets.points, normal) - offset[..., None]) ** 2
    ordered = np.sort(np.where(sets.mask[:, None], square, np.inf), axis=2)
    half = np.arange(ordered.shape[2]) < (sets.count // 2 + 1)[:, None]
    trimmed = np.where(half[:, None], ordered, 0.0).sum(axis=2)
    # Exclude slivers, and planes whose nearest touches lie along a line, unless all are such. The
    # width is relative to the triangle's size, since one with an outlier is far larger than others.
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=2), axis=3).max(axis=2)
    width = length / np.maximum(edges, 1e-150) ** 2
    sliver = width < SLIVER * width.max(axis=1, keepdims=True)
    farthest = np.take_along_axis(ordered, (sets.count // 2)[:, None, None], axis=2)
    width = _width(sets.points, (square <= farthest) & sets.mask[:, None])
    sliver |= width < NARROW**2 * np.where(sliver, 0.0, width).max(axis=1, keepdims=True)
    best = np.argmin(np.where(sliver, np.inf, trimmed), axis=1)
    rows = np.arange(len(best))
    return normal[rows, best], offset[rows, best]


def _width(points: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Ratio of the second to the first principal variance of the touches near each plane.

    Shapes: `points` [fit, point, 3], `near` [fit, plane, point], result [fit, plane]. With one
    variance nearly zero, the sum of their products over the square of their sum is that ratio, up
    to a factor of four.
    """
    first, second = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)
    centred = points - points.mean(axis=1, keepdims=True)
    terms = np.concatenate([centred, centred[..., first] * centred[..., second]], axis=2)
    count = np.maximum(near.sum(axis=2), 1)[..., None]
    mean = np.einsum("ftp,fpk->ftk", near.astype(float), terms) / count
    xx, yy, zz, xy, xz, yz = np.moveaxis(
        mean[..., 3:] - mean[..., first] * mean[..., second], 2, 0)
    products = xx * yy + xx * zz + yy * zz - xy**2 - xz**2 - yz**2
    return np.maximum(products, 0.0) / np.maximum(xx + yy + zz, 1e-150) ** 2


def _scatter(points, weight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weighted mean, principal axes as columns (least first), and scatter along them."""
    total = np.maximum(weight.sum(axis=1), 1e-300)
    mean = (points * weight[..., None]).sum(axis=1) / total[:, None]
    spread = points - mean[:, None]
    values, axes = np.linalg.eigh(np.einsum("fpi,fpj->fij", weight[..., None] * spread, spread))
    return mean, axes, np.maximum(values, 0.0)


def _describe(sets: Sets, weight: np.ndarray) -> dict[str, np.ndarray]:
    mean, axes, values = _scatter(sets.points, weight)
    total = weight.sum(axis=1)
    normal, u = _positive(axes[:, :, 0]), _positive(axes[:, :, 2])
    v = np.cross(normal, u)
    on = weight > 0.05
    spread = sets.points - mean[:, None]
    extent = [_reach(np.einsum("fpi,fi->fp", spread, axis), on) for axis in (u, v)]
    # Variance of an M-estimate (Huber 1981): mean psi^2 / (mean psi')^2, psi = weight * residual.
    used = weight > 0
    count = np.maximum(used.sum(axis=1), 1)
    psi = weight * np.einsum("fpi,fi->fp", spread, normal)
    root = np.sqrt(weight)
    bow = (root * (5 * root - 4)).sum(axis=1) / count
    # Of three touches nothing is left to tell it by. Of few it is told badly: variances are those
    # of a Gaussian that holds 90 % where Student's distribution does.
    doubt = (stdtrit(np.maximum(count - 3, 1), 0.05) / NORMAL_90) ** 2
    noise = np.where(count > 3, (psi**2).sum(axis=1) / np.maximum(count - 3, 1)
                     / np.maximum(bow, 0.1) ** 2, np.inf)
    share = np.maximum(total, 1e-300) / count
    # Rotation about u is determined by the scatter along v, and conversely; by what of it is not
    # the touches' own spread.
    scatter = values[:, [1, 2]] - (noise * total)[:, None]
    # At most 1 rad^2 below.
    tips = (doubt * noise * share)[:, None] / np.maximum(scatter, 1e-300)
    shift = doubt * noise / count
    scale = sets.scale
    variances = np.concatenate([np.minimum(tips, 1.0), (shift * scale**2)[:, None]], axis=1)
    centre = mean * scale[:, None] + sets.origin
    straight = values[:, 1] <= 1e-10 * values[:, 2]
    return {
        "normal": normal,
        "offset_m": np.einsum("fi,fi->f", normal, centre),
        "centre_m": centre,
        "axes": np.stack([u, v], axis=1),
        "extent_m": np.stack(extent, axis=1) * scale[:, None],
        "rms_m": np.sqrt(values[:, 0] / np.maximum(total, 1e-300)) * scale,
        "covariance": np.where(np.eye(3, dtype=bool), variances[:, :, None], 0.0),
        "status": np.where(straight, FitStatus.degenerate_line, FitStatus.converged),
    }


def _positive(direction: np.ndarray) -> np.ndarray:
    """The direction or its opposite, with a positive z (else y, else x)."""
    return direction * np.where(is_upward(direction), 1.0, -1.0)


def _reach(coordinate: np.ndarray, on: np.ndarray) -> np.ndarray:
    high = np.where(on, coordinate, -np.inf).max(axis=1, initial=-np.inf)
    low = np.where(on, coordinate, np.inf).min(axis=1, initial=np.inf)
    return np.where(np.isfinite(high - low), high - low, 0.0)


def _typical(away: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Standard deviation of touches about each plane, by the median of their distances [fit, point]
    (Rousseeuw and Leroy 1987, Robust Regression and Outlier Detection, p. 202)."""
    count = mask.sum(axis=1)
    ordered = np.sort(np.where(mask, away, np.inf), axis=1)
    middle = (np.maximum(count, 1) - 1) // 2
    median = np.take_along_axis(ordered, middle[:, None], axis=1)[:, 0]
    return 1.4826 * (1.0 + 5.0 / np.maximum(count - 3, 1)) * median
