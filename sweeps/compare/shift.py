"""What changed between two studies in a metric, with intervals that hold for all rows at once.

The difference of an entry is B minus A: of each episode with itself where they are paired, else of
the two means. The variance for *these* objects is that of episodes within each object (Welch and
Satterthwaite's degrees of freedom); for objects *like these* an object's mean difference is one
observation, and intervals are widened as those of a leaderboard. There is an interval for every
shared entry, and one for their mean; Student's quantile is that of so many comparisons
(Bonferroni). Of outcomes that are 0 or 1 the variance is at least that with two more episodes of an
object, as in a leaderboard.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sweeps.analysis.bootstrap import Estimate, population
from sweeps.analysis.entries import CHANCES, entry_axes
from sweeps.analysis.interval import small_sample_widening, students_t
from sweeps.analysis.paired import (
    ObjectRows,
    by_episode,
    failure_score,
    filled,
    read_objects,
)
from sweeps.compare.matching import Shared
from sweeps.run.plan import Plan
from sweeps.run.store import Store

Side = tuple[Plan, Sequence[Store]]


@dataclass(frozen=True)
class Shift:
    """A metric of the shared entries in both studies; arrays are (entry,)."""

    one: np.ndarray
    other: np.ndarray
    difference: Estimate
    """B minus A, (entry + 1,): that of all entries together comes last."""
    over: str
    objects: int
    episodes: tuple[int, int]
    """Of each study; where episodes are paired they are the same ones."""
    missing: int
    """Units of shared entries that are not finished in A or B."""
    unscored: np.ndarray
    """Rows without a score, which count as the worst, (study, entry)."""


Sample = tuple[np.ndarray, np.ndarray, bool]
"""Of independent episodes (episode, entry), the entries (entry,) that they tell of, and whether
they are differences of two outcomes."""


class Differences:
    """Sums over objects of differences, (entry + 1,), and of what their intervals need."""

    def __init__(self, chances: bool = False) -> None:
        self.chances = chances
        self.objects: list[np.ndarray] = []  # mean differences on each
        self._variance: np.ndarray | float = 0.0
        self._square: np.ndarray | float = 0.0  # with what Satterthwaite's formula adds up
        self._hidden: np.ndarray | float = 0.0  # of chances, beyond what episodes show

    def add(self, samples: Sequence[Sample]) -> None:
        """Takes in an object: independent samples whose means add up to the difference."""
        total: np.ndarray | float = 0.0
        for sample, used, differ in samples:
            sample = sample * used
            values = np.column_stack([sample, sample.mean(axis=1)])
            count = len(values)
            total = total + values.mean(axis=0)
            part = values.var(axis=0, ddof=1) / count if count > 1 else np.full(
                values.shape[1], np.nan)
            if self.chances:
                # Of the mean of all: as if each entry's unseen outcomes were its own.
                least = _least_variance(values, differ) * np.append(
                    used, used.sum() / len(used) ** 2)
                self._hidden = self._hidden + np.maximum(least - np.nan_to_num(part), 0.0)
                part = np.maximum(part, least)
            self._variance = self._variance + part
            self._square = self._square + part**2 / max(count - 1, 1)
        self.objects.append(np.asarray(total))

    def estimate(self, over: str) -> Estimate:
        """The mean differences with intervals that hold together."""
        means = np.array(self.objects)
        count, rows = means.shape
        if over == "these":
            variance, square = np.asarray(self._variance), np.asarray(self._square)
            error = np.sqrt(variance) / count
            freedom = np.divide(variance**2, square, where=square > 0, out=np.full(rows, np.inf))
        elif count > 1:
            error = means.std(axis=0, ddof=1) / np.sqrt(count) * small_sample_widening(count)
            error = np.sqrt(error**2 + self._hidden / count**2)
            freedom = np.full(rows, count - 1.0)
        else:
            error = freedom = np.full(rows, np.nan)
        mean = means.mean(axis=0)
        half = students_t(freedom, rows if rows > 2 else 1) * error  # one entry is its own mean
        most = 1.0 if self.chances else np.inf
        return Estimate(mean, np.maximum(mean - half, -most), np.minimum(mean + half, most))


def _least_variance(values: np.ndarray, differ: bool) -> np.ndarray:
    """Of the means of outcomes (episode, entry), with an episode more of each; of differences, with
    one without and half a one each way."""
    count, total = len(values) + 2.0, np.abs(values.sum(axis=0))
    square = ((values**2).sum(axis=0) + 1.0) / count
    return (square - ((total if differ else total + 1.0) / count) ** 2) / len(values)


def measure_shift(one: Side, other: Side, shared: Shared, metric: str, over: str | None) -> Shift:
    """Reads the units of what two studies share, once; memory grows with one object's episodes.

    Where no object has episodes that are finished in both there are no objects, and NaN.
    """
    found, missing = Differences(metric in CHANCES), 0
    means: list[tuple[np.ndarray, np.ndarray]] = []
    episodes, unscored = np.zeros(2, int), np.zeros((2, len(shared.matches)), int)
    paired = np.array([match.same_noise and shared.same_seed for match in shared.matches])
    for mine, theirs in zip(_objects(one, shared, metric, 0), _objects(other, shared, metric, 1),
                            strict=True):
        missing += mine.missing + theirs.missing
        if not (mine.episodes and theirs.episodes):
            continue
        a, b = _values(mine, theirs, metric, shared.same_seed)
        if not (len(a) and len(b) and np.isfinite(a).all() and np.isfinite(b).all()):
            continue
        found.add([(b - a, paired, True), (-a, ~paired, False), (b, ~paired, False)]
                  if paired.any() else [(-a, ~paired, False), (b, ~paired, False)])
        means.append((a.mean(axis=0), b.mean(axis=0)))
        episodes += len(a), len(b)
        unscored += [_unscored(side, beside, metric, shared.same_seed)
                     for side, beside in ((mine, theirs), (theirs, mine))]
    over = population(over, len(means))
    if not means:
        nothing = np.full(len(paired), np.nan)
        unknown = np.full(len(paired) + 1, np.nan)
        return Shift(nothing, nothing, Estimate(unknown, unknown, unknown), over, 0, (0, 0),
                     missing, unscored)
    first, second = (np.mean(side, axis=0) for side in zip(*means, strict=True))
    return Shift(first, second, found.estimate(over), over, len(means),
                 (int(episodes[0]), int(episodes[1])), missing, unscored)


def _objects(side: Side, shared: Shared, metric: str, which: int) -> Iterator[ObjectRows]:
    """One study's rows of the shared entries, for each shared object in turn."""
    plan, stores = side
    bodies = {body.name: body for body in plan.study.objects}
    objects = tuple(bodies[name] for name in shared.objects)
    entries = [(match.one, match.other)[which] for match in shared.matches]
    return read_objects(replace(plan, study=replace(plan.study, objects=objects)), stores, entries,
                        entry_axes(plan, None)[0], [metric])


def _unscored(side: ObjectRows, beside: ObjectRows, metric: str, same_seed: bool) -> np.ndarray:
    """How many of a study's rows have no value, (entry,): if the seed is the same, of the episodes
    that the one beside it has, too."""
    both = {*beside.episodes} if same_seed else {*side.episodes}
    used = [number in both for number in side.episodes]
    return (~np.isfinite(side.values[metric][used])).sum(axis=0)


def _values(mine: ObjectRows, theirs: ObjectRows, metric: str, same_seed: bool
            ) -> tuple[np.ndarray, np.ndarray]:
    """An object's (episode, entry) in both, the same episodes if the seed is the same.

    A failed episode without a value counts as a leaderboard of both together would count it.
    """
    sides = (mine, theirs)
    rows = filled(np.concatenate([side.values[metric] for side in sides]), failure_score(metric),
                  np.concatenate([side.given(metric) for side in sides]))
    split = np.split(rows, [len(mine.episodes)])
    values = [by_episode(part, side.episodes) for part, side in zip(split, sides, strict=True)]
    if not same_seed:
        return values[0], values[1]
    numbers = [sorted(set(side.episodes)) for side in sides]
    both = set(numbers[0]) & set(numbers[1])
    kept = [np.array([number in both for number in own]) for own in numbers]
    return values[0][kept[0]], values[1][kept[1]]
