"""Bootstrap replicates of means over objects, then episodes, for tables of more than means.

Every strategy meets the same episodes (same object pose, same noise), so a replicate uses one set
of weights for all: differences are paired. For objects *like these* a replicate draws objects with
replacement, and with each object its episodes: the spread of the objects' means includes that of
their episodes already (Davison and Hinkley 1997, Bootstrap Methods and their Application, section
3.8). For *these* objects it draws every object's episodes, by Poisson(1) weights. An episode has
one weight under all the settings that it is averaged over, since pose and noise are the same there.
Few draws underestimate their spread: replicates are widened to the variance of a sample and to
Student's t. Intervals of means themselves are in `interval`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sweeps.analysis.entries import ROUNDING

OVER = ("like-these", "these")
"""What an interval is of: objects like these, or these objects with other episodes."""
REPLICATES = 1000
INTERVAL = (0.025, 0.975)


def episode_weights(seed: int, body: int, count: int) -> np.ndarray:
    """Weights of an object's episodes, shape (1 + replicate, episode); row 0 is the data itself.

    They depend on the object's number alone: they are the same for every strategy and setting.
    """
    generator = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, 1, body])))
    drawn = generator.poisson(1.0, (REPLICATES, count)).astype(float)
    return np.concatenate([np.ones((1, count)), drawn])


def object_weights(seed: int, count: int) -> np.ndarray:
    """How often each object is drawn, shape (1 + replicate, object); row 0 is the data itself."""
    if not count:
        return np.ones((1 + REPLICATES, 0))
    generator = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, 2])))
    drawn = generator.multinomial(count, np.full(count, 1 / count), REPLICATES)
    return np.concatenate([np.ones((1, count)), drawn.astype(float)])


def widened(means: np.ndarray, count: float) -> np.ndarray:
    """Replicates, axis 0 with the data first, spread about the data as `count` draws deserve.

    By sqrt(n / (n - 1)), for drawing n of n with replacement falls short of a sample's variance by
    that, and by Student's t over the normal quantile. It is linear, so differences of widened
    replicates are widened differences. The spread of one draw is unknown: NaN but for the data.
    """
    return _spread(means, widening(count))


def widening(count: float) -> float:
    """How much farther from the data than they are replicates of so many draws belong."""
    return _student(count - 1) * np.sqrt(count / (count - 1)) if count > 1 else np.nan


def _student(freedom: float) -> float:
    # Not scipy.stats, whose import takes longer than all else that a sweep's parent does.
    from scipy.special import ndtri, stdtrit

    return float(stdtrit(freedom, INTERVAL[1]) / ndtri(INTERVAL[1]))


def population(over: str | None, objects: int) -> str:
    """What intervals are of: as asked, or objects like these where there are several."""
    return over or ("like-these" if objects > 1 else "these")


def replicate_means(objects: Sequence[np.ndarray], seed: int, over: str | None = None
                    ) -> np.ndarray:
    """The mean over objects of each entry's mean over episodes, (1 + replicate, entry), widened.

    `objects` has the episodes of each, (episode, entry); one without a finite value is left out.
    """
    known = [(n, values) for n, values in enumerate(objects) if np.isfinite(values).all()]
    if not known:
        return np.full((1 + REPLICATES, *np.shape(objects[0])[1:]) if len(objects) else
                       (1 + REPLICATES, 0), np.nan)
    if population(over, len(known)) == "like-these":
        means = np.array([values.mean(axis=0) for _, values in known])
        # einsum's own loops, not BLAS: the sum does not depend on a number of threads
        drawn = np.einsum("ro,oe->re", object_weights(seed, len(known)), means)
        return widened(drawn / len(known), len(known))
    total = np.zeros((1 + REPLICATES, known[0][1].shape[1]))
    for number, values in known:
        weights = episode_weights(seed, number, len(values))
        sums = np.einsum("re,ek->rk", weights, values)
        weight = weights.sum(axis=1, keepdims=True)
        mean = np.divide(sums, weight, where=weight > 0, out=np.full_like(sums, np.nan))
        count = len(values)
        total += _spread(mean, np.sqrt(count / (count - 1)) if count > 1 else np.nan)
    freedom = sum(len(values) - 1 for _, values in known)
    return _spread(total / len(known), _student(freedom) if freedom else np.nan)


def _spread(means: np.ndarray, factor: float) -> np.ndarray:
    """Replicates so many times as far from the data, which are row 0."""
    return np.concatenate([means[:1], means[:1] + factor * (means[1:] - means[:1])])


@dataclass(frozen=True)
class Estimate:
    """A value for each entry with its interval, shapes (entry,)."""

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray


def probability_best(means: np.ndarray, sign: float) -> np.ndarray:
    """The share of replicates that each entry wins (ties shared, also those that rounding alone
    tells apart); `sign` -1 if more is better."""
    drawn = sign * means[1:][np.isfinite(means[1:]).all(axis=1)]
    if not len(drawn):
        return np.full(means.shape[1], np.nan)
    wins = drawn - ROUNDING * np.abs(means[0]) <= drawn.min(axis=1, keepdims=True)
    return (wins / wins.sum(axis=1, keepdims=True)).mean(axis=0)
