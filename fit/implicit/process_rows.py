"""Rows of the processes: touches, points off the surface along normals, balls of free space."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from fit.arrays import is_valid, read_only_view
from fit.fit_status import FitStatus
from fit.implicit.process import ProcessData
from fit.implicit.record import ImplicitOptions, Mean
from fit.option_checks import checked_array
from fit.prepare import Sets

ROW_BUCKETS = (32, 64, 96, 128, 192, 256, 384, 512, 704)
"""Padded numbers of rows; the cost grows with the cube."""
FREE_ROWS = 32
"""Rows kept for balls of free space: the last of each process."""
OFF_STRIDE = 3
"""Of so many touches whose normals are not known one has a point off the surface."""
_STEP = 1e-4
"""Of the differences that give a mean's slope, in unit frames."""
_SIDES = 0.7
"""Touches whose normals have a smaller cosine are of different sides of a body [est]."""
_ASIDE = 2.0
"""Times the spacing of touches: so far aside a touch tells nothing of the body there [est]."""
_DEEPEST = 3.0
"""Offsets: a touch so far behind another tells that the body is thin there [est]."""
_THICK = 0.85
"""Offsets that a point inside lies from other sides at least, in the mean [est]."""
_AT_ONCE = 256
"""Touches that are compared with all others at once, for memory."""
_FLOOR = 1e-10
"""Least variance of a row, in unit frames."""


def row_bucket(count: int) -> int:
    """Padded number of rows for `count` rows; above 704, a multiple of 256."""
    for bucket in ROW_BUCKETS:
        if count <= bucket:
            return bucket
    return -(-count // 256) * 256


@dataclass(frozen=True)
class Rows:
    """Touches and points along normals of every set, in unit frames."""

    points: Float[np.ndarray, "fit row 3"]
    target: Float[np.ndarray, "fit row"]
    variance: Float[np.ndarray, "fit row"]
    noisy: Bool[np.ndarray, "fit row"]
    touch: Int[np.ndarray, "fit row"]
    """The touch that each row comes from."""
    n_rows: Int[np.ndarray, " fit"]
    n_touches: Int[np.ndarray, " fit"]
    free: int
    """Rows kept for balls."""
    mean_slope: Float[np.ndarray, "fit point 3"]
    """Gradient of the mean at the touches."""
    log_noise: Float[np.ndarray, " fit"]
    fitted: Bool[np.ndarray, " fit"]

    @property
    def count(self) -> Int[np.ndarray, " fit"]:
        """Rows of each fit, those kept for balls included."""
        return self.n_rows + self.free

    def touches(self, width: int) -> Bool[np.ndarray, "fit row"]:
        """Which of `width` rows are touches."""
        return np.arange(width) < self.n_touches[:, None]

    def data(self, index: np.ndarray, width: int) -> ProcessData:
        """The processes of the fits `index`, padded to `width` rows; no ball counts yet."""
        kept = min(width, self.points.shape[1])
        lanes = len(index)
        used = np.arange(width) < self.n_rows[index, None]

        def padded(values: np.ndarray, fill: float) -> np.ndarray:
            room = np.full((lanes, width, *values.shape[2:]), fill)
            room[:, :kept] = values[index, :kept]
            return np.where(used.reshape(used.shape + (1,) * (values.ndim - 2)), room, fill)

        return ProcessData(
            padded(self.points, 0.0), padded(self.target, 0.0), padded(self.variance, 1.0),
            padded(self.noisy.astype(float), 0.0), np.ones((lanes, width)), used.astype(float),
            padded(self.touch, -1.0).astype(int), self.log_noise[index])


def touch_rows(sets: Sets, mean: Mean, options: ImplicitOptions, free: int) -> Rows:
    """Touches as rows, and `free` empty ones. Sets whose mean is no number at a touch are not
    `fitted`."""
    values = _mean(sets, mean, *(sets.points + s for s in (np.zeros(3), *(_STEP * np.eye(3)))))
    told = (is_valid(values[0] * sets.scale[:, None]) | ~sets.mask).all(axis=1)
    values[:, ~told] = 0.0
    with np.errstate(invalid="ignore"):
        slope = np.moveaxis((values[1:] - values[0]) / _STEP, 0, 2)
    fitted = (sets.status == FitStatus.converged) & told
    variance = _variance_along(sets, slope)
    return Rows(
        points=sets.points, target=np.where(sets.mask, -values[0], 0.0),
        variance=np.where(sets.mask, np.maximum(variance, _FLOOR), 1.0), noisy=sets.mask,
        touch=np.broadcast_to(np.arange(sets.mask.shape[1]), sets.mask.shape),
        n_rows=sets.count, n_touches=sets.count, free=free, mean_slope=slope,
        log_noise=np.log(options.noise_m / sets.scale), fitted=fitted)


def with_normals(rows: Rows, sets: Sets, mean: Mean, normals: Float[np.ndarray, "fit point 3"],
                 options: ImplicitOptions) -> Rows:
    """The rows and points off the surface, along known normals or else along `normals`.

    They make the process a distance: touches alone, where it is zero, leave its slope open, and a
    flat process would be the likeliest (Carr and others 2001). All known normals count, and of the
    others so many that a third of the touches have one. Every other point lies inside the body,
    where it is thick enough: an error of a touch moves its point too, which makes the process less
    steep, and with all points outside the surface would lie too far inside.
    """
    n, slots = sets.mask.shape
    known = np.zeros((n, slots), bool)
    if sets.normals is not None:
        known = sets.mask & np.isfinite(sets.normals).all(axis=2)
        normals = np.where(known[..., None], sets.normals, normals)
    sound = sets.mask & np.isfinite(normals).all(axis=2)
    spread = sets.mask & (np.arange(slots) % OFF_STRIDE == OFF_STRIDE // 2)
    used = known | (spread & ~known.any(axis=1, keepdims=True))
    used &= sound
    normals = np.where(sound[..., None], normals, 0.0)
    inside = used & _is_thick(sets, normals, sound, options.normal_offset)
    inside &= np.cumsum(inside, axis=1) % 2 == 1
    offset = np.where(inside, -options.normal_offset, options.normal_offset)
    off = sets.points + normals * offset[..., None]
    target = np.where(used, offset - _mean(sets, mean, off)[0], 0.0)
    used &= np.isfinite(target)
    variance = rows.variance + (options.normal_slope * options.normal_offset) ** 2
    points = np.concatenate([rows.points, off], axis=1)
    target = np.concatenate([rows.target, target], axis=1)
    variance = np.concatenate([rows.variance, variance], axis=1)
    used = np.concatenate([sets.mask, used], axis=1)
    order = np.argsort(~used, axis=1, kind="stable")
    row = np.arange(n)[:, None]
    used = used[row, order]
    return replace(
        rows, points=np.where(used[..., None], points[row, order], 0.0),
        target=np.where(used, target[row, order], 0.0),
        variance=np.where(used, variance[row, order], 1.0), noisy=used, touch=order % slots,
        n_rows=used.sum(axis=1))


def _is_thick(
    sets: Sets, normals: np.ndarray, known: np.ndarray, offset: float
) -> Bool[np.ndarray, "fit point"]:
    """Whether the body is so thick at a touch that a point that far inside is as near to no other
    side: no touch is close behind (whatever the normals there, which thin walls blur), and the
    planes of touches of other sides are as far off. `known` says which touches have a normal.
    """
    found = np.zeros(sets.mask.shape, bool)
    for one in range(len(found)):
        own = np.flatnonzero(known[one])
        if len(own) < 2:
            continue
        points, ways = sets.points[one, own], normals[one, own]
        spacing = np.median(KDTree(points).query(points, 2)[0][:, 1])
        for some in np.array_split(np.arange(len(own)), -(-len(own) // _AT_ONCE)):
            found[one, own[some]] = _thick_at(points[some], ways[some], points, ways, offset,
                                              _ASIDE * spacing)
    return found


def _thick_at(
    touches: np.ndarray, outward: np.ndarray, points: np.ndarray, ways: np.ndarray, offset: float,
    near: float
) -> np.ndarray:
    """`_is_thick` of some `touches` among all `points` of a set, (touch,)."""
    apart = touches[:, None] - points
    behind = (apart * outward[:, None]).sum(2)
    aside = np.sqrt(np.maximum((apart**2).sum(2) - behind**2, 0.0))
    close = (behind > 0.5 * offset) & (behind < _DEEPEST * offset) & (aside < near)
    inside = touches - offset * outward
    reach = np.linalg.norm(inside[:, None] - points, axis=2) < offset + near
    others = reach & (outward @ ways.T < _SIDES)
    deep = ((points - inside[:, None]) * ways).sum(2)
    mean = (others * deep).sum(1) / np.maximum(others.sum(1), 1)
    return ~close.any(1) & (~others.any(1) | (mean > _THICK * offset))


def _mean(sets: Sets, mean: Mean, *points: np.ndarray) -> np.ndarray:
    """Values of the mean at several arrays of points of the sets, all in unit frames."""
    asked = np.concatenate(points, axis=1)
    places = sets.origin[:, None] + sets.scale[:, None, None] * asked
    values = checked_array("mean", mean(read_only_view(places), np.arange(len(asked))),
                           asked.shape[:2])
    values = values / sets.scale[:, None]
    return np.moveaxis(values.reshape(len(asked), len(points), -1), 1, 0)


def _variance_along(sets: Sets, slope: np.ndarray) -> np.ndarray:
    """Of each touch, along its normal or else the mean's slope; 0 without covariances."""
    if sets.covariance is None:
        return np.zeros(sets.mask.shape)
    size = np.linalg.norm(slope, axis=2, keepdims=True)
    sure = np.isfinite(size) & (size > 0.1)
    way = np.where(sure, slope / np.where(sure, size, 1.0), 0.0)
    if sets.normals is not None:
        known = np.isfinite(sets.normals).all(axis=2, keepdims=True)
        way, sure = np.where(known, sets.normals, way), sure | known
    along = np.einsum("fpi,fpij,fpj->fp", way, sets.covariance, way)
    isotropic = np.trace(sets.covariance, axis1=2, axis2=3) / 3.0
    return np.where(sure[..., 0], along, isotropic)
