"""Error against touches or robot time, a line for each strategy, with 95 % intervals."""

from typing import TYPE_CHECKING

import numpy as np

from sweeps.analysis.curves import Curves, grid_of, mean_curve
from sweeps.figures.style import COLOURS, DASHES, MARKERS, MUTED, distinct_labels, drawing, figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure
LABELS = {"touches": "touches", "time_s": "robot time [s]"}
BANDS = 3  # more would hide one another
MANY = 20  # others, whose lines are then thin


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
