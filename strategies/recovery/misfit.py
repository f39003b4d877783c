"""Rival bodies: where touches lie far from the body fitted, another residual is asked as well.

Solina's residual and its like multiply by the volume, which prefers the smallest body that explains
the touches; with few or crowded touches a body shrunk to a needle, which costs nothing however far
from the touches it lies, may win. The radial residual has no such factor and does not shrink, but
errs elsewhere. So where a body is doubted it is tried from scratch, and what lies nearer to the
touches stays.
"""

import numpy as np

from fit.arrays import row_sums
from fit.fit_status import FitStatus
from fit.superquadric.record import SuperquadricFit
from strategies.recovery.body_distances import surface_distances
from strategies.recovery.evidence import Evidence

RIVAL = "radial"
"""Residual tried where a body is doubted; see `fit.superquadric.field`."""
DOUBTED_M = 0.0015
"""Mean distance of the touches from which a body is doubted; noise alone leaves 0.8 mm [est]."""
UNBELIEVED_M = 0.006
"""The same from which a body is not believed at all: a needle among its touches [est]."""
CLEARLY = 0.95
"""A rival must come this much nearer."""
FARTHEST_M = 0.010
"""A touch farther than this counts as this far: some are no touches of the body at all."""


def touch_misfit(fits: SuperquadricFit, placed: Evidence) -> np.ndarray:
    """Mean distance [m] of each world's touches from its body, each capped, (world,); inf where
    there is no usable fit."""
    distance, _ = surface_distances(fits, placed.points_m, placed.mask, ahead_m=0.0)
    away = np.minimum(np.abs(distance), FARTHEST_M)
    count = placed.mask.sum(1)
    mean = row_sums(np.where(placed.mask, away, 0.0)) / np.maximum(count, 1)
    good = np.isin(fits.status, (FitStatus.converged, FitStatus.not_converged)) & (count > 0)
    return np.where(good, mean, np.inf)
