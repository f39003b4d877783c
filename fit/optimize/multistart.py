"""Multistart descents in batch: screen the starts, finish the best, drop lanes that are done."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from fit.fit_status import LEAST_FALL, FitStatus
from fit.optimize.batch import Program, map_lanes, take
from fit.optimize.solver import descend

DAMPING_REUSE = 0.1
"""Fraction of its last damping with which a descent resumes. A restart from `solver.DAMPING` takes
six iterations to recover."""
MAX_REUSED_DAMPING = 1e-3
"""Damping above which a descent restarts instead: it was stuck at a kink. In unit frames, whose
largest curvatures are 1 to 17."""
CONCLUSIVE_DAMPING = 1e3
"""Damping, in unit frames, whose steps are so short that rejecting one proves convergence."""
MIN_COST = 1e-24
"""Cost, in unit frames, below which only rounding is left."""


class Problem(NamedTuple):
    """A least-squares problem; its function is the same object in every call, for caching."""

    function: Callable
    """Of (theta, lane): the `NormalEquations` of one fit; of (theta, lane, span, choice) if
    `by_point`."""
    name: str
    """States all that the function closes over."""
    by_point: tuple[str, ...] = ()
    """Fields of a lane with a value for each point on their last axis. The function gets them as
    [slot, ..., point of a piece], to sum over those of its `pieces.Span`."""
    choice: int = 0
    """A number that the function gets at run time: problems that differ by it share a program."""


class Solution(NamedTuple):
    """Results of descents, one row each."""

    theta: np.ndarray
    cost: np.ndarray
    iterations: np.ndarray
    status: np.ndarray


def advance(problem: Problem, theta, lanes: Any, iterations: int, damping=None) -> Any:
    """Advance every lane by `iterations` steps; returns a `solver.Descent`."""
    damping = np.zeros(len(theta)) if damping is None else damping
    program = _program(problem._replace(choice=0))
    if not problem.by_point:
        return map_lanes(program, theta, damping, lanes, shared=(np.int64(iterations),))
    points = {name: getattr(lanes, name) for name in problem.by_point}
    return map_lanes(program, theta, damping, lanes._replace(**dict.fromkeys(points)),
                     shared=(np.int64(iterations), np.int32(problem.choice)), by_point=points)


def screen(
    problem: Problem, theta, lanes: Any, iterations: int,
    badness: Callable = lambda theta, cost: cost,
) -> tuple[np.ndarray, np.ndarray]:
    """Index and parameters of the best start of each fit.

    theta is [fit, start, parameter], and `lanes` has a row for every start of every fit. The two
    best starts after `iterations` steps take as many again, then the better one is chosen by the
    least `badness(theta, cost)`.
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
    least_fall: float = LEAST_FALL, least_cost: float = MIN_COST,
) -> Solution:
    """Descend until a round of `at_a_time` iterations lowers the cost by less than `least_fall`, or
    to less than `least_cost`, below which only rounding is left.

    `damping` is that of the descents that led to `theta`; None restarts them. Stops after `at_most`
    iterations, in whole rounds.
    """
    n = len(theta)
    damping = np.zeros(n) if damping is None else DAMPING_REUSE * damping
    damping[damping > MAX_REUSED_DAMPING] = 0.0
    theta, cost = theta.copy(), np.zeros(n)
    iterations = np.zeros(n, int)
    status = np.full(n, FitStatus.not_converged)
    active = np.arange(n)
    while len(active) and iterations.max() < at_most:
        moved = advance(problem, theta[active], take(lanes, active), at_a_time, damping[active])
        # A round of rejected steps proves convergence only if the steps were short.
        rejected = (moved.theta == theta[active]).all(axis=1) & (moved.damping < CONCLUSIVE_DAMPING)
        theta[active], damping[active], cost[active] = moved.theta, moved.damping, moved.cost
        iterations[active] += at_a_time
        done = (moved.decrease < least_fall) & ~rejected | (moved.cost < least_cost)
        status[active[done]] = FitStatus.converged
        active = active[~done]
    return Solution(theta, cost, iterations, status)


@lru_cache(maxsize=64)
def _program(problem: Problem) -> Program:
    def whole(theta, damping, lane, iterations):
        return descend(problem.function, theta, damping, iterations, lane)

    def in_pieces(theta, damping, lane, slots, span, iterations, choice):
        return descend(lambda theta, lane: problem.function(theta, lane, span, choice), theta,
                       damping, iterations, lane._replace(**slots))

    return Program(f"descend {problem.name}", in_pieces if problem.by_point else whole)
