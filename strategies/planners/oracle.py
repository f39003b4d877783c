"""The ceiling: a strategy that sees what no robot can, how good each next touch would turn out.

It tries every candidate on a copy of the episode, noise included, reads the true error of the body
fitted afterwards, and takes the best. Greedy, so not the best sequence there is, but no honest
strategy that chooses among the same candidates knows as much at any step.
"""

from collections.abc import Callable

import numpy as np

from strategies.planners.prior_body import planning_belief
from strategies.planners.probes import Grasp, Probe
from strategies.planners.register import planner, whole_option
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered

Foresight = Callable[[Grasp, np.ndarray], Recovered]
AT_ONCE = 1024
"""Grasps that are tried side by side: the batch of all worlds costs what a few worlds do."""


@planner("oracle", "takes the truly best of its candidates: a ceiling, not a strategy")
class Oracle:
    """Chooses by the truth; only a scorer can make it see."""

    def __init__(self, tried: int = 10) -> None:
        """`tried`: candidates tried at each step, spread over all that are left. Raises ValueError.
        """
        self.tried = whole_option("tried", tried, 1, 10_000)
        self.taken: np.ndarray | None = None
        self.foresee: Foresight | None = None
        self.error: Callable[[Recovered, np.ndarray], np.ndarray] | None = None

    def let_see(self, error: Callable[[Recovered, np.ndarray], np.ndarray]) -> None:
        """`error` scores recovered bodies of the worlds `rows` (row,), rising, against the truth,
        (row,) in m."""
        self.error = error

    def __call__(self, belief: Belief) -> list[Probe]:
        """One grasp in every world that has a candidate left."""
        if self.foresee is None or self.error is None:
            raise RuntimeError("the oracle sees nothing outside a sweep")
        from strategies.planners.candidates import candidate_poses  # with it kernels of foresight

        poses, reachable = candidate_poses(planning_belief(belief)[0])
        if self.taken is None:
            self.taken = np.zeros(reachable.shape, bool)
        free = reachable & ~self.taken & belief.active[:, None]
        choice = np.stack([_spread(free, number, self.tried, belief.step)
                           for number in range(self.tried)], 1)
        outcome = np.full(choice.shape, np.inf)
        worlds, numbers = np.nonzero(np.take_along_axis(free, choice, 1))
        for first in range(0, len(worlds), AT_ONCE):
            rows, number = worlds[first:first + AT_ONCE], numbers[first:first + AT_ONCE]
            grasps = Grasp(poses[rows, choice[rows, number]][:, None])
            outcome[rows, number] = np.nan_to_num(self.error(self.foresee(grasps, rows), rows),
                                                  nan=np.inf)
        rows = np.arange(belief.worlds)
        best = choice[rows, outcome.argmin(1)]
        found = np.isfinite(outcome.min(1))
        self.taken[rows[found], best[found]] = True
        self.taken[~found] = True  # alone, its episode would have ended
        return [Grasp(poses[rows, best][:, None], found[:, None])]


def _spread(free: np.ndarray, number: int, of: int, step: int) -> np.ndarray:
    """Candidate `number` of `of`, spread over those that are free and shifted step by step."""
    count = free.sum(1)
    order = np.argsort(~free, axis=1, kind="stable")
    place = (number * np.maximum(count, 1) // of + step) % np.maximum(count, 1)
    return order[np.arange(len(free)), np.minimum(place, free.shape[1] - 1)]
