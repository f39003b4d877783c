"""Error against robot time: which entries no other beats in both.

What every strategy is given, `given-prior`, takes no time: an entry that is no better is not on the
front, and beats nobody. An episode that fails early takes little time, too: `early_failures` says
which means that shortens.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np

from strategies.ready_made import REFERENCE
from sweeps.analysis.bootstrap import Estimate
from sweeps.analysis.entries import (
    METRICS,
    ROUNDING,
    LeaderboardError,
    bounds_of,
    digits_of,
    prior_column,
    sign_of,
)
from sweeps.analysis.interval import ObjectMeans, sensible_ends
from sweeps.analysis.paired import Paired
from sweeps.text_table import TextTable, number_text

COST = "robot_time_s"
FAILED = "failure_rate"
SHORTER = 0.05
"""Share of its time by which an entry's failures may shorten it without a word."""


@dataclass(frozen=True)
class Pareto:
    """Means with a leaderboard's intervals, shapes (entry,)."""

    error: Estimate
    cost: Estimate
    """Over the objects where an entry has any; no time is made up for units that failed."""
    dominated_by: tuple[int | None, ...]
    """The best entry that is no worse in both and better in one."""
    idle: np.ndarray
    """Whether an entry is no better than what it was given, which took no time."""
    p_front: np.ndarray
    """The share of bootstrap replicates in which nothing dominates the entry; NaN for one whose
    units all failed, which took no time that is known."""


def columns_of(metric: str) -> list[str]:
    """The columns that a front needs of a study's rows, `metric` first. Raises LeaderboardError for
    the time itself."""
    if metric == COST:
        raise LeaderboardError(f"--metric: is {COST}, which pareto compares the metric with; "
                               f"should be another one, such as {METRICS[0]}")
    return list(filter(None, [metric, COST, FAILED, prior_column(metric)]))


def find_front(paired: Paired, metric: str) -> Pareto:
    """The front of `metric` and robot time. Without the priors' scores no entry is idle."""
    error, cost = paired.means[metric], paired.means[COST]
    sign = sign_of(metric)
    given = paired.means.get(prior_column(metric) or "", np.full_like(error, np.nan))
    idle = sign * (error - given) >= -ROUNDING * np.abs(given)
    by = dominating(sign * error[0], cost[0]) & ~idle[0]
    best = tuple(min(np.flatnonzero(row), key=lambda n: (sign * error[0, n], n), default=None)
                 for row in by)
    known = np.isfinite([error[0], cost[0]]).all(axis=0)
    drawn = [np.where(known, ~dominating(sign * e, c).any(axis=1) & ~beaten, np.nan)
             for e, c, beaten in zip(error[1:], cost[1:], idle[1:], strict=True)
             if known.any() and np.isfinite([e[known], c[known]]).all()]
    errors = paired.statistics(metric).values(paired.over, bounds_of(metric))
    return Pareto(sensible_ends(errors), _costs(paired, metric),
                  tuple(None if n is None else int(n) for n in best), idle[0],
                  np.mean(drawn, axis=0) if drawn else np.full(len(by), np.nan))


def _costs(paired: Paired, metric: str) -> Estimate:
    """Each entry's own: another's failures say nothing of it. Of the objects that errors are of."""
    found = []
    for n in range(len(paired.entries)):
        own = ObjectMeans(1, 0)
        for values in _where_known(paired, metric, COST):
            own.add(values[:, [n]])
        found.append(own.values(paired.over, bounds_of(COST)))
    return sensible_ends(Estimate(*(np.concatenate(parts) for parts in zip(
        *((part.value, part.low, part.high) for part in found), strict=True))))


def _where_known(paired: Paired, metric: str, column: str) -> list[np.ndarray]:
    """A column on the objects where the metric is known; on all where it is known on none."""
    known = [bool(np.isfinite(means).all()) for means in paired.object_means(metric)]
    return list(compress(paired.values[column], known if any(known) else [True] * len(known)))


def early_failures(paired: Paired, metric: str, front: Pareto) -> Iterator[str]:
    """Entries that take less time because episodes failed early, and who would dominate them if
    these had taken as long as the others; none where it was not read which failed."""
    if FAILED not in paired.values:
        return
    error, cost = sign_of(metric) * front.error.value, front.cost.value
    for n, label in enumerate(paired.labels):
        times = [(took[:, n], failed[:, n] > 0.0) for took, failed in zip(
            *(_where_known(paired, metric, column) for column in (COST, FAILED)), strict=True)
            if np.isfinite(took[:, n]).all()]
        others = _others(times)
        whole = np.mean([np.where(failed, other, took).mean()
                         for (took, failed), other in zip(times, others, strict=True)] or [np.nan])
        if not whole * (1.0 - SHORTER) > cost[n]:
            continue
        early, full = (np.concatenate([np.broadcast_to(time, failed.shape)[failed]
                                       for time, (_, failed) in zip(given, times, strict=True)])
                       for given in ([took for took, _ in times], others))
        by = dominating(error, np.where(np.arange(len(cost)) == n, whole, cost))[n] & ~front.idle
        best = min(np.flatnonzero(by), key=lambda k: (error[k], k), default=None)
        then = ("" if best is None or front.dominated_by[n] is not None or front.idle[n] else
                f", and {paired.labels[best]} would dominate it")
        yield (f"{label} takes {cost[n]:.1f} s, but {len(early)} of its episodes failed, after "
               f"{early.mean():.1f} s in the mean, where the others take {full.mean():.1f} s: had "
               f"they taken as long, it would take {whole:.1f} s{then}")


def _others(times: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """The mean time of an entry's episodes that did not fail, (object,); NaN if all failed. Of each
    object the times, (episode,), and which failed.

    Where all failed on an object, it is that of all objects, or their own time if it is longer.
    """
    own = np.array([took[~failed].mean() if not failed.all() else np.nan
                    for took, failed in times])
    known = np.isfinite(own)
    if not known.any():
        return own
    longest = [max(took.mean(), own[known].mean()) for took, _ in times]
    return np.where(known, own, longest)


def dominating(error: np.ndarray, cost: np.ndarray) -> np.ndarray:
    """[n, k]: whether entry k dominates entry n; both less is better, and what rounding alone tells
    apart is equal."""
    apart = [values[None] - values[:, None] for values in (error, cost)]
    near = [ROUNDING * np.abs(values)[:, None] for values in (error, cost)]
    no_worse = (apart[0] <= near[0]) & (apart[1] <= near[1])
    better = (apart[0] < -near[0]) | (apart[1] < -near[1])
    return no_worse & better


def pareto_table(paired: Paired, metric: str) -> TextTable:
    """The table of `warpgrasp table DIR pareto`, the cheapest first."""
    front = find_front(paired, metric)
    digits = digits_of(metric)
    order = sorted(range(len(paired.labels)),
                   key=lambda n: (_last(front.cost.value[n]), paired.labels[n]))
    rows = tuple(
        (paired.labels[n],
         *(number_text(v[n], 2) for v in (front.cost.value, front.cost.low, front.cost.high)),
         *(number_text(v[n], digits)
           for v in (front.error.value, front.error.low, front.error.high)),
         paired.labels[by] if (by := front.dominated_by[n]) is not None
         else REFERENCE if front.idle[n] else "",
         number_text(front.p_front[n], 3))
        for n in order)
    header = ("strategy", COST, f"{COST}_ci_low", f"{COST}_ci_high", metric, f"{metric}_ci_low",
              f"{metric}_ci_high", "dominated_by", "p_front")
    return TextTable(header, rows, (*paired.notes, *early_failures(paired, metric, front)))


def _last(value: float) -> float:
    return value if np.isfinite(value) else np.inf
