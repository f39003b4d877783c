"""Means over objects and episodes with honest intervals, in memory that does not grow.

Every strategy meets the same episodes (same object pose, same noise), so a replicate uses one set
of weights for all: differences are paired. Objects are drawn with replacement, and with each object
its episodes: the spread of the objects' means holds that of their episodes already, and to draw the
episodes again on top of it would count it twice (Davison and Hinkley 1997, Bootstrap Methods and
their Application, section 3.8). Only where one object has been measured, and no claim is made
about others, its episodes are drawn, by Poisson(1) weights. An episode has one weight under all the
settings that it is averaged over: pose and noise are the same there, and to draw them apart would
count one episode as many. Few draws know their own spread badly: replicates are widened to the
variance of a sample and to Student's t (see `widened`).
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

REPLICATES = 1000
INTERVAL = (0.025, 0.975)
Place = tuple[int, int]  # of a block of episodes: object, block


@lru_cache(maxsize=8)  # metrics, and the settings of one block, ask for the same
def episode_weights(seed: int, place: Place, count: int) -> np.ndarray:
    """Weights of a block's episodes, shape (1 + replicate, episode); row 0 is the data itself.

    They depend on the place alone, so they are the same for every strategy and setting and any
    order of reading.
    """
    generator = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, 1, *place])))
    drawn = generator.poisson(1.0, (REPLICATES, count)).astype(float)
    weights = np.concatenate([np.ones((1, count)), drawn])
    weights.flags.writeable = False
    return weights


def object_weights(seed: int, count: int) -> np.ndarray:
    """How often each object is drawn, shape (1 + replicate, object); row 0 is the data itself."""
    if not count:
        return np.ones((1 + REPLICATES, 0))
    generator = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, 2])))
    drawn = generator.multinomial(count, np.full(count, 1 / count), REPLICATES)
    return np.concatenate([np.ones((1, count)), drawn.astype(float)])


def widened(means: np.ndarray, count: int) -> np.ndarray:
    """Replicates, axis 0 with the data first, spread about the data as `count` draws deserve.

    By sqrt(n / (n - 1)), for drawing n of n with replacement falls short of a sample's variance by
    that, and by Student's t over the normal quantile. It is linear, so differences of widened
    replicates are widened differences. The spread of one draw is unknown: NaN but for the data.
    """
    if count < 2:
        return np.concatenate([means[:1], np.full_like(means[1:], np.nan)])
    # Not scipy.stats, whose import takes longer than all else that a sweep's parent does.
    from scipy.special import ndtri, stdtrit

    factor = float(stdtrit(count - 1, INTERVAL[1]) / ndtri(INTERVAL[1]))
    return means[:1] + factor * np.sqrt(count / (count - 1)) * (means - means[:1])


class MeanOverObjects:
    """The mean over objects of each entry's mean over episodes, for the data and each replicate.

    An episode without a value (not finite) counts as `failure_score`, or, if that is None, as the
    worst value that any entry had on the same object: no entry gains by it. An object on which no
    entry ever has a value is left out. Replicates draw the objects that are left, or, if that is
    one, its episodes.
    """

    def __init__(self, entries: int, failure_score: float | None, seed: int) -> None:
        self.failure_score = failure_score
        self.seed = seed
        self.entries = entries
        self.objects: list[np.ndarray] = []  # the means on each, (entry,)
        self.first = np.full((1 + REPLICATES, entries), np.nan)  # the first one's replicates
        self._start()

    def _start(self) -> None:
        self.sums = np.zeros((1 if self.objects else 1 + REPLICATES, self.entries))
        self.failed = np.zeros_like(self.sums)
        self.weight = np.zeros((len(self.sums), 1))
        self.episodes: dict[Place, int] = {}
        self.worst = -np.inf

    def add(self, values: np.ndarray, place: Place) -> None:
        """Takes in a block, values of shape (episode, entry); once for each setting, if several."""
        weights = (np.ones((1, len(values))) if self.objects
                   else episode_weights(self.seed, place, len(values)))
        good = np.isfinite(values)
        # einsum's own loops, not BLAS: the sum does not depend on a number of threads
        self.sums += np.einsum("re,ek->rk", weights, np.where(good, values, 0.0))
        self.failed += np.einsum("re,ek->rk", weights, (~good).astype(float))
        self.weight += weights.sum(axis=1, keepdims=True)
        self.episodes[place] = len(values)
        self.worst = max(self.worst, values[good].max(initial=-np.inf))

    def finish_object(self) -> None:
        """Closes an object."""
        if self.worst > -np.inf:
            score = self.worst if self.failure_score is None else self.failure_score
            means = np.divide(self.sums + self.failed * score, self.weight, where=self.weight > 0,
                              out=np.full_like(self.sums, np.nan))
            if not self.objects:
                self.first = widened(means, sum(self.episodes.values()))
            self.objects.append(means[0])
        self._start()

    def means(self) -> np.ndarray:
        """Shape (1 + replicate, entry), widened; NaN where nothing was measured, or drawn."""
        count = len(self.objects)
        if count < 2:
            return self.first
        drawn = np.einsum("ro,ok->rk", object_weights(self.seed, count), np.array(self.objects))
        return widened(drawn / count, count)


class PlainMean:
    """The mean over objects of each entry's mean over the episodes that have a value."""

    def __init__(self, entries: int) -> None:
        self.objects = np.zeros((2, entries))  # sum, count
        self.episodes = np.zeros((2, entries))

    def add(self, values: np.ndarray) -> None:
        """Takes in a block, values of shape (episode, entry); NaN is no value."""
        good = np.isfinite(values)
        self.episodes += np.where(good, values, 0.0).sum(axis=0), good.sum(axis=0)

    def finish_object(self) -> None:
        """Closes an object."""
        self.objects += _ratio(self.episodes), self.episodes[1] > 0
        self.episodes = np.zeros_like(self.episodes)

    def means(self) -> np.ndarray:
        """Shape (entry,); NaN where nothing was measured."""
        return np.where(self.objects[1] > 0, _ratio(self.objects), np.nan)


def _ratio(sum_and_count: np.ndarray) -> np.ndarray:
    total, count = sum_and_count
    return np.divide(total, count, where=count > 0, out=np.zeros_like(total))


@dataclass(frozen=True)
class Estimate:
    """A value for each entry with its interval, shapes (entry,)."""

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray


def estimate(means: np.ndarray, bounds: tuple[float, float] = (-np.inf, np.inf)) -> Estimate:
    """The data's values with percentile intervals over the replicates, within `bounds`."""
    drawn = means[1:][np.isfinite(means[1:]).all(axis=1)]
    if not len(drawn):
        nothing = np.full(means.shape[1], np.nan)
        return Estimate(means[0], nothing, nothing)
    low, high = np.clip(np.quantile(drawn, INTERVAL, axis=0), *bounds)
    return Estimate(means[0], low, high)


def difference_to(means: np.ndarray, best: int) -> Estimate:
    """Each entry minus entry `best`, paired: within the same replicate."""
    return estimate(means - means[:, best:best + 1])


def probability_best(means: np.ndarray, sign: float) -> np.ndarray:
    """The share of replicates that each entry wins (ties shared); `sign` -1 if more is better."""
    drawn = sign * means[1:][np.isfinite(means[1:]).all(axis=1)]
    if not len(drawn):
        return np.full(means.shape[1], np.nan)
    wins = drawn == drawn.min(axis=1, keepdims=True)
    return (wins / wins.sum(axis=1, keepdims=True)).mean(axis=0)
