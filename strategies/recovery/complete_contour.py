"""A contour that was followed only part of the way, completed by all else that was felt.

Where a cone overhangs, the hand cannot follow the contour past it; where the object is thin below,
the fingers may miss it at first. What grasps felt there is evidence as well: a surface of
revolution fitted to all touches stands for such a contour.
"""

from dataclasses import replace

import numpy as np

from fit.arrays import row_sums, rows_of, with_rows
from fit.fit_status import is_fitted
from fit.revolution.fit import fit_revolution
from fit.revolution.geometry import RevolutionBody
from fit.revolution.record import RevolutionFit, RevolutionOptions
from strategies.poses.waypoints import BoundingCylinder
from strategies.procedures.contour_shape import Profile
from strategies.recovery.body_distances import contour_distances
from strategies.recovery.evidence import Evidence

OPTIONS = RevolutionOptions(nodes=10, upright=True, least_fall=1e-5)
COVERED = (0.3, 0.9)
"""A contour followed from below the first share of the height to above the second is left as it
is: fingers that must clear the table begin a little above it."""
FEWEST_TOUCHES = 4
"""Along a contour that counts as followed at all."""
FAR_M = 0.010
"""A touch farther than this from a body counts as this far."""


def revolution_of_all(evidence: Evidence, prior: BoundingCylinder) -> RevolutionFit:
    """Surfaces of revolution through all touches, standing on the table.

    Touches outside the prior cylinder by more than its error are not of this body: one alone would
    make it as tall.
    """
    x, y, z = np.moveaxis(evidence.points_m, -1, 0)
    away = np.hypot(x - prior.x_m[:, None], y - prior.y_m[:, None])
    near = ((away <= prior.radius_m[:, None] + prior.margin_m)
            & (z <= prior.height_m[:, None] + prior.margin_m))
    return fit_revolution(evidence.points_m, evidence.mask & near, table_z=0.0, options=OPTIONS)


def body_of_fit(fit: RevolutionFit) -> RevolutionBody:
    """The fitted bodies as nodes along their axes."""
    share = np.linspace(0.0, 1.0, fit.radius_m.shape[1])
    return RevolutionBody(fit.position_m, fit.axis, share * fit.height_m[:, None], fit.radius_m)


def revolution_misfit(fit: RevolutionFit, evidence: Evidence) -> np.ndarray:
    """Mean distance [m] of the touches from the surfaces, each capped, (world,); inf without fit.

    Measured as `strategies.recovery.misfit.touch_misfit` measures it for superquadrics.
    """
    away = np.minimum(contour_distances(body_of_fit(fit), evidence.points_m, evidence.mask), FAR_M)
    count = evidence.mask.sum(1)
    mean = row_sums(np.where(evidence.mask, away, 0.0)) / np.maximum(count, 1)
    return np.where(is_fitted(fit.status) & (count > 0), mean, np.inf)


def whole_profile(
    profile: Profile, evidence: Evidence, contour: np.ndarray, prior: BoundingCylinder
) -> Profile:
    """The profiles, those of broken contours replaced; `contour` (slot,) numbers their touches."""
    low, high = contour_span(profile, evidence, contour)
    followed = evidence.mask[:, contour].sum(1) >= FEWEST_TOUCHES
    rows = np.flatnonzero(followed & ((low > COVERED[0]) | (high < COVERED[1])))
    if len(rows) == 0:
        return profile
    fit = revolution_of_all(rows_of(evidence, rows), rows_of(prior, rows))
    body = body_of_fit(fit)
    good = is_fitted(fit.status)
    rows, body = rows[good], body[good]
    width = max(profile.height_m.shape[1], body.height_m.shape[1])

    def widened(nodes: np.ndarray) -> np.ndarray:
        return np.pad(nodes, ((0, 0), (0, width - nodes.shape[1])), constant_values=np.nan)

    wide = replace(profile, height_m=widened(profile.height_m), radius_m=widened(profile.radius_m))
    return with_rows(wide, rows, Profile(
        body.foot_m, body.axis, widened(body.height_m), widened(body.radius_m),
        fit.volume_m3[good], body.radius_m.max(1), fit.height_m[good], fit.rms_m[good],
        rows_of(profile.fit, rows)))


def contour_span(
    profile: Profile, evidence: Evidence, contour: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """From where to where the contour was felt, as shares of the height felt at all, (world,)."""
    known = np.isfinite(profile.volume_m3)[:, None]
    foot = np.where(known, profile.foot_m, 0.0)
    t = np.einsum("wpi,wi->wp", evidence.points_m - foot[:, None],
                  np.where(known, profile.axis, [0.0, 0.0, 1.0]))
    own = evidence.mask[:, contour]
    low = np.where(own, t[:, contour], np.inf).min(1, initial=np.inf)
    high = np.where(own, t[:, contour], -np.inf).max(1, initial=-np.inf)
    # Some touches are no touches of the body at all: the highest but for one in twenty.
    felt = np.sort(np.where(evidence.mask, t, np.inf), axis=1)
    last = np.maximum(np.ceil(0.95 * evidence.mask.sum(1)).astype(int) - 1, 0)
    top = felt[np.arange(len(felt)), last]
    height = np.maximum(np.where(np.isfinite(top), np.maximum(top, high), 1.0), 1e-6)
    return low / height, high / height
