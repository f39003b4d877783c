"""The leaderboard as a forest plot: means with intervals, and differences to the best."""

from typing import TYPE_CHECKING

import numpy as np

from sweeps.analysis.entries import bounds_of, sign_of
from sweeps.analysis.paired import Paired
from sweeps.figures.style import COLOURS, distinct_labels, drawing, figure, metric_label
from sweeps.figures.style import FARTHEST as FARTHEST_MEANS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MOST_ENTRIES = 20
"""Entries shown, the best ones."""
THICK, THIN = "thick, these objects", "thin, objects like these"
"""What lines are of."""
FARTHEST = 1.0
"""How far beyond means and intervals of these objects the frame reaches for those of objects like
these, in widths of all the former: of two objects the latter may be thousands of times as wide."""


def draw_forest(paired: Paired, metric: str) -> "Figure":
    """Left each entry's mean with its 95 % interval, right its difference to the best.

    Thick lines are intervals of these objects, thin ones of objects like these; what is not known
    is neither drawn nor explained.
    """
    exact, means = paired.statistics(metric), paired.means[metric]
    sign = sign_of(metric)
    key = np.where(np.isfinite(means[0]), sign * means[0], np.inf)
    order = sorted(range(len(paired.labels)), key=lambda n: (key[n], paired.labels[n]))
    count, order = len(order), order[:MOST_ENTRIES]
    place = np.arange(len(order))
    names, keys = distinct_labels([paired.labels[n] for n in order], 26)
    with drawing():
        drawn = figure(0.75 + 0.17 * len(order) + (0.12 if keys else 0.0))
        left, right = drawn.subplots(1, 2, sharey=True, width_ratios=(1.25, 1.0))
        cut, drawn_of = False, set[str]()
        most = FARTHEST_MEANS * float(np.nanmax(np.abs(means[0, order]), initial=0.0))
        for axes, value, colour, interval in (
                (left, means[0], COLOURS[0],
                 lambda over: exact.values(over, bounds_of(metric))),
                (right, means[0] - means[0, order[0]], COLOURS[1],
                 lambda over: exact.differences(order[0], over))):
            these, like = ([found.low[order], found.high[order]]
                           for found in (interval("these"), interval("like-these")))
            drawn_of |= {words for words, ends in ((THICK, these), (THIN, like))
                         if np.isfinite(ends).any()}
            axes.hlines(place, *like, color=colour, lw=0.6)
            axes.hlines(place, *these, color=colour, lw=1.8)
            axes.plot(value[order], place, "o", color=colour, ms=3.2, zorder=3)
            axes.margins(x=0.06)
            cut |= _framed(axes, [*these, value[order]], like, most)
            axes.grid(axis="x", lw=0.3, color="#d0d0d0")
            axes.tick_params(axis="y", length=0)
        left.set_yticks(place, names)
        right.axvline(0.0, color="#555555", lw=0.6)
        left.set_ylim(len(order) - 0.4, -0.6)
        left.set_title("mean" if count == len(order) else f"best {len(order)} of {count}: mean")
        right.set_title("minus the best")
        of = "; ".join(sorted(drawn_of, key=[THICK, THIN].index))
        drawn.supxlabel(metric_label(metric) + (f"; 95 % intervals:\n{of}" if of else "")
                        + (" (cut at the frame)" if cut else "") + (f"\n{keys}" if keys else ""),
                        fontsize=7.0)
    return drawn


def _framed(axes: "Axes", inner: list[np.ndarray], outer: list[np.ndarray], most: float) -> bool:
    """Cuts what is far beyond all of `inner`, or beyond `most`, at the frame; whether anything is.
    """
    known, beyond = (values[np.isfinite(values)] for values in map(
        np.concatenate, (inner, inner + outer)))
    if not len(known):
        return False
    known = np.clip(known, -most, most)
    wide = FARTHEST * float(np.ptp(known))
    low, high = known.min() - wide, known.max() + wide
    if wide == 0.0 or (low <= beyond.min() and beyond.max() <= high):
        return False
    edge = 0.05 * float(np.ptp(known))
    axes.set_xlim(max(low, beyond.min() - edge), min(high, beyond.max() + edge))
    return True
