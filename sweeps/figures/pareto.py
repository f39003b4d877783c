"""Error against robot time, with intervals in both, and the Pareto front."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from strategies.ready_made import REFERENCE
from sweeps.analysis.curves import ERROR
from sweeps.analysis.entries import sign_of
from sweeps.analysis.paired import Paired
from sweeps.analysis.pareto import Pareto, find_front
from sweeps.figures.style import (
    MARKERS,
    MUTED,
    Look,
    distinct_labels,
    drawing,
    figure,
    framed,
    looks_of,
    metric_label,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MOST_NAMED = 12
"""Entries on the front that are named: those of the least error, and the cheapest."""
MOST_BARS = 40
"""Dominated entries; the intervals of more would hide all else."""


def draw_pareto(paired: Paired, metric: str) -> "Figure":
    """Entries on the front in their colours with their names, the others grey. Those without a
    value or a time have no place, and are counted."""
    found = find_front(paired, metric)
    cost, error = found.cost, found.error
    known = np.flatnonzero(np.isfinite([error.value, cost.value]).all(axis=0)).tolist()
    front = sorted((n for n in known if found.dominated_by[n] is None and not found.idle[n]),
                   key=lambda n: cost.value[n])
    named = front[:1] + front[1:][-(MOST_NAMED - 1):]
    names, keys = distinct_labels(paired.labels, 24)
    looks = _looks(paired, metric)
    markers = _markers(looks, sorted(named, key=lambda n: (error.value[n] * sign_of(metric), n)))
    with drawing():
        drawn = figure(2.3 + 0.12 * ((len(named) + 4) // 2 + bool(keys)))
        axes = drawn.add_subplot()
        idle = [n for n in known if found.idle[n] and found.dominated_by[n] is None]
        rest = [n for n in known if n not in front + idle]
        bars = _bars(found, rest) if len(rest) <= MOST_BARS else {}
        axes.errorbar(cost.value[rest], error.value[rest], **bars, fmt="o", ms=2.5,
                      color=MUTED, lw=0.6, label=f"{len(rest)} dominated" if rest else None)
        axes.plot(cost.value[idle], error.value[idle], "x", ms=3.5, color=MUTED,
                  label=f"{len(idle)} no better than {REFERENCE}" if idle else None)
        if nowhere := len(paired.labels) - len(known):
            axes.plot([], [], " ", label=f"{nowhere} without a value or time")
        # above the bars, which run along its steps
        axes.step(cost.value[front], error.value[front], where="post", color="#222222", lw=0.8,
                  ls="--", zorder=4, label="_front")
        unnamed = [n for n in front if n not in named]
        axes.plot(cost.value[unnamed], error.value[unnamed], "o", ms=3, mfc="none", color="#555555",
                  label=f"{len(unnamed)} more on the front" if unnamed else None)
        for n in named:
            axes.errorbar(cost.value[[n]], error.value[[n]], **_bars(found, [n]), lw=1.0, ms=4,
                          fmt=markers[n], color=looks[n].colour, label=names[n])
        with_bars = named + (rest if bars else [])
        limits = [framed(v.value, v.low[with_bars], v.high[with_bars]) for v in (cost, error)]
        axes.set(xlim=limits[0], ylim=limits[1],
                 ylabel="\n".join(metric_label(metric).rsplit(", ", 1)),
                 xlabel="robot time [s], less is better"
                 + ("\n(intervals are cut at the frame)" if any(limits) else ""))
        axes.grid(lw=0.3, color="#d0d0d0")
        drawn.legend(loc="outside lower center", ncols=2, title=keys, title_fontsize=6.5)
    return drawn


def _looks(paired: Paired, metric: str) -> list[Look]:
    """As in curves, by the chamfer distance; by `metric` where that was not read."""
    ranked = ERROR if ERROR in paired.values else metric
    means = paired.object_means(ranked)
    known = means[np.isfinite(means).all(axis=1)]
    errors = known.mean(axis=0) if len(known) else np.full(means.shape[1], np.nan)
    return looks_of(sign_of(ranked) * errors, paired.labels)


def _markers(looks: Sequence[Look], named: Sequence[int]) -> dict[int, str]:
    """Those of some entries: where two of hundreds look the same the later one has the next."""
    found: dict[int, str] = {}
    for n in named:
        taken = {marker for k, marker in found.items() if looks[k].colour == looks[n].colour}
        at = MARKERS.index(looks[n].marker)
        found[n] = next((marker for marker in (*MARKERS[at:], *MARKERS[:at])
                         if marker not in taken), looks[n].marker)
    return found


def _bars(found: Pareto, which: list[int]) -> dict[str, Any]:
    bars: dict[str, Any] = {}
    for name, estimate in (("xerr", found.cost), ("yerr", found.error)):
        value, low, high = (v[which] for v in (estimate.value, estimate.low, estimate.high))
        bars[name] = np.maximum(np.stack([value - low, high - value]), 0.0)
    return bars
