"""Error against touches, robot time or what was swept, a line a strategy, with 95 % intervals."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sweeps.analysis.curves import Curves, grid_of, mean_curve
from sweeps.analysis.entries import HIGHER_IS_BETTER
from sweeps.analysis.paired import Paired
from sweeps.analysis.settings import Effect, effects
from sweeps.figures.style import (
    COLOURS,
    DASHES,
    MARKERS,
    MUTED,
    cut_apart,
    distinct_labels,
    drawing,
    figure,
    metric_label,
)
from sweeps.run.plan import Plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
LABELS = {"touches": "touches", "time_s": "robot time [s]"}
BANDS = 3  # more would hide one another
MANY = 20  # others, whose lines are then thin
DECADES = 1.3  # positive numbers that span more have a logarithmic axis
APART = 0.015  # between strategies at one level, in widths of the axis


def draw_curves(curves: Curves, axis: str) -> "Figure":
    """The best eight by their last error in colour, the others grey; a line ends, with a mark,
    where the last of its episodes did. One that was fitted once has no line: its mark stands where
    its episodes ended in the mean.

    Bars show the intervals at the end; for up to three entries bands show them along the curves.
    """
    grid = grid_of(curves, axis)
    found = [mean_curve(curves, axis, n, grid) for n in range(len(curves.labels))]
    last = [estimate.value[-1] if np.isfinite(estimate.value[-1]) else np.inf
            for estimate in found]
    order = sorted(range(len(found)), key=lambda n: (last[n], curves.labels[n]))
    shown, others = order[:len(COLOURS)], order[len(COLOURS):]
    names, keys = distinct_labels(curves.labels, 24)
    with drawing():
        drawn = figure(2.3 + 0.12 * ((len(shown) + 1 + bool(others)) // 2 + bool(keys)))
        axes, ends = drawn.subplots(1, 2, sharey=True, width_ratios=(4.2, 1.0))
        for place, n in enumerate(shown):
            known = np.flatnonzero(np.isfinite(found[n].value))
            ends.vlines(place, found[n].low[-1], found[n].high[-1], color=COLOURS[place], lw=1.2)
            ends.plot(place, found[n].value[-1], MARKERS[place], color=COLOURS[place], ms=3)
            if curves.fits_once(n):
                axes.plot(_mean_end(curves, axis, n), found[n].value[-1], MARKERS[place], ms=3,
                          ls="none", color=COLOURS[place], label=names[n])
                continue
            until, end = _while_exploring(curves, axis, n, grid, found[n].value)
            axes.step(grid, until, where="post", color=COLOURS[place], ls=DASHES[place],
                      marker=MARKERS[place], ms=3, markevery=known[:1].tolist(), label=names[n])
            axes.plot(end, found[n].value[-1], "|", color=COLOURS[place], ms=6, mew=1.2)
            if len(shown) <= BANDS:
                axes.fill_between(grid, found[n].low, found[n].high, step="post",
                                  color=COLOURS[place], alpha=0.2, lw=0)
        for n in others:
            axes.step(grid, _while_exploring(curves, axis, n, grid, found[n].value)[0],
                      where="post", color=MUTED, lw=0.6 if len(others) <= MANY else 0.2, zorder=1,
                      label=f"{len(others)} others" if n == others[0] else None)
        axes.set(xlabel=LABELS[axis], ylabel="chamfer distance [mm]", xlim=(0, 1.02 * grid[-1]))
        axes.grid(axis="y", lw=0.3, color="#d0d0d0")
        axes.set_ylim(bottom=0)
        ends.grid(axis="y", lw=0.3, color="#d0d0d0")
        ends.set(xticks=[], xlim=(-0.7, len(shown) - 0.3))
        ends.set_xlabel("at the end,\n95 %")
        ends.tick_params(axis="y", length=0)
        drawn.legend(loc="outside lower center", ncols=2, handlelength=3.2, title=keys,
                     title_fontsize=6.5)
    return drawn


def _mean_end(curves: Curves, axis: str, entry: int) -> float:
    """Where an entry's episodes ended, in the mean over objects."""
    means = [np.mean(ends) for found in curves.steps[axis]
             if (ends := [at[-1] for at, _ in found[entry] if np.isfinite(at[-1])])]
    return float(np.mean(means)) if means else float("nan")


def _while_exploring(curves: Curves, axis: str, entry: int, grid: np.ndarray, value: np.ndarray
                     ) -> tuple[np.ndarray, float]:
    """An entry's curve up to where the last of its episodes ended, NaN beyond, and that place."""
    ends = [at[-1] for found in curves.steps[axis] for at, _ in found[entry]
            if np.isfinite(at[-1])]
    end = max(ends, default=0.0)
    step = grid[1] - grid[0] if len(grid) > 1 else 0.0
    return np.where(grid < end + step, value, np.nan), end


def draw_levels(plan: Plan, paired: Paired, metric: str) -> "Figure":
    """A panel for each swept factor: the mean at each of its levels, a line for each strategy.

    The best eight strategies by their best level are in colour, with intervals; the others grey.
    """
    found = list(effects(plan, paired, metric, cut=False))
    sign = -1.0 if metric in HIGHER_IS_BETTER else 1.0
    best: dict[str, float] = {}
    for effect in found:
        values = sign * effect.value[np.isfinite(effect.value)]
        best[effect.strategy] = min(best.get(effect.strategy, np.inf), *values, np.inf)
    names = sorted(best, key=lambda name: (best[name], name))
    factors = [key for axis in plan.study.axes for key in axis.keys
               if any(effect.factor == key for effect in found)]
    legend = min(len(names), len(COLOURS) + 1)
    with drawing():
        drawn = figure(0.35 + 1.55 * len(factors) + 0.12 * ((legend + 1) // 2))
        panels = drawn.subplots(len(factors), 1, squeeze=False, sharey=True)[:, 0]
        for axes, factor in zip(panels, factors, strict=True):
            _draw_factor(axes, [effect for effect in found if effect.factor == factor], names)
        drawn.supylabel(metric_label(metric), fontsize=7.0)
        lines = {str(line.get_label()): line for axes in reversed(panels)
                 for line in axes.get_lines()[::-1]}
        drawn.legend(lines.values(), lines.keys(), loc="outside lower center", ncols=2,
                     handlelength=3.2)
    return drawn


def _draw_factor(axes: "Axes", shown: Sequence[Effect], names: Sequence[str]) -> None:
    """One factor's lines; `names` are the strategies of all panels, the best first."""
    from matplotlib.ticker import LogLocator

    at = shown[0].at
    if at is None:
        at = np.arange(len(shown[0].levels), dtype=float)
        axes.set_xticks(at, cut_apart(shown[0].levels, 18),
                        rotation=25 if len(at) > 3 else 0,
                        ha="right" if len(at) > 3 else "center", rotation_mode="anchor")
    elif at.min() > 0.0 and at.max() > at.min() * 10.0**DECADES:
        axes.set_xscale("log")
        axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("")
    scaled, undone = (np.log, np.exp) if axes.get_xscale() == "log" else (np.asarray, np.asarray)
    steps, beside = np.diff(np.sort(scaled(at))), min(len(names), len(COLOURS))
    apart = min(APART * steps.sum(), 0.7 * steps.min(initial=np.inf) / beside)
    short = dict(zip(names, cut_apart(names, 24), strict=True))
    for effect in sorted(shown, key=lambda e: -names.index(e.strategy)):  # the best on top
        place, mine = names.index(effect.strategy), at if effect.at is None else effect.at
        if place >= len(COLOURS):
            axes.plot(np.sort(mine), effect.value[np.argsort(mine)], color=MUTED, lw=0.6, zorder=1,
                      label=f"{len(names) - len(COLOURS)} others")
            continue
        x = undone(scaled(mine) + apart * (place - (beside - 1) / 2))
        order = np.argsort(x)
        axes.vlines(x, effect.low, effect.high, color=COLOURS[place], lw=0.8)
        axes.plot(x[order], effect.value[order], color=COLOURS[place],
                  ls="none" if effect.at is None else DASHES[place],
                  marker=MARKERS[place], ms=3, label=short[effect.strategy])
    axes.set_xlabel(shown[0].factor)
    axes.grid(axis="y", lw=0.3, color="#d0d0d0")
