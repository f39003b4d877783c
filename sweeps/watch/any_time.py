"""Intervals of a sweep that goes on, which hold at all looks together.

A sweep does not ask before it goes on, so the looks are few and known beforehand: the mean of an
entry changes when one of its units is finished. Each of its `looks` takes an equal share of the
5 % (Bonferroni). That needs nothing of the order in which units come, but that it does not depend
on their scores. It is wider than the interval of a finished sweep that is looked at once.

As everywhere, an interval is of these objects with other episodes: Student's t with Welch and
Satterthwaite's degrees of freedom (`sweeps.analysis.interval`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sweeps.analysis.interval import LEVEL


@dataclass(frozen=True)
class Mean:
    """A stratified mean, its standard error and degrees of freedom."""

    value: float
    error: float
    freedom: float

    def half_width(self, alpha: float) -> float:
        """Of the two-sided interval at the level 1 - alpha; infinite of a single episode."""
        from scipy.special import stdtrit

        if not self.freedom >= 1.0:
            return float("inf")
        return float(-stdtrit(self.freedom, alpha / 2.0)) * self.error


def mean_over_objects(objects: Sequence[np.ndarray]) -> Mean:
    """The mean over objects of means over their episodes, each (episode,), all finite."""
    count = len(objects)
    part = np.array([values.var(ddof=1) / len(values) / count**2 if len(values) > 1 else np.nan
                     for values in objects])
    variance = part.sum()
    square = sum(p**2 / (len(values) - 1) for p, values in zip(part, objects, strict=True))
    freedom = (float("nan") if np.isnan(variance) else
               float(variance**2 / square) if square > 0 else
               float(sum(len(values) - 1 for values in objects)))
    value = float(np.mean([values.mean() for values in objects]))
    return Mean(value, float(np.sqrt(variance)), freedom)


def alpha_of(looks: int, comparisons: int = 1) -> float:
    """The share of the 5 % of one of so many looks at so many intervals."""
    return (1.0 - LEVEL) / max(looks, 1) / max(comparisons, 1)
