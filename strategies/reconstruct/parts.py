"""Bodies of two to four superquadrics, where contacts say that one is not enough.

Contacts are those of a free form, which places them without supposing a shape. They are divided
into clusters, a superquadric is fitted to each, every contact goes to the one it is nearest to, and
so on (as k-plane clustering, Bradley and Mangasarian 2000, with superquadrics). That ends in a
local optimum: it is begun from several divisions, along each principal axis and about far points.
How many parts there are, Schwarz's criterion (1978) says.
"""

import warnings
from dataclasses import replace

import numpy as np
from scipy.cluster.vq import kmeans2

from fit.arrays import rows_of
from fit.fit_status import is_fitted
from fit.implicit.mesh import zero_set_meshes
from fit.implicit.record import TriangleMesh
from fit.superquadric.geometry import superquadric_points
from fit.superquadric.record import SuperquadricFit
from strategies.poses.waypoints import BoundingCylinder
from strategies.reconstruct.prior_distance import superquadric_distance
from strategies.recovery.choose_model import OF_A_SUPERQUADRIC
from strategies.recovery.evidence import Evidence
from strategies.recovery.fit_contacts import recover_bodies
from strategies.recovery.misfit import FARTHEST_M, LEAST_MISFIT_M, schwarz
from strategies.recovery.plausibility import FLOATING_M, plausible
from warpgrasp.parameters import FitTable

MOST_PARTS = 4
ROUNDS = 3
"""Fits of all parts from each division [est]."""
_CELLS = 64
"""Of the grid of a union: a handle of 16 mm among parts 0.25 m long needs cells of 4 mm [est]."""
_MARGIN_M = 0.01
_NOWHERE_M = 1.0
_SURFACE_POINTS = 216
_BOX_POINTS = 5400


def fitted_parts(
    placed: Evidence, prior: BoundingCylinder, table: FitTable
) -> SuperquadricFit | None:
    """The parts of the body of one world, whose contacts are `placed`; None where contacts do not
    ask for more than one.

    Parts need neither stand on the table nor be upright, but one of them does where the table is
    known, and the `prior` (1,) bounds each.
    """
    touched = placed.mask[0]
    points = placed.points_m[0][touched]
    if len(points) < 2:
        return None
    loose = replace(table, table_plane=False, taper=False, rivals=False)
    highest = FLOATING_M if table.table_plane else np.inf
    found = {1: _best(placed, np.zeros((1, len(points)), int), 1, prior, loose, highest)}
    for count in range(2, MOST_PARTS + 1):
        found[count] = _best(placed, divisions(points, count), count, prior, loose, highest)

    def evidence(count: int) -> float:
        parts, misfit = found[count]
        numbers = OF_A_SUPERQUADRIC * len(parts)
        return schwarz(misfit, len(points), numbers, LEAST_MISFIT_M) if len(parts) else np.inf

    best = min(found, key=evidence)
    return None if best == 1 or len(found[best][0]) < 2 else found[best][0]


def divisions(points_m: np.ndarray, count: int) -> np.ndarray:
    """Ways to divide points (point, 3) into `count` clusters, int (way, point): slabs across each
    principal axis, and clusters about far points, beginning at each axis' end."""
    centred = points_m - points_m.mean(0)
    along = centred @ np.linalg.svd(centred, full_matrices=False)[2].T
    order = along.argsort(axis=0, kind="stable").argsort(axis=0, kind="stable")
    ways = [order[:, axis] * count // len(points_m) for axis in range(along.shape[1])]
    for axis in range(along.shape[1]):
        far = [int(along[:, axis].argmax())]
        while len(far) < count:
            away = np.linalg.norm(points_m[:, None] - points_m[far], axis=-1).min(1)
            far.append(int(away.argmax()))
        with warnings.catch_warnings():  # of clusters that end empty
            warnings.simplefilter("ignore")
            ways.append(kmeans2(points_m, points_m[far], minit="matrix")[1])
    return np.array(ways)


def _best(placed: Evidence, label: np.ndarray, count: int, prior: BoundingCylinder, table: FitTable,
          highest_m: float) -> tuple[SuperquadricFit, float]:
    """Of divisions (way, point) that one whose parts the contacts are nearest to: the parts, and
    how far contacts are from them in the mean [m]. Parts that the prior contradicts are none, and
    neither are those that all end higher than `highest_m`."""
    touched = placed.mask[0]
    points = placed.points_m[0][touched]
    every = rows_of(placed, np.zeros(label.shape[0] * count, int))
    given = rows_of(prior, np.zeros(len(every.mask), int))
    best: tuple[SuperquadricFit, float] | None = None
    for _ in range(ROUNDS):
        mask = np.zeros((len(label), count, len(touched)), bool)
        mask[:, :, touched] = label[:, None] == np.arange(count)[:, None]
        fits, _ = recover_bodies(replace(every, mask=mask.reshape(-1, len(touched))), None, table)
        made = is_fitted(fits.status) & plausible(fits, given, table_plane=False, whole=False)
        away = np.where(made[:, None], _distances(fits, points), _NOWHERE_M)
        away = away.reshape(len(label), count, -1)
        # The surface of a union: what lies within another part is no part's surface.
        misfit = np.minimum(np.abs(away.min(1)), FARTHEST_M).mean(1)
        foot = np.where(made, _lowest(fits), np.inf).reshape(len(label), count).min(1)
        misfit = np.where(foot < highest_m, misfit, np.inf)
        way = int(misfit.argmin())
        if best is None or misfit[way] < best[1]:
            own = np.arange(way * count, (way + 1) * count)
            best = fits[own[made[own]]], float(misfit[way])
        label = np.abs(away).argmin(1)
    assert best is not None
    return best


def _lowest(fits: SuperquadricFit) -> np.ndarray:
    """Height of the lowest place of each of the fits [m], (fit,)."""
    with np.errstate(invalid="ignore", divide="ignore"):  # where nothing was fitted
        return np.nan_to_num(superquadric_points(fits, _SURFACE_POINTS))[..., 2].min(1)


def _distances(fits: SuperquadricFit, points_m: np.ndarray) -> np.ndarray:
    """Signed distances [m] of points (point, 3) to each of the fits, (fit, point)."""
    return superquadric_distance(fits, np.repeat(points_m[None], len(fits), 0))


def parts_mesh(parts: SuperquadricFit, *, table_plane: bool = True) -> TriangleMesh:
    """The surface of their union, above the table if that is known."""
    surface = superquadric_points(parts, _BOX_POINTS).reshape(-1, 3)
    low, high = surface.min(0) - _MARGIN_M, surface.max(0) + _MARGIN_M

    def union(points_m: np.ndarray, rows: np.ndarray, counts: np.ndarray) -> np.ndarray:
        return _distances(parts, points_m[0]).min(0)[None]

    table = np.zeros(1) if table_plane else None
    return zero_set_meshes(union, low[None], high[None], table, cells=_CELLS)[0]
