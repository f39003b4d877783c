"""The picture of a race: how many entries were left, and who left when."""

from typing import TYPE_CHECKING

import numpy as np

from sweeps.figures.style import COLOURS, MUTED, distinct_labels, drawing, figure
from sweeps.race.verdict import Verdict, amount, claim

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAMED = 6
"""Entries whose names stand beside their points."""


def draw_race(found: Verdict) -> "Figure":
    """Above the entries still taking episodes, below each entry at its last rung: by how much it
    is worse than the winner, and for the tied ones from where that may be."""
    with drawing():
        drawn = figure(3.6)
        upper, lower = drawn.subplots(2, 1, sharex=True, height_ratios=(1.0, 2.0))
        _draw_left(upper, found)
        _draw_entries(lower, found)
        drawn.suptitle(claim(found), fontsize=6.5)
    return drawn


def _draw_left(axes: "Axes", found: Verdict) -> None:
    """Entries in each rung, over the replicates after it."""
    most = [int(look.replicates.max()) for look in found.looks]
    before = [np.zeros_like(found.episodes), *(look.replicates for look in found.looks)]
    taking = [int((look.replicates > earlier).sum())
              for look, earlier in zip(found.looks, before, strict=False)]
    axes.step([most[0], *most], [taking[0], *taking], where="pre", color=COLOURS[0])
    axes.plot(most, taking, "o", color=COLOURS[0], ms=2.0)
    axes.set_yscale("log")
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
    axes.set_ylabel(f"{found.metric}: minus the best;\nlines: from the lower bound")
    axes.legend(loc="upper right", handletextpad=0.3, borderaxespad=0.1)
    axes.grid(lw=0.3, color="#d0d0d0")
    _name(axes, found)


def _plain_ticks(axes: "Axes", found: Verdict) -> None:
    """Numbers of replicates and differences as such, not as powers."""
    from matplotlib.ticker import FixedLocator, NullLocator, ScalarFormatter

    counts = sorted({int(look.replicates.max()) for look in found.looks})
    shown = [c for n, c in enumerate(counts) if n % max(1, len(counts) // 6) == 0]
    axes.xaxis.set_major_locator(FixedLocator(shown))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(ScalarFormatter())
    high = float(found.last.difference.max())
    ticks = [-found.rules.within, 0.0] + [
        t for t in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)
        if 2.0 * found.rules.within < t <= max(high, 1.0)]
    axes.yaxis.set_major_locator(FixedLocator(ticks))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_yticks(ticks, [f"{t:g}" for t in ticks])


def _name(axes: "Axes", found: Verdict) -> None:
    """The best few, as a list in the corner."""
    few = [int(n) for n in found.order[:NAMED]]
    names, keys = distinct_labels([found.labels[n] for n in few], 34)
    lines = [f"{name}  +{amount(float(found.last.difference[n]), found.metric)}" if number else
             f"{name}  best" for number, (n, name) in enumerate(zip(few, names, strict=True))]
    text = "\n".join([*([keys] if keys else []), *lines])
    axes.annotate(text, (0.0, -0.28), xycoords="axes fraction", va="top", fontsize=5.5,
                  annotation_clip=False)
