"""Error against touches, robot time or what was swept, a line a strategy, with 95 % intervals."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sweeps.analysis.curves import Curves, grid_of, mean_curve
from sweeps.analysis.entries import sign_of, value_text
from sweeps.analysis.paired import Paired
from sweeps.analysis.settings import Effect, effects
from sweeps.figures.style import (
    COLOURS,
    DASHES,
    MARGIN,
    MARKERS,
    MUTED,
    cut_apart,
    distinct_labels,
    drawing,
    farthest_end,
    figure,
    framed,
    looks_of,
    metric_label,
    order_of,
    slant,
)
from sweeps.run.plan import Plan

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
LABELS = {"touches": "touches", "time_s": "robot time [s]"}
BANDS = 3  # more would hide one another
MANY = 20  # others, whose lines are then thin
DECADES = 1.3  # positive numbers that span more have a logarithmic axis
TICKED = 2.5  # decades of which more have ticks at powers of ten alone
UNLIKE = 5.0  # times as long as another: then the axis is logarithmic
CHARACTERS = 40.0  # of a tick's text beside each other between the first and the last level
LABEL = 24  # characters of a strategy's name
APART = 0.015  # between strategies at one level, in widths of the axis


def draw_curves(curves: Curves, axis: str) -> "Figure":
    """The best eight by their last error in colour, the others grey; a line goes from fit to fit
    and ends, with a mark, where the last of its episodes did. One that was fitted once has no line:
    its mark stands where its episodes ended in the mean.

    Bars show the intervals at the end; for up to three entries bands show them along the curves.
    """
    grids = [grid_of(curves, axis, n) for n in range(len(curves.labels))]
    found = [mean_curve(curves, axis, n, grid) for n, grid in enumerate(grids)]
    last = np.array([estimate.value[-1] for estimate in found])
    order = order_of(last, curves.labels)
    looks = looks_of(last, curves.labels)
    shown, others = order[:len(COLOURS)], order[len(COLOURS):]
    names, keys = distinct_labels(curves.labels, 24)
    with drawing():
        drawn = figure(2.3 + 0.12 * ((len(shown) + 1 + bool(others)) // 2 + bool(keys)))
        axes, ends = drawn.subplots(1, 2, sharey=True, width_ratios=(4.2, 1.0))
        places, stops, highs = list[float](), list[float](), list[np.ndarray]()
        for place, n in enumerate(shown):
            grid, known = grids[n], np.flatnonzero(np.isfinite(found[n].value))
            once = curves.fits_once(n)
            stops.append(_mean_end(curves, axis, n) if once else grid[-1])
            places += [stops[-1], *(() if once else grid[known])]
            highs.append(found[n].high if len(shown) <= BANDS else found[n].high[-1:])
            colour, marker = looks[n].colour, looks[n].marker
            ends.vlines(place, found[n].low[-1], found[n].high[-1], color=colour, lw=1.2)
            ends.plot(place, found[n].value[-1], marker, color=colour, ms=3)
            if once:
                axes.plot(stops[-1], found[n].value[-1], marker, ms=3, ls="none", color=colour,
                          label=names[n])
                continue
            axes.step(grid, found[n].value, where="post", color=colour, ls=looks[n].dash,
                      marker=marker, ms=3, markevery=known[:1].tolist(), label=names[n])
            axes.plot(grid[-1], found[n].value[-1], "|", color=colour, ms=6, mew=1.2)
            if len(shown) <= BANDS:
                axes.fill_between(grid, found[n].low, found[n].high, step="post",
                                  color=colour, alpha=0.2, lw=0)
        for n in others:
            axes.step(grids[n], found[n].value, where="post", color=MUTED,
                      lw=0.6 if len(others) <= MANY else 0.2, zorder=1,
                      label=f"{len(others)} others" if n == others[0] else None)
            places += list(grids[n][np.isfinite(found[n].value)])
            stops.append(grids[n][-1])
        _scale(axes, LABELS[axis], places, stops)
        axes.set_ylabel("chamfer distance [mm]")
        axes.grid(axis="y", lw=0.3, color="#d0d0d0")
        last_means, highest = (np.array([found[n].value[-1] for n in shown]),
                               np.concatenate([each.value for each in found]))
        end = farthest_end(last_means, np.concatenate(highs))
        axes.set_ylim(0.0, end and max(end, (1.0 + MARGIN) * np.nanmax(highest)))
        ends.grid(axis="y", lw=0.3, color="#d0d0d0")
        ends.set(xticks=[], xlim=(-0.7, len(shown) - 0.3))
        known = any(np.isfinite(each[-1]) for each in highs)
        ends.set_xlabel("at the end" + (",\n95 %" + " (cut)" * bool(end) if known else
                                       "\n(95 % cut)" if end else ""))
        ends.tick_params(axis="y", length=0)
        drawn.legend(loc="outside lower center", ncols=2, handlelength=3.2, title=keys,
                     title_fontsize=6.5)
    return drawn


def _mean_end(curves: Curves, axis: str, entry: int) -> float:
    """Where an entry's episodes ended, in the mean over objects."""
    means = [np.mean(ends) for found in curves.steps[axis]
             if (ends := [at[-1] for at, _ in found[entry] if np.isfinite(at[-1])])]
    return float(np.mean(means)) if means else float("nan")


def _scale(axes: "Axes", label: str, places: Sequence[float], ends: Sequence[float]) -> None:
    """The axis of touches or time, logarithmic where entries differ much in their `ends`."""
    from matplotlib.ticker import SymmetricalLogLocator

    positive = [place for place in places if place > 0.0]
    most, least = max(positive, default=1.0), min(positive, default=1.0)
    if max(ends) <= UNLIKE * min((end for end in ends if end > 0.0), default=most):
        axes.set(xlabel=label, xlim=(-0.02 * most if min(places) <= 0.0 else 0.0, 1.02 * most))
        return
    axes.set_xscale("symlog", linthresh=least, linscale=0.3)
    axes.xaxis.set_major_locator(SymmetricalLogLocator(
        base=10.0, linthresh=least, subs=(1.0,) if most > least * 10.0**TICKED else (1, 2, 5)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set(xlabel=f"{label}, logarithmic",
             xlim=(-0.2 * least if min(places) <= 0.0 else 0.85 * least, 1.1 * most))


def draw_levels(plan: Plan, paired: Paired, metric: str) -> "Figure":
    """A panel for each swept factor: the mean at each of its levels, a line for each strategy.

    The best eight strategies by their best level are in colour, with intervals; the others grey.
    Where all factors are sampled a strategy is one entry, and has its place in the leaderboard and
    the colour that it has elsewhere.
    """
    found = list(effects(plan, paired, metric, cut=False))
    names = _ranked(plan, paired, metric, found)
    factors = [key for axis in plan.study.axes for key in axis.keys
               if any(effect.factor == key for effect in found)]
    legend = min(len(names), len(COLOURS) + 1)
    with drawing():
        drawn = figure(0.35 + 1.55 * len(factors) + 0.12 * ((legend + 1) // 2))
        panels = drawn.subplots(len(factors), 1, squeeze=False, sharey=True)[:, 0]
        for axes, factor in zip(panels, factors, strict=True):
            _draw_factor(axes, [effect for effect in found if effect.factor == factor], names)
        coloured = [effect for effect in found if effect.strategy in names[:len(COLOURS)]]
        limits = framed(np.concatenate([effect.value for effect in found]),
                        *(np.concatenate([getattr(effect, end) for effect in coloured])
                          for end in ("low", "high")))
        panels[0].set_ylim(limits)
        drawn.supylabel(metric_label(metric) + (
            "\n(intervals are cut at the frame)" if limits else ""), fontsize=7.0)
        lines = {str(line.get_label()): line for line in sorted(
            (line for axes in reversed(panels) for line in axes.get_lines()[::-1]),
            key=lambda line: line.get_linestyle() != "None")}
        ranked = [name for name in (*cut_apart(names, LABEL), *lines) if name in lines]
        ranked = list(dict.fromkeys(ranked))
        drawn.legend([lines[name] for name in ranked], ranked, loc="outside lower center", ncols=2,
                     handlelength=3.2)
    return drawn


def _ranked(plan: Plan, paired: Paired, metric: str, found: Sequence[Effect]) -> list[str]:
    """Strategies that have a line, the best first."""
    best: dict[str, float] = {}
    sign, whole = sign_of(metric), all(axis.sampled for axis in plan.study.axes)
    of_entry = np.array([entry.strategy for entry in paired.entries])
    means = [sign * paired.means[metric][0, of_entry == number].mean()
             for number in range(len(plan.study.strategies))]
    places = {strategy.name: mean
              for strategy, mean in zip(plan.study.strategies, means, strict=True)}
    for effect in found:
        values = sign * effect.value[np.isfinite(effect.value)]
        best[effect.strategy] = (places[effect.strategy] if whole else
                                 min(best.get(effect.strategy, np.inf), *values, np.inf))
    labels = list(best)
    return [labels[n] for n in order_of(np.array(list(best.values())), labels)]


def _draw_factor(axes: "Axes", shown: Sequence[Effect], names: Sequence[str]) -> None:
    """One factor's lines; `names` are the strategies of all panels, the best first."""
    from matplotlib.ticker import NullLocator

    at, label = shown[0].at, shown[0].factor
    if at is None:
        at = np.arange(len(shown[0].levels), dtype=float)
        axes.set_xticks(at, cut_apart(shown[0].levels, 18 if len(at) > 3 else 42 // len(at)),
                        rotation=slant(len(at)) if len(at) > 3 else 0,
                        ha="right" if len(at) > 3 else "center", rotation_mode="anchor")
    else:
        if at.min() > 0.0 and at.max() > at.min() * 10.0**DECADES:
            axes.set_xscale("log")
            axes.xaxis.set_minor_locator(NullLocator())
        ticks = _ticks_apart(np.log(at) if axes.get_xscale() == "log" else at,
                             [value_text(float(f"{value:.4g}")) for value in at])
        axes.set_xticks(at[list(ticks)], list(ticks.values()))
        label += " (points side by side)" * (len(names) > 1)
    scaled, undone = (np.log, np.exp) if axes.get_xscale() == "log" else (np.asarray, np.asarray)
    steps, beside = np.diff(np.sort(scaled(at))), min(len(names), len(COLOURS))
    apart = min(APART * steps.sum(), 0.7 * steps.min(initial=np.inf) / beside)
    short = dict(zip(names, cut_apart(names, LABEL), strict=True))
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
    axes.set_xlabel(label)
    axes.grid(axis="y", lw=0.3, color="#d0d0d0")


def _ticks_apart(places: np.ndarray, texts: Sequence[str]) -> dict[int, str]:
    """Of levels at these places of an axis, those whose texts have room, both ends first."""
    order = np.argsort(places).tolist()
    kept: list[int] = []
    for n in dict.fromkeys([order[0], order[-1], *order[1:-1]]):
        room = [abs(places[n] - places[k]) / max(np.ptp(places), 1e-12) * CHARACTERS
                - (len(texts[n]) + len(texts[k])) / 2 - 1.5 for k in kept]
        if min(room, default=1.0) > 0.0:
            kept.append(n)
    return {n: texts[n] for n in sorted(kept)}
