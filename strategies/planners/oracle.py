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

Foresight = Callable[[Grasp], Recovered]


@planner("oracle", "takes the truly best of its candidates: a ceiling, not a strategy")
class Oracle:
    """Chooses by the truth; only a scorer can make it see."""

    def __init__(self, tried: int = 10) -> None:
        """`tried`: candidates tried at each step, spread over all that are left. Raises ValueError.
        """
        self.tried = whole_option("tried", tried, 1, 10_000)
        self.taken: np.ndarray | None = None
        self.foresee: Foresight | None = None
        self.error: Callable[[Recovered], np.ndarray] | None = None

    def let_see(self, error: Callable[[Recovered], np.ndarray]) -> None:
        """`error` scores recovered bodies against the truth, (world,) in m."""
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
        rows = np.arange(belief.worlds)
        best, least = np.zeros(belief.worlds, int), np.full(belief.worlds, np.inf)
        for number in range(self.tried):
            choice = _spread(free, number, self.tried, belief.step)
            wanted = free[rows, choice]
            if not wanted.any():
                continue
            outcome = self.error(self.foresee(Grasp(poses[rows, choice][:, None],
                                                    wanted[:, None])))
            better = wanted & (outcome < least)
            best[better], least[better] = choice[better], outcome[better]
        found = np.isfinite(least)
        self.taken[rows[found], best[found]] = True
        self.taken[~found] = True  # alone, its episode would have ended
        return [Grasp(poses[rows, best][:, None], found[:, None])]


def _spread(free: np.ndarray, number: int, of: int, step: int) -> np.ndarray:
    """Candidate `number` of `of`, spread over those that are free and shifted step by step."""
    count = free.sum(1)
    order = np.argsort(~free, axis=1, kind="stable")
    place = (number * np.maximum(count, 1) // of + step) % np.maximum(count, 1)
    return order[np.arange(len(free)), np.minimum(place, free.shape[1] - 1)]
