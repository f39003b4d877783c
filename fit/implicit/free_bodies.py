"""Free forms of sets of touches with their meshes, their volumes, and how far their surfaces are
from any touch."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from fit.arrays import rows_of
from fit.fit_status import is_fitted
from fit.implicit.fit import fit_implicit
from fit.implicit.mesh import implicit_meshes
from fit.implicit.record import FreeForms, TriangleMesh
from fit.implicit.volume import implicit_volume

ON_TABLE = 1e-3
"""A place so near to the table, as a share of the body's size, stands on it."""


def fit_free_forms(
    points: Float[np.ndarray, "fit point 3"], mask: Bool[np.ndarray, "fit point"],
    normals: Float[np.ndarray, "fit point 3"] | None = None, *, table_z_m: float | None = None
) -> FreeForms:
    """Free forms about a sphere, with the default options of `fit_implicit`, their meshes and
    volumes; exact copies of a touch count once.

    `points` [m], `mask` and `normals` as for `fit_implicit`, `table_z_m` the height of the table
    on which all bodies stand. Raises ValueError for arrays of the wrong shape.
    """
    mask = mask & ~_copies(points, mask)
    fits = fit_implicit(points, mask, normals=normals, table_z=table_z_m)
    count = len(fits)
    mesh = np.full(count, TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), int)), object)
    volume, std, gap, spacing = (np.full(count, np.nan) for _ in range(4))
    interval = np.full((count, 2), np.nan)
    rows = np.flatnonzero(is_fitted(fits.status))
    if len(rows):
        found = rows_of(fits, rows)
        meshes = implicit_meshes(found)
        known = implicit_volume(found, meshes)
        volume[rows], interval[rows] = known.volume_m3, known.interval_m3()
        for k, row in enumerate(rows):
            mesh[row] = meshes[k]
            if len(meshes[k].faces):
                std[row] = np.median(known.surface_std_m[k])
                gap[row] = _gap(known.surface_m[k], points[row, mask[row]], table_z_m)
                spacing[row] = np.sqrt(meshes[k].area_m2 / mask[row].sum())
    rms = np.where(is_fitted(fits.status), fits.rms_m, np.nan)
    return FreeForms(mesh, volume, interval, std, gap, spacing, rms, fits.n_points, fits.status)


def _copies(points: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Touches whose coordinates an earlier touch of their set has, (fit, point)."""
    copied = mask.copy()
    for row, used in enumerate(mask):
        slots = np.flatnonzero(used)
        copied[row, slots[np.unique(points[row, slots], axis=0, return_index=True)[1]]] = False
    return copied


def _gap(surface: np.ndarray, touches: np.ndarray, table_z_m: float | None) -> float:
    """The largest distance of samples (sample, 3) that stand on no table from all touches [m]."""
    if table_z_m is not None:
        off = surface[:, 2] > table_z_m + ON_TABLE * np.ptp(surface, axis=0).max()
        surface = surface[off]
    return float(KDTree(touches).query(surface)[0].max(initial=0.0))
