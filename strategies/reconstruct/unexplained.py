"""Where a recovered body does not explain what was felt, so that a free form may stand for it.

A free form passes near every contact, so contacts cannot choose between it and a model: they can
only contradict the model. Where they do not, the model stands, which knows more of what was not
felt. So it does where too little was felt for any form: a free form ends where contacts end.
"""

import numpy as np

from fit.arrays import row_sums
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.contact_verdict import surface_gaps
from strategies.recovery.evidence import Evidence
from strategies.recovery.misfit import FARTHEST_M

UNEXPLAINED_M = 0.002
"""Mean distance of contacts from a body that does not explain them [m] [est]."""


def unexplained(recovered: Recovered, evidence: Evidence) -> np.ndarray:
    """Worlds whose recovered body lies off its contacts, or which have none, bool (world,).

    Distances beyond `FARTHEST_M` count as that. `evidence` has contacts as placed on the bodies.
    """
    away = np.minimum(surface_gaps(recovered, evidence.points_m, evidence.mask), FARTHEST_M)
    count = np.maximum(evidence.mask.sum(1), 1)
    mean = row_sums(np.where(evidence.mask, away, 0.0)) / count
    return (recovered.shape == Shape.PRIOR_CYLINDER) | (mean > UNEXPLAINED_M)
