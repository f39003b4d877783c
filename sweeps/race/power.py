"""What a sweep will be able to tell apart, reckoned from a pilot: a sweep of a few episodes.

Two entries are told apart if the simultaneous interval of their difference excludes zero, as in a
leaderboard. The difference over its estimated standard error has a noncentral t distribution; what
80 % of sweeps show is the one of which 80 % lies above the critical difference of that many
entries. Of *these* objects the standard error is that of episodes within objects, and falls with
the episodes of a cell; it has the degrees of freedom that Satterthwaite's formula finds in the
mean, for it takes variances of few episodes for unequal. Of objects *like these* it is that of the
objects' mean differences: their variance in the pilot, less the share that its few episodes
have in it, plus that which the sweep's will have.
"""

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from sweeps.analysis.entries import (
    CHANCES,
    LeaderboardError,
    check_metric,
    entries_of,
    entry_axes,
)
from sweeps.analysis.interval import critical_difference, small_sample_widening
from sweeps.analysis.paired import read_paired
from sweeps.run.plan import Plan
from sweeps.run.race_record import open_sweep
from sweeps.spec.study import Study

POWER = 0.8
"""The share of sweeps that show a difference."""
MOST_PAIRS = 2000
_ROUNDS = 30
"""After which a difference of shares and the variance that it implies agree."""
_NAMED = 3
"""Names of what a pilot lacks that are told, of each kind."""


@dataclass(frozen=True)
class Spreads:
    """What a pilot tells of the differences of pairs of entries."""

    within: np.ndarray
    """Variance of a difference among the episodes of an object, (pair, object)."""
    between: np.ndarray
    """Variance of the mean differences of objects, less that of their episodes, (pair,); NaN for
    one object."""
    episodes: int
    """Of the pilot, of each object."""
    chances: bool = False
    """Whether values are 0 or 1, and may all agree by chance."""


def pilot_spreads(folder: Path, metric: str) -> Spreads:
    """Reads a pilot. Raises LeaderboardError for one that has too little, StoreError for none."""
    check_metric(metric)
    plan, stores = open_sweep([folder])
    paired = read_paired(plan, stores, [metric])
    values = [each for each in paired.values[metric] if np.isfinite(each).all()]
    if len(paired.labels) < 2 or not values or min(len(v) for v in values) < 2:
        raise LeaderboardError(f"--pilot: {folder} should hold two entries or more, with two "
                               "finished episodes or more of each object")
    pairs = list(combinations(range(len(paired.labels)), 2))
    pairs = pairs[:: -(-len(pairs) // MOST_PAIRS)]
    apart = [[v[:, a] - v[:, b] for v in values] for a, b in pairs]
    within = np.array([[d.var(ddof=1) for d in of_objects] for of_objects in apart])
    means = np.array([[d.mean() for d in of_objects] for of_objects in apart])
    own = np.array([1.0 / len(v) for v in values])
    between = (means.var(axis=1, ddof=1) - (within * own).mean(axis=1) if len(values) > 1
               else np.full(len(pairs), np.nan))
    return Spreads(within, np.maximum(between, 0.0), min(len(v) for v in values),
                   metric in CHANCES)


def told_apart(spreads: Spreads, entries: int, objects: int, episodes: int
               ) -> tuple[float, float]:
    """The difference that the median pair shows in 80 % of sweeps of this size: of these objects
    (NaN for one episode of each), and of objects like these (NaN for one object)."""
    of_these = of_like = within = spreads.within.mean(axis=1)
    size = entries, objects, episodes
    for _ in range(_ROUNDS if spreads.chances else 0):
        of_these, of_like = (np.maximum(within, _least_variance(apart, episodes)) for apart in (
            _these(of_these, *size), _like_these(of_like, spreads.between, *size)))
    found = _these(of_these, *size), _like_these(of_like, spreads.between, *size)
    if spreads.chances:  # no share differs by more than 1
        found = tuple(np.where(apart <= 1.0, apart, np.inf) for apart in found)
    return float(np.median(found[0])), float(np.median(found[1]))


def _these(within: np.ndarray, entries: int, objects: int, episodes: int) -> np.ndarray:
    """What each pair shows of these objects, (pair,)."""
    if episodes < 2:
        return np.full(len(within), np.nan)
    own = episodes - 1.0  # degrees of freedom of an object's variance
    freedom = np.full(len(within), own * (objects * own + 2.0) / (own + 2.0))
    return (_shown(freedom, critical_difference(entries, freedom))
            * np.sqrt(within / episodes / objects))


def _like_these(within: np.ndarray, between: np.ndarray, entries: int, objects: int, episodes: int
                ) -> np.ndarray:
    """What each pair shows of objects like these, (pair,)."""
    if objects < 2:
        return np.full(len(within), np.nan)
    freedom = np.full(len(within), objects - 1.0)
    wide = critical_difference(entries, freedom) * small_sample_widening(objects)
    return _shown(freedom, wide) * np.sqrt((between + within / episodes) / objects)


def _least_variance(apart: np.ndarray, episodes: int) -> np.ndarray:
    """Of outcomes' differences whose mean is `apart`, with two more episodes, as a leaderboard has
    it: a pilot in which all outcomes agree would tell the least difference."""
    count = episodes * np.clip(np.nan_to_num(apart, nan=1.0), 0.0, 1.0)
    return (count + 1.0) / (episodes + 2.0) - (count / (episodes + 2.0)) ** 2


def _shown(freedom: np.ndarray, critical: np.ndarray) -> np.ndarray:
    """True standard errors of a difference that is above so many estimated ones in 80 % of sweeps:
    the noncentrality of t at which that is so."""
    from scipy.special import nctdtrinc

    return nctdtrinc(freedom, 1.0 - POWER, critical)


def power_row(plan: Plan, folder: Path, metric: str) -> tuple[str, str]:
    """A row of `warpgrasp check`: what the sweep can tell apart."""
    spreads = pilot_spreads(folder, metric)
    entries = len(entries_of(plan, entry_axes(plan, None)[0]))
    objects, episodes = len(plan.study.objects), plan.study.head.episodes_per_cell
    these, like = told_apart(spreads, max(entries, 2), objects, episodes)
    unit = f" {metric.rpartition('_')[2]}" if metric.endswith(("_mm", "_s", "_m")) else ""
    found = ", ".join(
        f"{f'{apart:.2g}{unit}' if np.isfinite(apart) else 'nothing'} on {objects_told}"
        for apart, objects_told in ((these, "these objects"), (like, "objects like these")))
    return "tells_apart", (f"{found}: differences of {metric} that 80 % of such sweeps show (from "
                           f"{spreads.episodes} episodes{_other_than(plan.study, folder)})")


def _other_than(study: Study, folder: Path) -> str:
    """What the pilot has not of the study: its spread is then that of others."""
    pilot = open_sweep([folder])[0].study
    lacks = []
    for kind, mine, theirs in (("strategies", study.strategies, pilot.strategies),
                               ("objects", study.objects, pilot.objects)):
        if missing := sorted({one.name for one in mine} - {one.name for one in theirs}):
            more = ", ..." if len(missing) > _NAMED else ""
            lacks.append(f"{kind} {', '.join(missing[:_NAMED])}{more}")
    return f" of a pilot without {' and '.join(lacks)}" if lacks else ""
