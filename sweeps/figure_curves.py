"""Error against touches or robot time, a line a strategy, with bands of 95 %."""

from typing import TYPE_CHECKING

import numpy as np

from sweeps.curves import Curves, grid_of, mean_curve
from sweeps.figure_style import COLOURS, DASHES, MUTED, cut, drawing, figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LABELS = {"touches": "touches [1]", "time_s": "robot time [s]"}


def draw_curves(curves: Curves, axis: str) -> "Figure":
    """The best eight by their last error in colour, the others grey."""
    grid = grid_of(curves, axis)
    found = [mean_curve(curves, axis, n, grid) for n in range(len(curves.labels))]
    last = [estimate.value[-1] if np.isfinite(estimate.value[-1]) else np.inf
            for estimate in found]
    order = sorted(range(len(found)), key=lambda n: (last[n], curves.labels[n]))
    shown = order[:len(COLOURS)]
    with drawing():
        drawn = figure(2.3 + 0.12 * ((len(shown) + 1) // 2))
        axes = drawn.add_subplot()
        for place, n in enumerate(shown):
            colour = COLOURS[place]
            axes.fill_between(grid, found[n].low, found[n].high, step="post", color=colour,
                              alpha=0.13, lw=0)
            axes.step(grid, found[n].value, where="post", color=colour,
                      ls=DASHES[place], label=cut(curves.labels[n], 24))
            known = np.flatnonzero(np.isfinite(found[n].value))
            if len(known) == 1 or (len(known) and known[0] == len(grid) - 1):
                axes.plot(grid[known], found[n].value[known], "o", color=colour, ms=3)
        for n in order[len(COLOURS):]:
            axes.step(grid, found[n].value, where="post", color=MUTED, lw=0.6, zorder=1,
                      label="others" if n == order[len(COLOURS)] else None)
        for bound in (5.0, 3.0):
            axes.axhline(bound, color="#555555", lw=0.4, ls=":")
        axes.set(xlabel=LABELS[axis], ylabel="chamfer distance [mm]", xlim=(0, 1.02 * grid[-1]))
        axes.set_ylim(bottom=0)
        drawn.legend(loc="outside lower center", ncols=2, handlelength=3.2)
    return drawn
