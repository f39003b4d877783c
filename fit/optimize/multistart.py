"""Many descents at once: starts screened, the best finished, lanes dropped as they are done.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from fit.fit_status import LEAST_FALL, FitStatus
from fit.optimize.batch import Program, map_lanes, take

GOING_ON = 0.1
"""Share of its last damping with which a descent goes on in a valley that it has found. To begin
anew from `solver.DAMPING` takes six iterations to come back to where it was."""
HELD_UP = 1e-3
"""Damping, in unit frames, whose largest curvatures are 1 to 17, with which a descent does not go
on but begins anew: it was held up by a kink rather than on its way."""
SHORTEST = 1e3
"""Damping, in unit frames, whose steps are so short that one which is refused leaves no doubt."""
NOTHING_LEFT = 1e-24
"""Cost, in unit frames, below which there is only rounding."""


class Problem(NamedTuple):
    """A least-squares problem of one fit and what descends it; one cached object."""

    function: Callable
    """Of (theta, lane): what `descend` needs of the problem."""
    descend: Callable
    """`solver.descend`."""
    name: str
    """All that the function closes over, in words."""


class Finished(NamedTuple):
    """Descents at their end, a row each."""

    theta: np.ndarray
    cost: np.ndarray
    iterations: np.ndarray
    status: np.ndarray


def advance(problem: Problem, theta, lanes: Any, iterations: int, damping=None) -> Any:
    """`solver.Descent` of every lane, `iterations` steps on."""
    damping = np.zeros(len(theta)) if damping is None else damping
    return map_lanes(_program(problem), theta, damping, lanes, shared=(np.int64(iterations),))


def screen(
    problem: Problem, theta, lanes: Any, iterations: int,
    badness: Callable = lambda theta, cost: cost,
) -> tuple[np.ndarray, np.ndarray]:
    """The best start of each fit: its index and where it has got to.

    theta is [fit, start, parameter], and `lanes` has a row for every start of every fit. After
    some iterations all but two starts are dropped; the better of these after as many again.
    `badness(theta, cost)` is what they are compared by.
    """
    n, starts = theta.shape[:2]
    tried = advance(problem, theta.reshape(n * starts, -1), lanes, iterations)
    rank = badness(tried.theta, tried.cost).reshape(n, starts)
    order = np.argsort(rank, axis=1, kind="stable")[:, :2]
    if order.shape[1] == 1:
        return order[:, 0], tried.theta
    pair = (np.arange(n)[:, None] * starts + order).ravel()
    again = advance(problem, tried.theta[pair], take(lanes, pair), iterations, tried.damping[pair])
    better = np.argmin(badness(again.theta, again.cost).reshape(n, 2), axis=1)
    row = np.arange(n)
    return order[row, better], again.theta.reshape(n, 2, -1)[row, better]


def finish(
    problem: Problem, theta, lanes: Any, damping=None, *, at_a_time: int, at_most: int,
    least_fall: float = LEAST_FALL,
) -> Finished:
    """Descents to their end, in rounds over the fits that still fall by `least_fall`.

    `damping` is that of the descents which led to `theta`; None, and they begin anew.
    """
    n = len(theta)
    damping = np.zeros(n) if damping is None else GOING_ON * damping
    damping[damping > HELD_UP] = 0.0
    theta, cost = theta.copy(), np.zeros(n)
    iterations = np.zeros(n, int)
    status = np.full(n, FitStatus.not_converged)
    left = np.arange(n)
    while len(left) and iterations.max() < at_most:
        moved = advance(problem, theta[left], take(lanes, left), at_a_time, damping[left])
        # A round whose steps were all refused tells nothing until they are short.
        refused = (moved.theta == theta[left]).all(axis=1) & (moved.damping < SHORTEST)
        theta[left], damping[left], cost[left] = moved.theta, moved.damping, moved.cost
        iterations[left] += at_a_time
        done = (moved.fallen < least_fall) & ~refused | (moved.cost < NOTHING_LEFT)
        status[left[done]] = FitStatus.converged
        left = left[~done]
    return Finished(theta, cost, iterations, status)


@lru_cache(maxsize=64)
def _program(problem: Problem) -> Program:
    return Program(f"descend {problem.name}", lambda theta, damping, lane, iterations:
                   problem.descend(problem.function, theta, damping, iterations, lane))
