"""How uncertain a recovered body is: the one calibrated uncertainty of budgets, planners and rows.

To first order in the body's parameters, from the contacts' own spread and from the errors that they
share (`shared_errors`), and beside it what no covariance of parameters holds: where nothing was
felt the surface may lie off any superquadric or contour, in proportion to the distance to the
nearest contact, and rather outside, since fits take the smallest body that explains the contacts.
Contacts that contradict the body tell that the model is not adequate. The three factors are
calibrated on simulated episodes (`docs/fit.md`).
"""

from dataclasses import fields, replace

import numpy as np

from fit.arrays import row_sums
from fit.revolution.geometry import RevolutionBody, revolution_surface, revolution_volume
from fit.superquadric.geometry import Superquadric, superquadric_areas
from fit.superquadric.uncertainty import (
    SuperquadricUncertainty,
    superquadric_uncertainty,
    surface_distance,
    surface_std,
)
from strategies.contacts.felt import Felt, packed, unfelt_distance
from strategies.contacts.finger_touch import TouchedLinks
from strategies.contacts.shared_errors import shared_shifts
from warpgrasp.parameters import ArmTable, ErrorTable

OUTSIDE = 0.10
"""By how much the true surface lies outside the recovered one, of the distance to a contact."""
SPREAD = 0.12
"""Standard deviation of that."""
CONTRADICTED_SPREAD = 1.5
"""Standard deviation of the logarithm of the volume, of the share of contradicted contacts."""
CONTRADICTED_SPREAD_M = 0.02
"""The same of a place of the surface [m]."""
INADEQUATE_FROM = 0.12
"""Share of contradicted contacts from which on the body's model is not adequate [est]."""
TOUCH_SIGMA_M = 0.001
"""Spread of one touch of a pad about a contour [est]."""
_PACK = 64
_SURFACE_POINTS = 216


def calibrated_uncertainty(
    body: Superquadric, turned: RevolutionBody | None, is_turned: np.ndarray, felt: Felt,
    links: TouchedLinks, errors: ErrorTable, arm: ArmTable,
) -> SuperquadricUncertainty:
    """Uncertainty of each world's body from its own contacts alone.

    Volumes are those of `turned` where `is_turned` (world,), bool; covariances always those of the
    superquadric's parameters. Contacts are packed to a number of slots that depends on the world's
    own count: sums over more empty slots, for a neighbour's sake, would round otherwise.
    """
    worlds = len(felt.mask)
    slots = -(-np.maximum(felt.mask.sum(1), 1) // _PACK) * _PACK
    found: dict[str, np.ndarray] = {}
    for width in np.unique(slots):
        rows = np.flatnonzero(slots == width)
        some, stood = packed(felt, links, rows, int(width))
        part = _of_superquadrics(Superquadric(*(field[rows] for field in body)), some, stood,
                                 errors, arm)
        those = np.flatnonzero(is_turned[rows])
        if turned is not None and len(those):
            part = _with_contours(part, those, turned[rows[those]], some, stood, errors, arm)
        for f in fields(SuperquadricUncertainty):
            values = getattr(part, f.name)
            whole = found.setdefault(f.name, np.zeros((worlds, *values.shape[1:]), values.dtype))
            whole[rows] = values
    return SuperquadricUncertainty(**found)


def surface_spread(
    body: Superquadric, uncertainty: SuperquadricUncertainty, felt: Felt, points_m: np.ndarray
) -> np.ndarray:
    """Standard deviation [m] of the surface along its normal, at or near points (world, point, 3),
    what was not felt included."""
    away = np.hypot(OUTSIDE, SPREAD) * unfelt_distance(points_m, felt)
    model = CONTRADICTED_SPREAD_M * felt.contradicted_share()[:, None]
    return np.sqrt(surface_std(body, uncertainty, points_m) ** 2 + away**2 + model**2)


def _of_superquadrics(
    body: Superquadric, felt: Felt, links: TouchedLinks, errors: ErrorTable, arm: ArmTable
) -> SuperquadricUncertainty:
    _, normal = surface_distance(body, felt.points_m)
    shared = shared_shifts(links, felt.points_m, normal, errors, arm)
    known = superquadric_uncertainty(body, felt.points_m, felt.mask, table_z=0.0,
                                     covariance=felt.covariance_m2, shared_m=shared)
    points, area = superquadric_areas(body, _SURFACE_POINTS)
    unfelt = row_sums(area * unfelt_distance(points, felt)) / known.volume_m3
    return replace(known, log_volume_shift=OUTSIDE * unfelt,
                   log_volume_std=_widened(known.log_volume_std, unfelt, felt))


def _with_contours(
    known: SuperquadricUncertainty, rows: np.ndarray, body: RevolutionBody, felt: Felt,
    links: TouchedLinks, errors: ErrorTable, arm: ArmTable
) -> SuperquadricUncertainty:
    """`known`, the volumes of `rows` replaced by those of contours."""
    felt = Felt(*(getattr(felt, f.name)[rows] for f in fields(Felt)))
    links = replace(links, **{f.name: getattr(links, f.name)[rows] for f in fields(links)
                              if isinstance(getattr(links, f.name), np.ndarray)})
    arm_m = felt.points_m - body.foot_m[:, None]
    across = arm_m - np.einsum("wpi,wi->wp", arm_m, body.axis)[..., None] * body.axis[:, None]
    outward = across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9)
    # Radii are means of the touches around them, and so are their errors.
    own = felt.mask & ~links.linked
    counted = np.where(own.any(1, keepdims=True), own, felt.mask)
    count = np.maximum(counted.sum(1), 1)
    shared = shared_shifts(links, felt.points_m, outward, errors, arm) * counted[..., None]
    radius = np.linalg.norm(shared.sum(1) / count[:, None], axis=-1)
    points, _, area = revolution_surface(body)
    volume = revolution_volume(body)
    side = row_sums(area) / volume
    unfelt = row_sums(area * unfelt_distance(points, felt)) / volume
    std = np.hypot(side * radius, side * TOUCH_SIGMA_M / np.sqrt(count))
    values = {"volume_m3": volume, "log_volume_shift": OUTSIDE * unfelt,
              "log_volume_std": _widened(std, unfelt, felt)}
    out = {name: getattr(known, name).copy() for name in values}
    for name, part in values.items():
        out[name][rows] = part
    return replace(known, **out)


def _widened(std: np.ndarray, unfelt: np.ndarray, felt: Felt) -> np.ndarray:
    return np.sqrt(std**2 + (SPREAD * unfelt) ** 2
                   + (CONTRADICTED_SPREAD * felt.contradicted_share()) ** 2)
