"""The picture of a race: how many entries were left, and who left when."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sweeps.figures.style import COLOURS, MUTED, distinct_labels, drawing, figure
from sweeps.race.race_note import taking_part
from sweeps.race.verdict import Verdict, amount, claim

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

NAMED = 6
"""Entries whose names are written below."""


def draw_race(found: Verdict) -> "Figure":
    """Above the entries still taking episodes, below each entry at its last rung: by how much it
    is worse than the winner, and for the tied ones from where that may be."""
    with drawing():
        drawn = figure(4.1)
        upper, lower = drawn.subplots(2, 1, sharex=True, height_ratios=(1.0, 2.0))
        _draw_left(upper, found)
        _draw_entries(lower, found)
        drawn.suptitle(claim(found), fontsize=6.5)
        drawn.supxlabel(_best_few(found), x=0.02, ha="left", fontsize=5.5)
    return drawn


def _draw_left(axes: "Axes", found: Verdict) -> None:
    """Entries in each rung, over the replicates after it."""
    most = [int(look.replicates.max()) for look in found.looks]
    taking = taking_part(found.looks)
    axes.step([most[0], *most], [taking[0], *taking], where="pre", color=COLOURS[0])
    axes.plot(most, taking, "o", color=COLOURS[0], ms=2.0)
    axes.set_yscale("log")
    axes.set_ylim(0.8, 1.6 * taking[0])
    _number_axis(axes.yaxis, [10.0**n for n in range(8) if 10.0**n <= taking[0]])
    axes.set_ylabel("entries in a rung")
    axes.grid(lw=0.3, color="#d0d0d0")


def _draw_entries(axes: "Axes", found: Verdict) -> None:
    last = found.last
    kinds = (("worse", last.out, MUTED, "x"), ("open", last.open, COLOURS[4], "D"),
             ("tied", last.tied & ~last.open, COLOURS[1], "o"))
    leader = np.arange(len(found.labels)) == last.leader
    for name, chosen, colour, marker in kinds:
        chosen = chosen & ~leader
        if not chosen.any():
            continue
        if name != "worse":
            axes.vlines(last.replicates[chosen], last.lower[chosen], last.difference[chosen],
                        color=colour, lw=0.5, alpha=0.6)
        axes.plot(last.replicates[chosen], last.difference[chosen], marker, color=colour, ms=2.6,
                  mew=0.6, label=f"{name} ({int(chosen.sum()):,})")
    axes.plot(last.replicates[leader], [0.0], "*", color=COLOURS[2], ms=7.0, label="best")
    axes.axhline(-found.rules.within, color="#555555", lw=0.6, ls="--")
    axes.set_xscale("log")
    axes.set_yscale("symlog", linthresh=4.0 * found.rules.within, linscale=1.0)
    _plain_ticks(axes, found)
    what = "objects" if found.over == "like-these" else "episodes on each object"
    axes.set_xlabel(f"{what} that an entry took")
    axes.set_ylabel(f"{found.metric} minus the best;\nlines from the lower bound")
    axes.legend(loc="upper right", handletextpad=0.3, borderaxespad=0.1)
    axes.grid(lw=0.3, color="#d0d0d0")


def _plain_ticks(axes: "Axes", found: Verdict) -> None:
    """Numbers of replicates and differences as such, not as powers."""
    counts: list[float] = []
    for look in found.looks:
        most = float(look.replicates.max())
        if not counts or most > 1.6 * counts[-1]:
            counts.append(most)
    _number_axis(axes.xaxis, counts)
    high = float(found.last.difference.max())
    _number_axis(axes.yaxis, [-found.rules.within, 0.0] + [
        tick for tick in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
        if 2.0 * found.rules.within < tick <= max(high, 1.0)])


def _number_axis(axis: "Axis", ticks: Sequence[float]) -> None:
    """Ticks at these values alone, written as plain numbers."""
    from matplotlib.ticker import FixedFormatter, FixedLocator, NullLocator

    axis.set_major_locator(FixedLocator(list(ticks)))
    axis.set_major_formatter(FixedFormatter([f"{tick:g}" for tick in ticks]))
    axis.set_minor_locator(NullLocator())


def _best_few(found: Verdict) -> str:
    """The names of the best few, a line each."""
    few = found.order[:NAMED]
    names, keys = distinct_labels([found.labels[n] for n in few], 48)
    lines = textwrap.wrap(keys, 72)
    for n, name in zip(few, names, strict=True):
        behind = amount(float(found.last.difference[n]), found.metric)
        lines.append(f"{name}: {'best' if n == found.last.leader else f'+{behind}'}")
    return "\n".join(lines)
