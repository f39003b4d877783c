"""The misfit of a body: the mean distance of the contacts from its surface.

Solina's residual is multiplied by the volume, so that it prefers the smallest body that explains
the contacts. With few contacts, or crowded ones, a body that has shrunk to a needle may have the
least residual although it lies far from them. The radial residual has no such factor. A body with
a large misfit is therefore fitted again with the radial residual, and the body that lies nearer to
the contacts is kept (`fit_contacts`).
"""

import numpy as np

from fit.arrays import row_sums
from fit.fit_status import is_fitted
from fit.superquadric.record import SuperquadricFit
from strategies.recovery.body_distances import surface_distances
from strategies.recovery.evidence import Evidence

RIVAL = "radial"
"""Residual of the second fit; see `fit.superquadric.field`."""
RIVALS_FROM_M = 0.0015
"""Misfit from which a second fit is made [m]; sensor noise alone leaves 0.8 mm [est]."""
UNBELIEVED_M = 0.006
"""Misfit from which a body is rejected as implausible [m] [est]."""
CLEARLY = 0.95
"""The second body replaces the first where its misfit is below this share of the first's."""
LEAST_MISFIT_M = 0.0008
"""Mean distance of contacts from a body that explains them: nearer ones tell nothing [est]."""
THINNEST_M = 0.0005
"""A body with a half axis below this is doubted whatever its misfit [m] [est]."""
FARTHEST_M = 0.010
"""Distances are capped here [m], since some contacts do not lie on the body at all."""


def touch_misfit(fits: SuperquadricFit, placed: Evidence) -> np.ndarray:
    """Mean capped distance [m] of the contacts of each world from its body, shape (world,).

    Infinite for a world without contacts or without a usable fit.
    """
    distance, _ = surface_distances(fits, placed.points_m, placed.mask)
    away = np.minimum(np.abs(distance), FARTHEST_M)
    count = placed.mask.sum(1)
    mean = row_sums(np.where(placed.mask, away, 0.0)) / np.maximum(count, 1)
    good = is_fitted(fits.status) & (count > 0)
    return np.where(good, mean, np.inf)


def doubt(fits: SuperquadricFit, placed: Evidence) -> np.ndarray:
    """The misfit [m], shape (world,), infinite for a body thinner than any that a hand explores: a
    sheet may pass near a crowd of contacts."""
    return np.where(fits.size_m.min(1) < THINNEST_M, np.inf, touch_misfit(fits, placed))


def schwarz(misfit_m: float, contacts: int, parameters: int, least_m: float) -> float:
    """Schwarz's criterion (1978), the less the better, with Laplace's distribution of distances:
    contacts lie `misfit_m` off in the mean; bodies nearer than `least_m` are told apart no more.
    """
    return (2.0 * contacts * float(np.log(max(misfit_m, least_m)))
            + parameters * float(np.log(contacts)))
