"""Error against robot time, with intervals in both, and the Pareto front."""

from typing import TYPE_CHECKING, Any

import numpy as np

from strategies.ready_made import REFERENCE
from sweeps.analysis.paired import Paired
from sweeps.analysis.pareto import Pareto, find_front
from sweeps.figures.style import (
    COLOURS,
    MARKERS,
    MUTED,
    distinct_labels,
    drawing,
    figure,
    framed,
    metric_label,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MOST_NAMED = 12
"""Entries on the front that are named: those of the least error, and the cheapest."""
MOST_BARS = 40
"""Dominated entries; the intervals of more would hide all else."""


def draw_pareto(paired: Paired, metric: str) -> "Figure":
    """Entries on the front in colour with their names, the others grey."""
    found = find_front(paired, metric)
    cost, error = found.cost, found.error
    front = sorted((n for n, by in enumerate(found.dominated_by)
                    if by is None and not found.idle[n] and np.isfinite(error.value[n])),
                   key=lambda n: cost.value[n])
    named = front[:1] + front[1:][-(MOST_NAMED - 1):]
    names, keys = distinct_labels(paired.labels, 24)
    with drawing():
        drawn = figure(2.3 + 0.12 * ((len(named) + 4) // 2 + bool(keys)))
        axes = drawn.add_subplot()
        idle = [n for n in np.flatnonzero(found.idle).tolist() if found.dominated_by[n] is None]
        rest = [n for n in range(len(paired.labels)) if n not in front + idle]
        bars = _bars(found, rest) if len(rest) <= MOST_BARS else {}
        axes.errorbar(cost.value[rest], error.value[rest], **bars, fmt="o", ms=2.5,
                      color=MUTED, lw=0.6, label=f"{len(rest)} dominated" if rest else None)
        axes.plot(cost.value[idle], error.value[idle], "x", ms=3.5, color=MUTED,
                  label=f"{len(idle)} no better than {REFERENCE}" if idle else None)
        axes.step(cost.value[front], error.value[front], where="post", color="#555555", lw=0.6,
                  ls="--")
        unnamed = [n for n in front if n not in named]
        axes.plot(cost.value[unnamed], error.value[unnamed], "o", ms=3, mfc="none", color="#555555",
                  label=f"{len(unnamed)} more on the front" if unnamed else None)
        for place, n in enumerate(named):
            axes.errorbar(cost.value[[n]], error.value[[n]], **_bars(found, [n]), lw=1.0, ms=4,
                          fmt=MARKERS[(place + place // len(COLOURS)) % len(MARKERS)],
                          color=COLOURS[place % len(COLOURS)], label=names[n])
        with_bars = named + (rest if bars else [])
        limits = [framed(v.value, v.low[with_bars], v.high[with_bars]) for v in (cost, error)]
        axes.set(xlim=limits[0], ylim=limits[1],
                 ylabel="\n".join(metric_label(metric).rsplit(", ", 1)),
                 xlabel="robot time [s], less is better"
                 + ("\n(intervals are cut at the frame)" if any(limits) else ""))
        axes.grid(lw=0.3, color="#d0d0d0")
        drawn.legend(loc="outside lower center", ncols=2, title=keys, title_fontsize=6.5)
    return drawn


def _bars(found: Pareto, which: list[int]) -> dict[str, Any]:
    bars: dict[str, Any] = {}
    for name, estimate in (("xerr", found.cost), ("yerr", found.error)):
        value, low, high = (v[which] for v in (estimate.value, estimate.low, estimate.high))
        bars[name] = np.maximum(np.stack([value - low, high - value]), 0.0)
    return bars
