"""Errors of the body that a free form stands about.

Those of its parameters before any touch: what contacts leave of them, the process says
(`fit.implicit.mean_errors`). The body was fitted to the same contacts, so that its own covariance
would count these twice. And what no parameters hold: where nothing was felt, the true surface may
be that of no such body (`UNFELT`, as of bodies that stand by themselves).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fit.arrays import rows_of
from fit.implicit.known import KnownProcess, known_kernel
from fit.revolution.geometry import RevolutionBody
from fit.superquadric.geometry import SuperquadricLike
from fit.superquadric.uncertainty import distance_slopes, superquadric_uncertainty
from strategies.contacts.body_uncertainty import UNFELT
from strategies.contacts.felt import Felt, unfelt_distance
from strategies.reconstruct.prior_distance import revolution_distance

if TYPE_CHECKING:
    from fit.implicit.volume import VolumeEstimate

STEP_M = 1e-5
"""Of the differences by parameters of a contour."""
LEAST_LENGTH_M = 0.001
"""Over which errors of unfelt places are alike, where contacts are everywhere."""
TILT_RAD = 0.1
"""Standard deviation of the tilt of a contour's axis [est]."""


@dataclass(frozen=True)
class ErrorsOfSuperquadrics:
    """`MeanErrors` of superquadrics: each parameter within its range, and the foot on the table if
    they stand on one."""

    body: SuperquadricLike
    on_table: bool

    def __call__(self, points_m: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Of the worlds numbered (row,) at points (row, point, 3): (row, point, 15) [m]."""
        return distance_slopes(rows_of(self.body, rows), points_m) @ self._factor[rows]

    @cached_property
    def _factor(self) -> np.ndarray:
        """Of the covariance of the parameters without a touch, (world, 15, 15)."""
        worlds = len(self.body.size_m)
        untouched = np.zeros((worlds, 1, 3)), np.zeros((worlds, 1), bool)
        return np.linalg.cholesky(superquadric_uncertainty(
            self.body, *untouched, table_z=0.0 if self.on_table else None).covariance)


@dataclass(frozen=True)
class ErrorsOfContours:
    """`MeanErrors` of contours: the place and tilt of the axis, the height of the end, and the
    radius of each node, by as much as the contour is wide."""

    body: RevolutionBody

    def __call__(self, points_m: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Of the worlds numbered (row,) at points (row, point, 3): (row, point, error) [m]."""
        body = self.body[rows]
        wide = np.nanmax(body.radius_m, axis=1)
        return np.stack([
            deviation[:, None] * (revolution_distance(_moved(body, number, STEP_M), points_m)
                                  - revolution_distance(_moved(body, number, -STEP_M), points_m))
            / (2.0 * STEP_M)
            for number in range(5 + body.radius_m.shape[1])
            for deviation in [TILT_RAD * np.nanmax(body.height_m, axis=1)
                              if number in (2, 3) else wide]], axis=2)


def _moved(body: RevolutionBody, number: int, by_m: float) -> RevolutionBody:
    """The contours with a parameter changed: 0 and 1 shift the axis, 2 and 3 its upper end, 4 the
    end along it, later ones the radius of a node."""
    if number >= 5:
        radius = body.radius_m.copy()
        radius[:, number - 5] = np.maximum(radius[:, number - 5] + by_m, 0.0)
        return replace(body, radius_m=radius)
    top = np.nanmax(body.height_m, axis=1, keepdims=True)
    if number == 4:
        return replace(body, height_m=np.where(body.height_m == top, top + by_m, body.height_m))
    least = np.eye(3)[np.abs(body.axis).argmin(1)]
    one = np.cross(body.axis, least)
    one /= np.linalg.norm(one, axis=1, keepdims=True)
    way = one if number % 2 == 0 else np.cross(body.axis, one)
    if number < 2:
        return replace(body, foot_m=body.foot_m + by_m * way)
    axis = body.axis + by_m / top * way
    return replace(body, axis=axis / np.linalg.norm(axis, axis=1, keepdims=True))


def with_unfelt(known: "VolumeEstimate", felt: Felt, area_m2: np.ndarray) -> "VolumeEstimate":
    """Volumes and surfaces, less sure by how far contacts are from each place of the surface.

    `felt` are the contacts, as placed, of the worlds of `known`; `area_m2` (world,) is that of the
    surface. Contacts pin the surface, so that errors are alike about as far as the next contact is.
    """
    away = unfelt_distance(known.surface_m, felt)
    off, length = UNFELT * away, np.maximum(away.mean(1), LEAST_LENGTH_M)
    alike = np.stack([known_kernel(KnownProcess(one, amplitude_m=1.0), places, places)
                      for one, places in zip(length, known.surface_m, strict=True)])
    square = np.einsum("wi,wij,wj->w", off, alike, off) / off.shape[1] ** 2
    return replace(known, std_m3=np.sqrt(known.std_m3**2 + area_m2**2 * square),
                   surface_std_m=np.hypot(known.surface_std_m, off))
