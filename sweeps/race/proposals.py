"""Proposals of a search: Optuna's tree-structured Parzen estimator, asked and told in order.

What is proposed follows from the study's seed and the scores reported, in the order of asking; so
a search that is run again proposes the same. Bergstra and others 2011, Algorithms for
hyper-parameter optimization, NeurIPS 24; Akiba and others 2019, Optuna, KDD.
"""

from collections.abc import Sequence
from typing import Any

from sweeps.output import extra_hint
from sweeps.spec.errors import StoreError
from sweeps.spec.search import Factor, Search

DIGITS = 6
STARTUP = 10
"""Proposals at random, before the estimator has something to go by."""
AGAIN = 20
"""More trials of a round at most, where all of it would be one point: nothing would race."""
Point = dict[str, Any]
"""A value for each factor that is proposed, in units of the spec."""


class Proposals:
    """The points that a search has proposed, and what became of them."""

    def __init__(self, search: Search, seed: int) -> None:
        try:
            import optuna
        except ImportError:
            raise StoreError(f"[search]: needs Optuna: {extra_hint('search')}") from None
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        self.search = search
        sampler = optuna.samplers.TPESampler(seed=seed % 2**32, n_startup_trials=STARTUP,
                                             constant_liar=True)
        self.study = optuna.create_study(sampler=sampler)
        self.asked: list[list[Any]] = []
        """The trials of each point that was asked for last."""
        self.tried = 0
        """Trials so far."""

    def ask(self, count: int) -> list[Point]:
        """The points of so many trials, each once; of more trials where they would be one point."""
        found: dict[str, Point] = {}
        trials: dict[str, list[Any]] = {}
        for n in range(count + AGAIN):
            if n >= count and len(found) > 1:
                break
            trial = self.study.ask()
            point = self._point(trial)
            found.setdefault(repr(point), point)
            trials.setdefault(repr(point), []).append(trial)
            self.tried += 1
        self.asked = list(trials.values())
        return list(found.values())

    def tell(self, values: Sequence[float]) -> None:
        """The scores of the points that were asked for last, less being better; a point's trials
        are all told the same."""
        for trials, value in zip(self.asked, values, strict=True):
            for trial in trials:
                self.study.tell(trial, float(value))

    def _point(self, trial: Any) -> Point:
        found: Point = {}
        for factor in self.search.factors:
            if factor.is_open(found):
                found[factor.key] = _suggested(trial, factor)
        return found


def _suggested(trial: Any, factor: Factor) -> Any:
    """A value of a factor; the sampler knows a choice by its number."""
    if factor.choices:
        return factor.choices[trial.suggest_categorical(
            factor.key, list(range(len(factor.choices))))]
    last = factor.extremes[1]  # of the steps; the sampler warns of ends between two
    if factor.whole:
        return trial.suggest_int(factor.key, int(factor.low), int(last),
                                 step=int(factor.step or 1))
    value = trial.suggest_float(factor.key, float(factor.low), float(last), step=factor.step)
    return float(f"{value:.{DIGITS}g}")
