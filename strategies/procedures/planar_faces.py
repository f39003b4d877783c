"""Results of explored faces: planes, whether they are flat, and angles between them."""

from dataclasses import dataclass, replace

import numpy as np

from fit.arrays import rows_of
from fit.fit_status import FitStatus
from fit.plane import fit_plane
from fit.plane_record import PlaneFit
from strategies.procedures.planar_record import PlanarExploration

_FACING_RAD = np.radians(35)
FLAT_M = 0.001
"""Touches of a flat face lie no farther off their plane, and bow no more [est]."""
NARROWEST = 10.0
"""A face is at least so many times as wide as its touches lie off it, or it is not called flat
[est]: its normal is told to some ten degrees then."""


@dataclass(frozen=True)
class Face:
    """One face of each world's object, a row a world."""

    normal: np.ndarray
    """Outward, (world, 3)."""
    offset_m: np.ndarray
    """normal . x on the face, (world,)."""
    bow_m: np.ndarray
    """Sagitta of the touches along u and v: how far a parabola through them rises, (world, 2)."""
    flat: np.ndarray
    """Whether the touches are those of one plane (see `planes_of`), (world,)."""
    fit: PlaneFit
    """With extents, covariance and status, `not_converged` where the normals felt contradict the
    plane; its normal may point inwards."""
    felt_normal: np.ndarray
    """Mean normal that the touches on the plane felt, (world, 3)."""


def planes_of(exploration: PlanarExploration) -> Face:
    """The robust plane of every world's touches.

    A face is called flat if the touches on the plane lie within `FLAT_M`, and no parabola along u
    or v bows by more than that; a touch past an edge, or of what lies below, takes no part. Of one
    so narrow that the touches hardly tell how it is turned it cannot be said. A plane that stands
    across the normals felt on it, as one through an edge and a lower surface may, is no face found.
    """
    worlds = len(exploration.reason)
    points, mask = exploration.touches.sets(worlds)
    # Where nothing was felt all worlds are alike: one of them is fitted for all.
    felt = mask.any(1)
    like = np.where(felt, np.arange(worlds), np.argmin(felt) if worlds else 0)
    rows, index = np.unique(like, return_inverse=True)
    part = fit_plane(points[rows], mask[rows])
    fit = rows_of(part, index)
    felt_normal = _felt_normal(exploration, fit)
    along = np.abs((felt_normal * fit.normal).sum(1))
    against = felt_normal.any(1) & (along < np.cos(_FACING_RAD))
    fit = replace(fit, status=np.where(against & (fit.status == FitStatus.converged),
                                       FitStatus.not_converged, fit.status))
    outward = np.where((fit.normal * exploration.axes[:, 2]).sum(1) < 0, -1.0, 1.0)
    bow = _bow(exploration, rows)[index]
    wide = fit.extent_m.min(1) >= NARROWEST * fit.rms_m
    flat = ((fit.status == FitStatus.converged) & (fit.rms_m <= FLAT_M) & wide
            & (np.abs(bow) <= FLAT_M).all(1))
    return Face(fit.normal * outward[:, None], fit.offset_m * outward, bow, flat, fit,
                felt_normal)


def _felt_normal(exploration: PlanarExploration, fit: PlaneFit) -> np.ndarray:
    """Mean normal felt by the touches on each plane, of length 1; zeros where none, (world, 3)."""
    table = exploration.touches
    contact = np.asarray(np.isfinite(table.point_m).all(1))
    normals = replace(table, point_m=np.nan_to_num(table.normal))  # in the slots of their points
    felt, _ = normals.sets(len(fit.normal), contact)
    mean = (fit.weight[..., None] * felt).sum(1)
    return mean / np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-12)


def _bow(exploration: PlanarExploration, rows: np.ndarray) -> np.ndarray:
    """Sagittas of h = a + b u + c v + d u^2 + e v^2 over the touches that face outwards.

    `rows` (row,) are worlds; shape (row, 2).
    """
    table, axes = exploration.touches, exploration.axes
    facing = (table.normal * axes[table.world, 2]).sum(1) > np.cos(_FACING_RAD)
    points, mask = (values[rows] for values in table.sets(len(axes), facing))
    axes = axes[rows]
    count = np.maximum(mask.sum(1), 1)[:, None, None]
    centred = (points - (points * mask[..., None]).sum(1, keepdims=True) / count) * mask[..., None]
    u, v, h = np.moveaxis(np.einsum("wpi,wki->wpk", centred, axes), 2, 0)
    reach = np.stack([np.abs(u).max(1), np.abs(v).max(1)], 1) + 1e-6
    u, v = u / reach[:, :1], v / reach[:, 1:]
    terms = np.stack([mask * 1.0, u, v, u**2, v**2], 2)
    normal = np.einsum("wpi,wpj->wij", terms, terms) + 1e-6 * np.eye(5)
    return np.linalg.solve(normal, np.einsum("wpi,wp->wi", terms, h)[..., None])[:, 3:, 0]


def angle_between(one: Face, other: Face) -> tuple[np.ndarray, np.ndarray]:
    """Angle between the outward normals of two faces and its standard deviation [rad], (world,).

    For neighbours on a block 90 degrees; the angle inside the body is pi less this.
    """
    cosine = np.clip((one.normal * other.normal).sum(1), -1.0, 1.0)
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 1e-12))
    variance = _tip_variance(one.fit, other.normal) + _tip_variance(other.fit, one.normal)
    return np.arccos(cosine), np.sqrt(variance) / sine


def _tip_variance(fit: PlaneFit, way: np.ndarray) -> np.ndarray:
    """Variance of the normal along `way`: a turn about u tips it along v, one about v along u."""
    along_u = (fit.axes[:, 0] * way).sum(1)
    along_v = (fit.axes[:, 1] * way).sum(1)
    return fit.covariance[:, 0, 0] * along_v**2 + fit.covariance[:, 1, 1] * along_u**2
