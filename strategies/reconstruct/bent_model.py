"""Superquadrics that bend, where contacts ask for it: most objects do not.

A bend is two parameters more, which few contacts would bend for their noise. So a bent body is
fitted beside a straight one that lies off its contacts, with contacts placed on it in turn, and
replaces that where contacts come clearly nearer and Schwarz's criterion (1978) grants the
parameters.
"""

from dataclasses import replace

import numpy as np

from fit.arrays import rows_of, with_rows
from strategies.recovery.belief import Belief, read_only
from strategies.recovery.choose_model import (
    PREFERENCE,
    Recovered,
    Shape,
    parameter_count,
    superquadric_of,
)
from strategies.recovery.fit_contacts import recover_bodies
from strategies.recovery.misfit import (
    LEAST_MISFIT_M,
    RIVALS_FROM_M,
    UNBELIEVED_M,
    schwarz,
    touch_misfit,
)
from strategies.recovery.plausibility import FEWEST_CONTACTS, plausible, swept, within_reach


def with_bends(belief: Belief, recovered: Recovered, wanted: np.ndarray
               ) -> tuple[Belief, Recovered]:
    """Beliefs and bodies, bent in those of the worlds `wanted`, bool (world,), whose superquadric
    lies off its contacts where a bent one does clearly less."""
    table = belief.fit
    misfit = touch_misfit(belief.fits, belief.evidence)
    rows = np.flatnonzero(
        wanted & (recovered.shape == Shape.SUPERQUADRIC) & (misfit > RIVALS_FROM_M)
        & (belief.evidence.mask.sum(1) >= FEWEST_CONTACTS))
    if table.bend or belief.unplaced is None or len(rows) == 0:
        return belief, recovered
    bent = replace(table, bend=True)
    felt = rows_of(belief.unplaced, rows)
    intrinsic = belief.sensors.contact_estimator == "intrinsic"
    fits, placed = recover_bodies(felt, rows_of(belief.links, rows) if intrinsic else None, bent)
    found = Recovered(np.full(len(rows), Shape.SUPERQUADRIC), superquadric_of(fits))
    prior, near = rows_of(belief.prior, rows), touch_misfit(fits, placed)
    taken = ((near < np.minimum(PREFERENCE * misfit[rows], UNBELIEVED_M))
             & within_reach(fits, prior) & plausible(fits, prior, table_plane=table.table_plane))
    if table.free_space:
        taken &= ~swept(fits, replace(placed, free_m=felt.free_m, free_mask=felt.free_mask))
    for k in np.flatnonzero(taken):
        count = int(placed.mask[k].sum())
        one, other = (schwarz(float(off), count, parameter_count(found, kind),
                              LEAST_MISFIT_M)
                      for off, kind in ((misfit[rows[k]], table), (near[k], bent)))
        taken[k] = other < one
    mine = rows[taken]
    if len(mine) == 0:
        return belief, recovered
    fits, bodies = fits[taken], rows_of(found.superquadric, np.flatnonzero(taken))
    believed = replace(
        belief, fits=with_rows(belief.fits, mine, fits), body=with_rows(belief.body, mine, bodies),
        evidence=with_rows(belief.evidence, mine, rows_of(placed, np.flatnonzero(taken))))
    return read_only(believed), replace(
        recovered, superquadric=with_rows(recovered.superquadric, mine, bodies))
