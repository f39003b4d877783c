"""The body that a planner uses with few contacts: contacts and prior in one fit.

A superquadric fitted to the contacts of a grasp or two may lie anywhere beside them, and the prior
cylinder alone stays in its place however clearly contacts contradict it. Therefore points of the
prior's surface join the contacts, with the uncertainty of the prior: they count where there
are no touches yet, and no more where there are.
"""

from dataclasses import replace
from math import pi

import numpy as np

from fit.arrays import rows_of
from fit.fit_status import is_fitted
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.record import SuperquadricOptions
from strategies.poses.waypoints import BoundingCylinder
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import or_prior
from strategies.recovery.misfit import touch_misfit
from strategies.recovery.plausibility import within_reach

TRUSTED_FROM = 32
"""Contacts from which a fit to them alone is the better guide [est]."""
DISTRUSTED_M = 0.003
"""A fit whose touches lie this far off in the mean is no guide [est]."""
SIGMA_OF_MARGIN = 0.5
"""Standard deviation of a point on the prior cylinder, of its margin: a third of that is the error
of the prior, the rest allows for bodies that are not cylinders [est]."""
LEAST_RADIUS_M = 0.010
_AROUND, _LEVELS = 8, 3
_OPTIONS = SuperquadricOptions(taper=True, residual="radial", loss="cauchy", upright_starts=True,
                               iterations=12)


def planning_belief(
    belief: Belief, larger_m: np.ndarray | float = 0.0
) -> tuple[Belief, np.ndarray]:
    """The belief with a body that is a guide to where touches will be found, in every world, and
    in which worlds that is the fit to touches alone, bool (world,).

    `larger_m` (world,) is added to the radius (or half sides) and the height of the prior.
    """
    evidence, prior = belief.evidence, belief.prior
    prior = prior.larger(larger_m, LEAST_RADIUS_M)
    count = evidence.mask.sum(1)
    trusted = (belief.fitted & (count >= TRUSTED_FROM))
    if trusted.any():
        trusted &= touch_misfit(belief.fits, evidence) < DISTRUSTED_M
    body = or_prior(belief.body, prior, trusted)
    rows = np.flatnonzero(~trusted & (count > 0) & belief.active)
    if len(rows) == 0:
        return replace(belief, body=body), trusted
    prior = rows_of(prior, rows)
    points = prior_surface(prior)
    spread = np.tile((SIGMA_OF_MARGIN * prior.margin_m)**2 * np.eye(3), (*points.shape[:2], 1, 1))
    fits = fit_superquadric(
        np.concatenate([evidence.points_m[rows], points], 1),
        np.concatenate([evidence.mask[rows], np.ones(points.shape[:2], bool)], 1),
        covariance=np.concatenate([evidence.covariance_m2[rows], spread], 1), table_z=0.0,
        free_points=evidence.free_m[rows], free_radius=evidence.free_radius_m,
        free_mask=evidence.free_mask[rows], options=_OPTIONS)
    good = is_fitted(fits.status)
    guide = or_prior(fits, prior, good & within_reach(fits, prior))
    for whole, part in zip(body, guide, strict=True):
        whole[rows] = part
    return replace(belief, body=body), trusted


def prior_surface(prior: BoundingCylinder) -> np.ndarray:
    """Points on sides and top of prior cylinders, (world, point, 3) [m]."""
    angle = 2 * pi * np.arange(_AROUND) / _AROUND
    share = np.concatenate([np.repeat((np.arange(_LEVELS) + 0.5) / _LEVELS, _AROUND),
                            np.ones(1 + _AROUND // 2)])
    out = np.concatenate([np.ones(_LEVELS * _AROUND), [0.0], np.full(_AROUND // 2, 0.6)])
    angle = np.concatenate([np.tile(angle, _LEVELS), [0.0], angle[::2]])
    return np.stack([
        prior.x_m[:, None] + prior.radius_m[:, None] * out * np.cos(angle),
        prior.y_m[:, None] + prior.radius_m[:, None] * out * np.sin(angle),
        prior.height_m[:, None] * share], -1)
