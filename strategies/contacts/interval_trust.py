"""Whether the interval of a volume is of a kind that held as often as it says.

On the episodes that the factors of `volume_spread` were fitted on, intervals of 90 % held in 85 to
95 % of each kind but three: bodies that many contacts contradict, bodies of which hardly anything
was felt, and bodies that leave most of the prior empty, which may have shrunk between their
contacts. Those held in 66 to 81 %.
"""

import numpy as np

from strategies.contacts.volume_spread import FeltBy, VolumeSigns

CONTRADICTED_FROM, EMPTY_FROM, UNFELT_FROM = 0.3, 1.5, 4.0
"""Signs of a body felt by grasps alone from which on its interval is not trusted [est]."""


def interval_trusted(signs: VolumeSigns) -> np.ndarray:
    """Whether an interval is of a kind that held, bool (world,); not where a sign is no number."""
    sound = ((signs.contradicted < CONTRADICTED_FROM) & (signs.empty < EMPTY_FROM)
             & (signs.unfelt < UNFELT_FROM))
    return (sound | (signs.felt_by != FeltBy.GRASPS)) & np.isfinite(signs.own_std)
