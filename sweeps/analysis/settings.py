"""What each swept factor does to each strategy: means by level, and its share of the variance.

The data are the means of all settings, which share objects and episodes (common random
numbers). A factor of more than eight values is cut into four levels of equally many
settings; in pictures only one that was sampled is. `share` is the variance between a factor's
levels over the variance between settings: on a full grid the first-order sensitivity index; on
sampled points an estimate of it, too small by what varies within a level, too large by chance where
a level has few settings.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sweeps.analysis.entries import CHANCES, LeaderboardError, bounds_of, digits_of, value_texts
from sweeps.analysis.interval import ObjectMeans, sensible_ends
from sweeps.analysis.paired import Paired, read_paired
from sweeps.run.plan import Plan
from sweeps.run.store import Store
from sweeps.text_table import TextTable, number_text

MANY_VALUES = 8
LEVELS = 4
_ROUNDING = 1e-12
"""Of a mean: settings whose means differ by less are equal, and nothing has a share in that."""


@dataclass(frozen=True)
class Effect:
    """One factor's levels for one strategy."""

    strategy: str
    factor: str
    levels: tuple[str, ...]
    at: np.ndarray | None
    """(level,) The number of each level, or the mean of those that it joins; None where values are
    not numbers."""
    value: np.ndarray  # (level,)
    low: np.ndarray
    high: np.ndarray
    settings: tuple[int, ...]
    """How many settings each level has."""
    spread: tuple[float, float, float]
    """The largest minus the smallest level mean, and the interval of the difference of these two
    levels: with other objects or episodes either may be the larger. They were chosen for their
    means, so the interval holds for all pairs of levels at once."""
    share: float
    level_of: tuple[int, ...]
    """The level of each of the strategy's settings."""


def read_settings(plan: Plan, stores: Sequence[Store], metric: str,
                  over: str | None = None) -> Paired:
    """Every strategy under every setting. Raises LeaderboardError where nothing was swept."""
    if not plan.study.axes:
        raise LeaderboardError("this study sweeps nothing; see [sweep.grid] in "
                               "`warpgrasp init`")
    return read_paired(plan, stores, [metric], range(len(plan.study.axes)), over)


def effects(plan: Plan, paired: Paired, metric: str, cut: bool = True) -> Iterator[Effect]:
    """Strategy by strategy, the factors in the order of the spec. Without `cut` only factors that
    were sampled are cut into levels."""
    for number, strategy in enumerate(plan.study.strategies):
        mine = [n for n, entry in enumerate(paired.entries) if entry.strategy == number]
        means = paired.means[metric][0, mine]
        between = means.var()
        if between <= (_ROUNDING * np.abs(means).max(initial=0.0)) ** 2:
            between = 0.0
        for place, axis in enumerate(plan.study.axes):
            if place in plan.study.idle[number]:
                continue
            points = np.array([paired.entries[n].points[place] for n in mine])
            for k, key in enumerate(axis.keys):
                given = [axis.values[point][k] for point in points]
                names, level = _levels(given, cut or axis.sampled)
                of_levels = ObjectMeans(len(names), 0, chances=metric in CHANCES)
                for values in paired.values[metric]:
                    own = values[:, mine]
                    of_levels.add(np.stack([own[:, level == n].mean(axis=1)
                                            for n in range(len(names))], axis=1))
                found = sensible_ends(of_levels.values(paired.over, bounds_of(metric)))
                most, least = found.value.argmax(), found.value.argmin()
                apart = of_levels.differences(int(least), paired.over)
                widest = bounds_of(metric)[1]
                between_two, least_apart, most_apart = (
                    float(np.clip(ends[most], -widest, widest))
                    for ends in (apart.value, apart.low, apart.high))
                counts = np.bincount(level, minlength=len(names))
                inside = counts @ (found.value - means.mean()) ** 2 / len(mine)
                at = (np.bincount(level, np.array(given, float), len(names)) / counts
                      if all(map(_is_number, given)) else None)
                yield Effect(strategy.name, key, names, at, found.value, found.low, found.high,
                             tuple(int(count) for count in counts),
                             (between_two, least_apart, most_apart),
                             float(inside / between) if between > 0 else float("nan"),
                             tuple(level.tolist()))


def _levels(values: list[object], cut: bool) -> tuple[tuple[str, ...], np.ndarray]:
    """The names of a factor's levels, and the level of each setting. Numbers that may be `cut`
    into levels rise; others come in the spec's order."""
    distinct = list(dict.fromkeys(values))
    if not cut or not all(map(_is_number, distinct)):
        return tuple(value_texts(distinct)), np.array([distinct.index(v) for v in values])
    numbers = np.array(values, float)
    if len(distinct) <= MANY_VALUES:
        _, first, level = np.unique(numbers, return_index=True, return_inverse=True)
        return tuple(value_texts([values[n] for n in first])), level
    rank = np.searchsorted(np.sort(numbers), numbers)
    _, level = np.unique(rank * LEVELS // len(numbers), return_inverse=True)
    return tuple(f"{numbers[level == n].min():.4g} to {numbers[level == n].max():.4g}"
                 for n in range(level.max() + 1)), level


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def settings_table(plan: Plan, paired: Paired, metric: str) -> TextTable:
    """The table of `warpgrasp table DIR settings`: a line a level."""
    digits = digits_of(metric)
    rows, found = [], list(effects(plan, paired, metric))
    for effect in found:
        about = (*(number_text(v, digits) for v in effect.spread), number_text(effect.share, 4))
        rows += [(effect.strategy, effect.factor, level, str(effect.settings[n]),
                  *(number_text(v[n], digits) for v in (effect.value, effect.low, effect.high)),
                  *about) for n, level in enumerate(effect.levels)]
    header = ("strategy", "factor", "level", "n_settings", metric, f"{metric}_ci_low",
              f"{metric}_ci_high", "spread", "spread_ci_low", "spread_ci_high", "share")
    return TextTable(header, tuple(rows), (*paired.notes, *together_notes(found)))


def together_notes(found: Sequence[Effect]) -> Iterator[str]:
    """Factors that nothing tells apart: each level of one is a level of the other, as of zipped
    keys, and of keys that were sampled at a few points."""
    groups: dict[tuple[str, tuple[int, ...]], list[str]] = {}
    for effect in found:
        first: dict[int, int] = {}  # levels by their first setting, whatever their order
        same = tuple(first.setdefault(level, n) for n, level in enumerate(effect.level_of))
        if len(first) > 1:
            groups.setdefault((effect.strategy, same), []).append(effect.factor)
    for factors in dict.fromkeys(tuple(names) for names in groups.values() if len(names) > 1):
        yield (f"{' and '.join(factors)} vary together: their levels are the same settings, and "
               "what is said of one may be due to the other")
