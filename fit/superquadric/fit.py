"""Superquadric fits in batch.

    points -> sort, centre, scale -> starts -> screening -> descent of the best -> result

A fit depends only on its own points and evidence, not on their order, the padding, or other fits of
the batch. Each set uses the program compiled for its own number of points.
"""

import numpy as np
from jaxtyping import Bool, Float

from fit.option_checks import options_of
from fit.prepare import Sets, prepare
from fit.superquadric.descent import fit_sets
from fit.superquadric.record import SuperquadricFit, SuperquadricOptions


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
    start: SuperquadricFit | None = None,
) -> SuperquadricFit:
    """Fit superquadrics to sets of points.

    Args:
        points: touches [m], shape [fit, point, 3].
        mask: which points count, shape [fit, point]; None: all.
        covariance: of each touch [m^2]; its residual is divided by the standard deviation along
            the model's normal there, sqrt(n.C n + sigma_floor^2).
        normals: outward normals at the touches (NaN where unknown), for the dual superquadric;
            `options.normal_std_rad` says how sure they are.
        table_z: height of the table the body stands on [m], for all or each fit; None: no table. A
            set that lies below it, or far above, is `bad_points`. That points are in metres cannot
            be told from them.
        free_points, free_radius, free_mask: balls [m] of known free space; one whose place or
            radius is no number, or whose radius is negative, does not count.
        options: see `SuperquadricOptions`.
        start: fits to nearly the same points, one per set; fitted ones of finite parameters replace
            the screening, so that the result stays near that solution.

    Returns:
        `SuperquadricFit`; a set that cannot be fitted has a `status` that says why.

    Raises:
        ValueError: an array of the wrong shape, a radius or mask of free points without the points,
            one radius of all that is none, or a start that is no fits or of another length.
    """
    options = options_of(options, SuperquadricOptions)
    sets = prepare(points, mask, covariance, normals, table_z, free_points, free_radius, free_mask)
    if not isinstance(start, SuperquadricFit | None):
        raise ValueError(f"start: {type(start).__name__}, should be a SuperquadricFit")
    if start is not None and len(start) != len(sets.count):
        raise ValueError(f"start: {len(start)} fits for {len(sets.count)} sets")
    rows = _placeholder(sets)
    for index, bucket in sets.buckets():
        begin = None if start is None else start[index]
        for name, values in fit_sets(bucket, options, begin).items():
            rows[name][index] = values
    return SuperquadricFit(**rows)


def _placeholder(sets: Sets) -> dict[str, np.ndarray]:
    """Results of sets that cannot be fitted: the bounding box of their valid points."""
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
