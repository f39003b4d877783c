"""Preparation of point sets: check, sort, centre and scale to unit size."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from fit.arrays import is_valid
from fit.fit_status import FAR, LEAST_EXTENT_M, FitStatus
from fit.optimize.batch import point_bucket
from fit.option_checks import check_balls, checked_array, spread_array

MIN_SOLID_POINTS = 8
"""Minimum number of points for a solid."""
FLAT = 1e-5
"""A set is degenerate in a direction if its spread is below this fraction of the largest."""
FREE_BUCKET = 24
"""Free-space balls are padded to a multiple of this: as many as episodes give to a fit."""
SETS_AT_ONCE = 1024
"""Sets of one bucket fitted together. Their starts take about 40 kB each; more is no faster."""
_SIX = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)  # rows and columns of a symmetric matrix
_DEFINITE = 1e-9


@dataclass(frozen=True)
class Sets:
    """Sets of points in their unit frames: world = origin + scale * unit."""

    points: Float[np.ndarray, "fit point 3"]
    """Unmasked points first, in an order that does not depend on the input order."""
    mask: Bool[np.ndarray, "fit point"]
    order: Int[np.ndarray, "fit point"]
    """Input slot of each point."""
    count: Int[np.ndarray, " fit"]
    origin: Float[np.ndarray, "fit 3"]
    scale: Float[np.ndarray, " fit"]
    low: Float[np.ndarray, "fit 3"]
    """Lowest coordinates of the points used [m]."""
    high: Float[np.ndarray, "fit 3"]
    status: Int[np.ndarray, " fit"]
    """`converged` if the set can be fitted, otherwise the reason."""
    covariance: Float[np.ndarray, "fit point 3 3"] | None = None
    normals: Float[np.ndarray, "fit point 3"] | None = None
    """NaN where unknown."""
    plane: Float[np.ndarray, "fit 4"] | None = None
    """Down direction, and height of the table along it."""
    free: Float[np.ndarray, "fit 4 free"] | None = None
    """Centres and radii of balls of free space; radius 0 for padding."""

    def subset(self, index: np.ndarray, width: int | None = None) -> "Sets":
        """The sets `index`, with `width` point slots (unchanged if None)."""
        slots = self.points.shape[1] if width is None else width
        rows = {name: value[index] for name, value in vars(self).items() if value is not None}
        for name in ("points", "mask", "order", "covariance", "normals"):
            if name in rows:
                rows[name] = _resized(rows[name], slots)
        # Padding repeats a real point, so that a masked slot has valid data.
        points, mask = rows["points"], rows["mask"]
        rows["points"] = np.where(mask[..., None], points, points[:, :1])
        return replace(self, **rows)

    def buckets(self) -> Iterator[tuple[np.ndarray, "Sets"]]:
        """Indices and sets that can be fitted together: those with one padded number of points."""
        fittable = self.status == FitStatus.converged
        widths = np.array([point_bucket(int(count)) for count in self.count], int)
        for width in np.unique(widths[fittable]):
            index = np.flatnonzero(fittable & (widths == width))
            for first in range(0, len(index), SETS_AT_ONCE):
                part = index[first : first + SETS_AT_ONCE]
                yield part, self.subset(part, int(width))


def _resized(array: np.ndarray, width: int) -> np.ndarray:
    """`array` [fit, point, ...] cut or zero-padded to `width` points."""
    array = array[:, :width]
    missing = width - array.shape[1]
    return np.pad(array, [(0, 0), (0, missing)] + [(0, 0)] * (array.ndim - 2))


def prepare(
    points, mask, covariance=None, normals=None, table_z=None,
    free_points=None, free_radius=None, free_mask=None, *,
    least_points=MIN_SOLID_POINTS, solid=True,
) -> Sets:
    """Sets from the arguments of a fit. Raises ValueError for a wrong shape, never for a value.

    A shape needs `least_points` different points; a `solid` needs points that are not coplanar.
    """
    points = checked_array("points", points, (None, None, 3))
    n, width = points.shape[:2]
    mask = checked_array("mask", np.ones((n, width)) if mask is None else mask, (n, width), bool)
    sound = is_valid(points).all(axis=2)
    bad = (mask & ~sound).any(axis=1)
    kept = mask & sound

    # Sort by coordinates, so that sums do not depend on the input order, and drop unused slots.
    rows = np.arange(n)[:, None]
    count = kept.sum(axis=1)
    order = np.argsort(~kept, axis=1, kind="stable")[:, :point_bucket(int(count.max(initial=0)))]
    filled = np.where(kept[rows, order, None], points[rows, order], 0.0)
    order = order[rows, np.lexsort((*np.moveaxis(filled, 2, 0)[::-1], ~kept[rows, order]))]
    points, kept = points[rows, order], kept[rows, order]
    points = np.where(kept[..., None], points, 0.0)

    some = np.maximum(count, 1)
    origin = points.sum(axis=1) / some[:, None]
    centred = np.where(kept[..., None], points - origin[:, None], 0.0)
    scatter = np.einsum("fpi,fpj->fij", centred, centred) / some[:, None, None]
    lengths = np.sqrt(np.maximum(np.linalg.eigvalsh(scatter), 0.0))[:, ::-1]
    size = np.sqrt((lengths**2).sum(axis=1))
    scale = np.where(size > 0, size, 1.0)
    reach = np.abs(origin).max(axis=1) + size
    repeated = kept[:, 1:] & (points[:, 1:] == points[:, :-1]).all(axis=2)  # they are sorted
    status = _status(count, repeated.sum(axis=1), lengths, reach, bad, least_points, solid)

    def bounds(fill, pick):
        edge = pick(np.where(kept[..., None], points, fill), axis=1, initial=fill)
        return np.where(np.isfinite(edge), edge, 0.0)

    low, high = bounds(np.inf, np.min), bounds(-np.inf, np.max)
    if covariance is not None:
        covariance = checked_array("covariance", covariance, (n, width, 3, 3))[rows, order]
        sound = with_covariance(kept, covariance)
        status = np.where((kept & ~sound).any(axis=1), FitStatus.bad_points, status)
        covariance = np.where(sound[..., None, None], covariance, 0.0)
        covariance = covariance / scale[:, None, None, None] ** 2
    if normals is not None:
        normals = checked_array("normals", normals, (n, width, 3))[rows, order]
        # Scale by a power of two first, which is exact, so that the squares do not overflow.
        normals = np.ldexp(normals, -np.frexp(np.abs(normals).max(axis=2, keepdims=True))[1])
        with np.errstate(invalid="ignore", divide="ignore"):
            normals = normals / np.linalg.norm(normals, axis=2, keepdims=True)
    plane = None
    if table_z is not None:
        height = spread_array("table_z", table_z, (n,))
        wrong = (status == FitStatus.converged) & ~_may_stand(low, high, height)
        status = np.where(wrong | ~is_valid(height), FitStatus.bad_points, status)
        plane = np.zeros((n, 4))
        plane[:, 2] = -1.0
        plane[:, 3] = -(np.where(is_valid(height), height, 0.0) - origin[:, 2]) / scale
    free = None
    check_balls(free_points, free_radius, free_mask)
    if free_points is not None:
        free = _free(n, free_points, free_radius, free_mask, origin, scale)
    return Sets(
        points=centred / scale[:, None, None], mask=kept, order=order, count=count,
        origin=origin, scale=scale,
        low=low, high=high, status=status,
        covariance=covariance, normals=normals, plane=plane, free=free,
    )


def _may_stand(low: np.ndarray, high: np.ndarray, table_z: np.ndarray) -> np.ndarray:
    """Whether points from `low` to `high` [fit, 3] may be those of a body on a table of height
    `table_z` [fit]: not all are below it, nor all far above it."""
    extent = np.maximum(np.linalg.norm(high - low, axis=1), LEAST_EXTENT_M)
    return (high[:, 2] >= table_z) & (low[:, 2] - table_z <= FAR * extent)


def with_covariance(kept: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Which of the touches `kept` [fit, point] have a covariance [fit, point, 3, 3] that is one:
    of valid numbers, no variance negative."""
    sound = kept & is_valid(covariance).all(axis=(2, 3))
    sound[sound] = _semidefinite(covariance[sound])
    return sound


def _semidefinite(covariance: np.ndarray) -> np.ndarray:
    """Whether covariances [touch, 3, 3] are positive semidefinite, up to rounding."""
    twice = covariance + covariance.swapaxes(1, 2)
    xx, yy, zz, xy, xz, yz = (twice[:, i, j] for i, j in zip(*_SIX, strict=True))
    # Sylvester's criterion decides clear cases; eigenvalues take far longer.
    size = xx + yy + zz
    plane = xx * yy - xy**2
    solid = zz * plane - yz * (xx * yz - xy * xz) + xz * (xy * yz - yy * xz)
    sure = (xx > _DEFINITE * size) & (plane > _DEFINITE * size**2) & (solid > _DEFINITE * size**3)
    unclear = np.flatnonzero(~(sure & (size > 0.0)))
    least, _, most = np.linalg.eigvalsh(twice[unclear]).T
    sure[unclear] = least >= -1e-6 * most
    return sure


def _status(count, repeated, lengths, reach, bad, least_points, solid) -> np.ndarray:
    """Reason why a set cannot be fitted, or `converged`."""
    # Rounding spreads coincident points by about 1e-16 of their distance from the origin.
    point = lengths[:, 0] <= 1e-12 * np.maximum(reach, 1e-300)
    line = lengths[:, 1] <= FLAT * lengths[:, 0]
    plane = solid & (lengths[:, 2] <= FLAT * lengths[:, 0])
    return np.select(
        [bad, count < least_points, point, line, plane, count - repeated < least_points],
        [FitStatus.bad_points, FitStatus.too_few_points, FitStatus.degenerate_point,
         FitStatus.degenerate_line, FitStatus.degenerate_plane, FitStatus.too_few_points],
        FitStatus.converged,
    )


def _free(n, free_points, free_radius, free_mask, origin, scale) -> np.ndarray:
    free_points = checked_array("free_points", free_points, (n, None, 3))
    balls = free_points.shape[1]
    radius = spread_array("free_radius", 0.0 if free_radius is None else free_radius, (n, balls))
    kept = checked_array("free_mask", np.ones((n, balls)) if free_mask is None else free_mask,
                         (n, balls), bool)
    kept = kept & is_valid(free_points).all(axis=2) & is_valid(radius) & (radius >= 0.0)
    width = max(-(-balls // FREE_BUCKET), 1) * FREE_BUCKET
    free = np.zeros((n, 4, width))
    unit = (free_points - origin[:, None]) / scale[:, None, None]
    free[:, :3, :balls] = np.where(kept[:, None], np.moveaxis(unit, 2, 1), 10.0)
    free[:, :3, balls:] = 10.0
    # A ball of radius zero is a point of free space; the minimum distinguishes it from padding.
    free[:, 3, :balls] = np.where(kept, np.maximum(radius / scale[:, None], 1e-6), 0.0)
    return free
