"""How many iterations a plain fit of 13 parameters takes: Solina's residual, nothing else."""

import time

import numpy as np

from fit.optimize.batch import take
from fit.optimize.multistart import Problem, advance
from fit.prepare import prepare
from fit.superquadric.descent import begin_starts
from fit.superquadric.parameter_vector import Form
from fit.superquadric.record import SuperquadricOptions
from fit.superquadric.residuals import normal_equations

SETTLED = 1.01
"""Iterations count until the cost is below this multiple of its last value."""
FEWEST = 14
"""Contacts; with fewer there are as many parameters as residuals."""
_ITERATIONS = 60
_SCREENED = 5  # iterations of every start, of which the best continues


def iterations_of(points_m: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, float]:
    """Iterations of the best start, (set,), NaN with too few contacts, and the time of 20 [s].

    `points_m` (set, point, 3) and `mask` (set, point).
    """
    iterations = np.full(len(mask), np.nan)
    enough = np.flatnonzero(mask.sum(1) >= FEWEST)
    if len(enough) == 0:
        return iterations, float("nan")
    options = SuperquadricOptions(taper=True, residual="solina", mean_exponent=None, prior=0.0)
    form = Form(True, False, "solina", "none")
    problem = Problem(lambda t, lane: normal_equations(t, lane, form), f"{form}")
    seconds = float("nan")
    for rows, sets in prepare(points_m[enough], mask[enough]).buckets():
        lanes, theta = begin_starts(sets, form, options)
        fits, starts = theta.shape[:2]
        moved = advance(problem, theta.reshape(fits * starts, -1), lanes, _SCREENED)
        damping = np.asarray(moved.damping)
        best = np.asarray(moved.cost).reshape(fits, starts).argmin(1)
        pick = np.arange(fits) * starts + best
        lanes = take(lanes, pick)
        theta, damping = np.asarray(moved.theta)[pick], damping[pick]
        costs = [np.asarray(moved.cost)[pick]]
        begin = time.process_time()
        for _ in range(_ITERATIONS - _SCREENED):
            moved = advance(problem, theta, lanes, 1, damping)
            theta, damping = np.asarray(moved.theta), np.asarray(moved.damping)
            costs.append(np.asarray(moved.cost))
        seconds = (time.process_time() - begin) / fits / (_ITERATIONS - _SCREENED)
        cost = np.stack(costs, 1)
        iterations[enough[rows]] = _SCREENED + (cost > SETTLED * cost[:, -1:]).sum(1)
    return iterations, 20 * seconds
