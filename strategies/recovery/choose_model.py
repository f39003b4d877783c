"""The body an episode ends with: superquadric, contour of revolution, or only the prior."""

from dataclasses import dataclass, fields
from enum import IntEnum

import numpy as np

from fit.arrays import row_sums, rows_of
from fit.revolution.geometry import RevolutionBody
from fit.superquadric.geometry import Superquadric, SuperquadricLike
from strategies.poses.waypoints import BoundingBox, BoundingCylinder
from strategies.procedures.contour_shape import Profile
from strategies.recovery.body_distances import contour_distances, surface_distances
from strategies.recovery.evidence import Evidence
from strategies.recovery.plausibility import plausible_contour
from warpgrasp.parameters import FitTable

FEWEST_NODES = 4
"""Of a contour that is to stand for a body."""
FEWEST_TOUCHES = 4
"""Along it."""
PREFERENCE = 0.8
"""The contour must come this much nearer to the touches than the superquadric, whose parameters
are fewer; on a cylinder, where both do, the superquadric stays."""
CONTRADICTS_M = 0.010
"""Contacts farther than this from a contour do not belong to it."""
MOST_STRAYED = 0.1
LARGEST_RESIDUAL_M = 0.05
OF_A_SUPERQUADRIC, OF_A_NODE, OF_A_LINE = 11, 2, 4
"""Parameters: of sizes, exponents, place and turn; of a contour's node, and of its axis."""


class Shape(IntEnum):
    """Which model stands for a world's body."""

    PRIOR = 0
    SUPERQUADRIC = 1
    REVOLUTION = 2


@dataclass(frozen=True)
class Recovered:
    """A batch of recovered bodies; `shape` says which of the two models counts in a world."""

    shape: np.ndarray
    """`Shape`, (world,)."""
    superquadric: Superquadric
    """The fit, or the prior."""
    revolution: RevolutionBody | None = None

    def __len__(self) -> int:
        return len(self.shape)


def superquadric_of(fits: SuperquadricLike) -> Superquadric:
    """The bodies of fits."""
    return Superquadric(*(getattr(fits, name) for name in Superquadric._fields))


def same_bodies(one: Recovered, other: Recovered) -> np.ndarray:
    """Whether the bodies of each world are bit-identical, bool (world,)."""
    same = one.shape == other.shape
    for a, b in zip(one.superquadric, other.superquadric, strict=True):
        same &= (a == b).all(1)
    turned = np.flatnonzero(same & (one.shape == Shape.REVOLUTION))
    if one.revolution is None or other.revolution is None:
        same[turned] = one.revolution is other.revolution
    else:
        for f in fields(RevolutionBody):
            a, b = (getattr(body, f.name)[turned] for body in (one.revolution, other.revolution))
            kept = min(a.shape[1], b.shape[1])
            same[turned] &= ((a[:, :kept] == b[:, :kept]) | np.isnan(a[:, :kept])).all(1)
            same[turned] &= (np.isfinite(a).sum(1) == np.isfinite(b).sum(1))
    return same


def revolution_of(profile: Profile) -> RevolutionBody:
    """The body of a recovered contour."""
    return RevolutionBody(profile.foot_m, profile.axis, profile.height_m, profile.radius_m)


def choose_body(
    fitted: np.ndarray, superquadric: Superquadric, profile: Profile | None, evidence: Evidence,
    contour: np.ndarray, prior: BoundingCylinder, table: FitTable
) -> Recovered:
    """The model of each world; `contour` (slot,) numbers the evidence's touches along contours, and
    `table` says what else may contradict them.

    A contour is taken where it explains those touches clearly better than the superquadric that
    was fitted to everything (on a block it does not, however the fingers pinched it), and where the
    rest of the evidence does not contradict it: a contour that was broken off half way up leaves
    contacts above it. One that is not plausible is never taken.
    """
    shape = np.where(fitted, Shape.SUPERQUADRIC, Shape.PRIOR)
    if profile is None:
        return Recovered(shape, superquadric)
    body = revolution_of(profile)
    mask = evidence.mask[:, contour]
    nodes = np.isfinite(body.height_m).sum(1)
    known = (nodes >= FEWEST_NODES) & (mask.sum(1) >= FEWEST_TOUCHES)
    known &= np.isfinite(profile.volume_m3) & plausible_contour(
        body, evidence, prior, table_plane=table.table_plane, free_space=table.free_space)
    rows = np.flatnonzero(known)
    felt = evidence.mask[rows]
    away = contour_distances(body[rows], evidence.points_m[rows], felt)
    other = surface_distances(
        rows_of(superquadric, rows), evidence.points_m[rows][:, contour], mask[rows])[0]
    better = _rms(away[:, contour], mask[rows]) < PREFERENCE * _rms(np.abs(other), mask[rows])
    strayed = (felt & (away > CONTRADICTS_M)).sum(1) / np.maximum(felt.sum(1), 1)
    taken = (better & (strayed <= MOST_STRAYED)) | ~fitted[rows]
    shape[rows[taken]] = Shape.REVOLUTION
    return Recovered(shape, superquadric, body)


def _rms(distance: np.ndarray, mask: np.ndarray) -> np.ndarray:
    square = row_sums(np.where(mask, np.minimum(distance, LARGEST_RESIDUAL_M) ** 2, 0.0))
    return np.sqrt(square / np.maximum(mask.sum(1), 1))


def parameter_count(recovered: Recovered, table: FitTable) -> int:
    """Parameters of the model that stands for the first world, numbers that touches had to find;
    those of superquadrics are the same in all."""
    if recovered.shape[0] == Shape.REVOLUTION and recovered.revolution is not None:
        nodes = int(np.isfinite(recovered.revolution.height_m[0]).sum())
        return OF_A_NODE * nodes + OF_A_LINE
    return OF_A_SUPERQUADRIC + 2 * table.taper + 2 * table.bend


def prior_superquadric(prior: BoundingCylinder) -> Superquadric:
    """The prior as a superquadric: a cylinder, or the box where one is given."""
    zero = np.zeros((len(prior.x_m), 2))
    half, yaw, section = np.stack([prior.radius_m] * 2, 1), zero[:, 0], 1.0
    if isinstance(prior, BoundingBox):
        half, yaw, section = prior.half_m, prior.yaw_rad, 0.1
    return Superquadric(
        size_m=np.concatenate([half, prior.height_m[:, None] / 2], 1),
        exponents=np.tile([0.1, section], (len(zero), 1)),
        position_m=np.stack([prior.x_m, prior.y_m, prior.height_m / 2], 1),
        quaternion_xyzw=np.stack([*zero.T, np.sin(yaw / 2), np.cos(yaw / 2)], 1),
        taper=zero, bend=zero)


def or_prior(fits: SuperquadricLike, prior: BoundingCylinder, good: np.ndarray) -> Superquadric:
    """The good fits, and the prior in place of the others; `good` is bool (fit,)."""
    given = prior_superquadric(prior)
    return Superquadric(*(np.where(good[:, None], getattr(fits, name), getattr(given, name))
                          for name in Superquadric._fields))
