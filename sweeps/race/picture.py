"""The picture of a race: how many entries were left, and who left when."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sweeps.figures.style import UNITS, VERDICTS, distinct_labels, drawing, figure
from sweeps.race.race_note import taking_part
from sweeps.race.verdict import Verdict, amount, claim, verdict_word

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

LINEAR = 4.0
"""Margins up to which differences have a linear scale."""
MOST_TICKS = 8
"""On an axis."""
NAMED = 6
"""Entries whose names are written below."""


def draw_race(found: Verdict) -> "Figure":
    """Above the entries still taking episodes, below each entry at its last rung: by how much it
    is worse than the winner, and for those not known to be worse from where that may be."""
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
    axes.step([most[0], *most], [taking[0], *taking], where="pre", color=VERDICTS["open"])
    axes.plot(most, taking, "o", color=VERDICTS["open"], ms=2.0)
    axes.set_yscale("log")
    axes.set_ylim(0.8, 1.6 * taking[0])
    tens = [10.0**n for n in range(8) if 10.0**n <= taking[0]]
    _number_axis(axes.yaxis, _spaced([taking[0], taking[-1], *tens, *taking],
                                     (2.0 * taking[0]) ** (1.0 / MOST_TICKS)))
    axes.set_ylabel("entries in a rung\n(log scale)")
    axes.grid(lw=0.3, color="#d0d0d0")


def _draw_entries(axes: "Axes", found: Verdict) -> None:
    last = found.last
    kinds = (("worse", last.out, "x"), ("open", last.open, "D"),
             ("tied", last.tied & ~last.open, "o"))
    leader = np.arange(len(found.labels)) == last.leader
    for name, chosen, marker in kinds:
        chosen, colour = chosen & ~leader, VERDICTS[name]
        if not chosen.any():
            continue
        if name != "worse":
            axes.vlines(last.replicates[chosen], found.at_least[chosen], last.difference[chosen],
                        color=colour, lw=0.5, alpha=0.6)
        axes.plot(last.replicates[chosen], last.difference[chosen], marker, color=colour, ms=2.6,
                  mew=0.6, label=f"{verdict_word(name)} ({int(chosen.sum()):,})")
    axes.plot(last.replicates[leader], [0.0], "*", color=VERDICTS["best"], ms=7.0, label="best")
    axes.axhline(-found.rules.within, color="#555555", lw=0.6, ls="--")
    axes.set_xscale("log")
    linear = LINEAR * found.rules.within
    axes.set_yscale("symlog", linthresh=linear, linscale=1.0)
    _plain_ticks(axes, found)
    on_each = "" if found.over == "like-these" else " on each object"
    axes.set_xlabel(f"{'episodes' if on_each else 'objects'} of an entry{on_each} (log scale)")
    axes.set_ylabel(f"{UNITS.get(found.metric, found.metric)}:\nworse than the best by, with the "
                    f"lower\nbound (log scale from {amount(linear, found.metric)} on)")
    axes.legend(loc="upper right", handletextpad=0.3, borderaxespad=0.1)
    axes.grid(lw=0.3, color="#d0d0d0")


def _plain_ticks(axes: "Axes", found: Verdict) -> None:
    """The rungs' own numbers of replicates, and differences, as such, not as powers."""
    most = [float(look.replicates.max()) for look in found.looks]
    _number_axis(axes.xaxis, _spaced([most[-1], most[0], *most],
                                     max(1.2, (most[-1] / most[0]) ** (1.0 / MOST_TICKS))))
    within, high = found.rules.within, float(found.last.difference.max())
    top = _round_from(max(high, LINEAR * within))
    logs = _spaced([top, *(_round_from(top / 10 ** (n / 3)) for n in range(1, 30))],
                   max(1.9, (top / within) ** (1.0 / MOST_TICKS)))
    _number_axis(axes.yaxis, [-within, 0.0, 2.0 * within, *(
        tick for tick in logs if tick > 0.9 * LINEAR * within)])
    axes.set_ylim(top=1.1 * top)


def _round_from(value: float) -> float:
    """The least number with one digit of 1, 2 or 5 that is not below `value`."""
    power = 10.0 ** np.floor(np.log10(value) + 1e-9)
    return float(next(digit * power for digit in (1, 2, 5, 10) if digit * power > 0.999 * value))


def _spaced(values: Sequence[float], ratio: float) -> list[float]:
    """Those of some positive numbers that are apart by a ratio; the first ones have precedence."""
    kept: list[float] = []
    for value in values:
        if all(max(value, other) >= ratio * min(value, other) for other in kept):
            kept.append(value)
    return sorted(kept)


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
