"""How uncertain a recovered body is: the one calibrated uncertainty of budgets, planners and rows.

Covariances are to first order in the body's parameters, from the contacts' own spread and from the
errors that they share (`shared_errors`). What no covariance of parameters holds, that the true
surface lies off any superquadric or contour, widens and shifts volumes by signs that the robot
knows (`volume_spread`), and places of a surface by how far the nearest contact is. Factors are
calibrated on simulated episodes (`docs/fit.md`).
"""

from collections.abc import Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

from fit.arrays import row_sums
from fit.revolution.geometry import RevolutionBody, revolution_surface, revolution_volume
from fit.superquadric.geometry import Superquadric, superquadric_areas
from fit.superquadric.uncertainty import (
    SuperquadricUncertainty,
    superquadric_uncertainty,
    surface_std,
)
from strategies.contacts.felt import FOOT_M, Felt, packed, unfelt_distance
from strategies.contacts.finger_touch import TouchedLinks
from strategies.contacts.shared_errors import shared_shifts
from strategies.contacts.volume_spread import FeltBy, VolumeSigns, spread_of_volumes
from strategies.poses.waypoints import BoundingCylinder
from warpgrasp.parameters import ArmTable, ErrorTable

OWN_OF_SURFACE = 0.5
"""Of the standard deviation of a place of the surface by the covariance of the parameters [est]."""
UNFELT = 0.27
"""By how much a place of the surface may lie off, of its distance to a contact, one standard
deviation [est]."""
OFF_M = 0.0012
"""The same where a contact is [est]."""
CONTRADICTED_SPREAD_M = 0.014
"""The same, of the share of contradicted contacts [m] [est]."""
INADEQUATE_FROM = 0.12
"""Share of contradicted contacts from which on the body's model is not adequate [est]."""
TOUCH_SIGMA_M = 0.001
"""Spread of one touch of a pad about a contour [est]."""
END_M = 0.004
"""A touch nearer than this to the upper end of a contour may be one of the end."""
LEAST_M3 = 1e-12
"""A smaller volume counts as this one."""
_PACK = 64
_SURFACE_POINTS = 216


@dataclass(frozen=True)
class BodyUncertainty(SuperquadricUncertainty):
    """Uncertainty of recovered bodies, one a world."""

    signs: VolumeSigns
    """What the spread of the volumes goes by."""


def parameter_uncertainty(
    body: Superquadric, felt: Felt, links: TouchedLinks, errors: ErrorTable, arm: ArmTable, *,
    table_plane: bool = True
) -> SuperquadricUncertainty:
    """Uncertainty of the parameters of each world's superquadric from its own contacts and, if
    `table_plane`, from the table on which it is known to stand.

    Contacts are packed to a number of slots that depends on the world's own count: sums over more
    empty slots, for a neighbour's sake, would round otherwise.
    """
    worlds = len(felt.mask)
    known = {f.name: np.zeros((worlds, *(15, 15) * (f.name == "covariance")))
             for f in fields(SuperquadricUncertainty)}
    for width, rows in _by_slots(felt):
        some, stood = packed(felt, links, rows, width)
        part = _of_superquadrics(Superquadric(*(field[rows] for field in body)), some, stood,
                                 errors, arm, table_plane)
        for name, values in known.items():
            values[rows] = getattr(part, name)
    return SuperquadricUncertainty(**known)


def calibrated_uncertainty(
    body: Superquadric, parameters: SuperquadricUncertainty, turned: RevolutionBody | None,
    is_turned: np.ndarray, felt: Felt, links: TouchedLinks, errors: ErrorTable, arm: ArmTable,
    prior: BoundingCylinder,
) -> BodyUncertainty:
    """Uncertainty of each world's body from its own contacts, from the `parameter_uncertainty` of
    its superquadric, and from the prior that was given.

    Volumes are those of `turned` where `is_turned` (world,), bool; covariances always those of the
    superquadric's parameters.
    """
    known = {f.name: getattr(parameters, f.name).copy() for f in fields(SuperquadricUncertainty)}
    contours = np.flatnonzero(is_turned) if turned is not None else np.zeros(0, int)
    if turned is not None:
        for width, rows in _by_slots(felt):
            those = np.flatnonzero(np.isin(rows, contours))
            if len(those):
                some, stood = packed(felt, links, rows, width)
                known["log_volume_std"][rows[those]] = _of_contours(
                    turned[rows[those]], those, some, stood, errors, arm)
        known["volume_m3"][contours] = revolution_volume(turned[contours])
    signs = _signs(body, turned, contours, felt, prior, known)
    shift, std = spread_of_volumes(signs)
    return BodyUncertainty(**known | {"log_volume_shift": shift, "log_volume_std": std},
                           signs=signs)


def _by_slots(felt: Felt) -> Iterator[tuple[int, np.ndarray]]:
    """Numbers of slots, and the worlds whose contacts are packed to as many."""
    slots = -(-np.maximum(felt.mask.sum(1), 1) // _PACK) * _PACK
    for width in np.unique(slots):
        yield int(width), np.flatnonzero(slots == width)


def surface_spread(
    body: Superquadric, uncertainty: SuperquadricUncertainty, felt: Felt, points_m: np.ndarray
) -> np.ndarray:
    """Standard deviation [m] of the surface along its normal, at or near points (world, point, 3),
    what was not felt included."""
    own = OWN_OF_SURFACE * surface_std(body, uncertainty, points_m)
    away = UNFELT * unfelt_distance(points_m, felt)
    model = CONTRADICTED_SPREAD_M * felt.contradicted_share()[:, None]
    return np.sqrt(own**2 + away**2 + model**2 + OFF_M**2)


def _of_superquadrics(
    body: Superquadric, felt: Felt, links: TouchedLinks, errors: ErrorTable, arm: ArmTable,
    table_plane: bool
) -> SuperquadricUncertainty:
    return superquadric_uncertainty(
        body, felt.points_m, felt.mask, table_z=0.0 if table_plane else None,
        covariance=felt.covariance_m2,
        shared_m=lambda normal: shared_shifts(links, felt.points_m, normal, errors, arm))


def _of_contours(
    body: RevolutionBody, rows: np.ndarray, felt: Felt, links: TouchedLinks, errors: ErrorTable,
    arm: ArmTable
) -> np.ndarray:
    """Standard deviation of the logarithm of the volume of contours, of the worlds `rows`, by their
    touches and the errors that these share."""
    felt = Felt(*(getattr(felt, f.name)[rows] for f in fields(Felt)))
    links = replace(links, **{f.name: getattr(links, f.name)[rows] for f in fields(links)
                              if isinstance(getattr(links, f.name), np.ndarray)})
    arm_m = felt.points_m - body.foot_m[:, None]
    along = np.einsum("wpi,wi->wp", arm_m, body.axis)
    across = arm_m - along[..., None] * body.axis[:, None]
    outward = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    # Radii are means of the touches around them, and so are their errors. Touches of the flat end
    # say nothing of radii.
    below = along < np.nanmax(body.height_m, axis=1, keepdims=True) - END_M
    counted = felt.mask & ~links.linked & below
    for others in (felt.mask & ~links.linked, felt.mask):
        counted = np.where(counted.any(1, keepdims=True), counted, others)
    count = np.maximum(counted.sum(1), 1)
    shared = shared_shifts(links, felt.points_m, outward, errors, arm) * counted[..., None]
    radius = np.linalg.norm(shared.sum(1) / count[:, None], axis=-1)
    _, _, area = revolution_surface(body)
    side = row_sums(area) / revolution_volume(body)
    return side * np.hypot(radius, TOUCH_SIGMA_M / np.sqrt(count))


def _signs(
    body: Superquadric, turned: RevolutionBody | None, contours: np.ndarray, felt: Felt,
    prior: BoundingCylinder, known: dict[str, np.ndarray]
) -> VolumeSigns:
    volume = np.maximum(known["volume_m3"], LEAST_M3)
    # Of the cylinder about a box, too: factors were fitted with cylinders.
    given = np.maximum(np.pi * prior.radius_m**2 * prior.height_m, LEAST_M3)
    points, area = superquadric_areas(body, _SURFACE_POINTS)
    top = points[..., 2].max(1)
    unfelt = row_sums(area * unfelt_distance(points, felt)) / volume
    felt_by = np.where((felt.by_pad & felt.mask).any(1), FeltBy.PADS, FeltBy.GRASPS)
    if turned is not None and len(contours):
        felt_by[contours] = FeltBy.CONTOUR
        top[contours] = revolution_surface(turned[contours])[0][..., 2].max(1)
        unfelt[contours] = 0.0
    return VolumeSigns(
        felt_by=felt_by, own_std=known["log_volume_std"], unfelt=unfelt,
        contradicted=felt.contradicted_share(),
        missing=np.maximum(prior.height_m / np.maximum(top, FOOT_M) - 1.0, 0.0),
        empty=np.maximum(np.log(given / volume), 0.0))
