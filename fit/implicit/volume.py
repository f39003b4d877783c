"""Volume of free-form bodies with its standard deviation, and the deviation of their surfaces.

Where the distance changes by df, the surface moves by -df / |gradient|; so to first order the
volume changes by the integral of that over the surface, and its variance is the double integral of
the posterior covariance. By the same integral the volume is taken from the mesh, whose triangles
are chords of the surface, to the zero set.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import jax
import numpy as np
from jax.scipy.linalg import solve_triangular
from jaxtyping import Float

from fit.implicit.mean_errors import MeanErrors, errors_left
from fit.implicit.process import covariance_factor, distances, matern
from fit.implicit.query import implicit_distance
from fit.implicit.record import ImplicitFit, Mean, TriangleMesh
from fit.optimize.batch import Program, map_lanes
from fit.option_checks import check_number

SAMPLES = 256
"""Points of a surface at which the covariance is taken."""
LEAST_SLOPE = 0.2
"""A slope of the distance below this counts as this much."""
LEAST_M3 = 1e-21
"""The volume that an interval takes one without volume for."""
NORMAL_90 = 1.6449
"""A normal number is within so many standard deviations with probability 0.9."""


@dataclass(frozen=True)
class VolumeEstimate:
    """Volumes, one a fit, and the surface's own uncertainty at sample points."""

    volume_m3: Float[np.ndarray, " fit"]
    """Of the zero sets; those of meshes of 32 cells are some 0.5 % smaller."""
    std_m3: Float[np.ndarray, " fit"]
    surface_m: Float[np.ndarray, "fit sample 3"]
    """Points spread evenly over the surface [m]; 0 where the mesh is empty."""
    surface_std_m: Float[np.ndarray, "fit sample"]
    """Standard deviation of the surface along its normal there [m]."""

    def interval_m3(self) -> Float[np.ndarray, "fit 2"]:
        """90 % interval of each volume, log-normal, so that it is positive."""
        volume = np.maximum(self.volume_m3, LEAST_M3)
        spread = np.exp(NORMAL_90 * np.sqrt(np.log1p((self.std_m3 / volume) ** 2)))
        return np.stack([volume / spread, volume * spread], 1)


def implicit_volume(
    fits: ImplicitFit, meshes: Sequence[TriangleMesh], mean: Mean | None = None, *,
    errors: MeanErrors | None = None, shared_m: float = 0.0
) -> VolumeEstimate:
    """Volumes of the bodies whose meshes are those of `implicit_meshes`, and what the posterior
    says of their error.

    `errors` are those that the mean has before any touch; None: it is known. `shared_m` is the
    standard deviation [m] of an error along the normal that all touches share: the process takes
    it for a larger or smaller body. Raises ValueError for another number of meshes than fits, and
    for a `shared_m` that is not finite or below zero.
    """
    check_number("shared_m", shared_m)
    if len(meshes) != len(fits):
        raise ValueError(f"meshes: {len(meshes)} for {len(fits)} fits")
    if len(fits) == 0:
        return VolumeEstimate(np.zeros(0), np.zeros(0), np.zeros((0, SAMPLES, 3)),
                              np.zeros((0, SAMPLES)))
    surface = np.stack([surface_samples(mesh, SAMPLES) for mesh in meshes]).reshape(-1, SAMPLES, 3)
    area = np.array([_areas(mesh).sum() for mesh in meshes])
    values = implicit_distance(fits, surface, mean)
    slope = np.maximum(np.linalg.norm(values.gradient, axis=2), LEAST_SLOPE)
    share = area[:, None] / SAMPLES / slope
    used = fits.noise_m2 >= 0.0
    centre = fits.centre_m[:, None]
    variance = map_lanes(
        _VARIANCE, fits.length_m, fits.amplitude_m,
        np.where(used[..., None], fits.points_m - centre, 0.0),
        np.where(used, fits.noise_m2, 1.0), used.astype(float), surface - centre, share)
    std = values.std_m / slope
    if errors is not None:
        left = errors_left(fits, errors, surface)
        variance = variance + np.square(np.einsum("fs,fse->fe", share, left)).sum(1)
        std = np.hypot(std, np.linalg.norm(left, axis=2) / slope)
    # Where a triangle is farther off than it is wide, its grid cut the body off.
    away = values.distance_m / slope
    side = np.sqrt(area / np.array([max(len(mesh.faces), 1) for mesh in meshes]))
    near = np.abs(away) <= side[:, None]
    volume = (np.array([mesh.volume_m3 for mesh in meshes])
              - area * np.where(near, away, 0.0).mean(axis=1))
    return VolumeEstimate(volume,
                          np.sqrt(np.maximum(variance, 0.0) + (shared_m * area) ** 2), surface,
                          np.hypot(std, shared_m))


def surface_samples(mesh: TriangleMesh, count: int) -> Float[np.ndarray, "sample 3"]:
    """Points evenly spread over the area of a mesh, the same for the same mesh [m].

    One of each of `count` equal shares of the area, taken triangle after triangle, at places of the
    triangles that follow the R2 sequence (Roberts 2018). Zeros for an empty mesh.
    """
    if len(mesh.faces) == 0:
        return np.zeros((count, 3))
    total = np.cumsum(_areas(mesh))
    face = np.searchsorted(total, (np.arange(count) + 0.5) / count * total[-1])
    u, v = np.mod(np.arange(count)[:, None] * [0.7548776662466927, 0.5698402909980532] + 0.5, 1).T
    fold = u + v > 1.0
    u, v = np.where(fold, 1.0 - u, u), np.where(fold, 1.0 - v, v)
    a, b, c = np.moveaxis(mesh.corners_m[np.minimum(face, len(mesh.faces) - 1)], 1, 0)
    return a + u[:, None] * (b - a) + v[:, None] * (c - a)


def _areas(mesh: TriangleMesh) -> Float[np.ndarray, " face"]:
    a, b, c = np.moveaxis(mesh.corners_m, 1, 0)
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def _integral_variance(length, amplitude, points, noise, used, surface, share):
    """Variance of the sum of share * f over surface points [sample, 3]."""
    lower = covariance_factor(length, amplitude, points, noise, used)
    across = amplitude**2 * (matern(distances(points, surface), length) @ share) * used
    known = solve_triangular(lower, across, lower=True)
    prior = amplitude**2 * (share @ matern(distances(surface, surface), length) @ share)
    return prior - known @ known


_VARIANCE = Program("implicit volume variance", jax.vmap(_integral_variance))
