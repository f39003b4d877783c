"""Heat maps: the confusion matrix of an entry, and the means at each level of swept factors."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sweeps.analysis.confusion import Confusion
from sweeps.analysis.entries import LeaderboardError
from sweeps.analysis.paired import Paired
from sweeps.analysis.settings import effects
from sweeps.figures.style import COLUMN_IN, UNITS, cut, cut_apart, drawing, figure
from sweeps.run.plan import Plan
from sweeps.spec.errors import choose
from sweeps.text_table import number_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure
COLOUR_COUNT = 47
"""Odd, for the middle of a diverging map; matplotlib rasterizes colour bars of 49 and more."""
LEAST_IN = 2.1
"""Inches of height that the colour bar's label needs."""


def draw_confusion(found: Confusion, label: str | None = None) -> "Figure":
    """The matrix of the entry `label`, by default of the one that is right most often.

    Raises LeaderboardError for an unknown entry, and where none names the object.
    """
    if not found.labels:
        raise LeaderboardError("confusion: no strategy of this study names what it felt")
    if label is None:
        label = max(found.labels, key=lambda name: found.recognized[name])
    if label not in found.labels:
        raise LeaderboardError(f"--strategy: no strategy {label!r}; {choose(label, found.labels)}")
    counts = np.array([[found.counts[label, body][answer] for answer in found.answers]
                       for body in found.objects], float)
    share = counts / counts.sum(axis=1, keepdims=True)
    with drawing():
        drawn = figure(COLUMN_IN * (0.45 + 0.07 * len(found.objects)))
        axes = drawn.add_subplot()
        text = [[f"{100 * value:.0f}" if value > 0 else "" for value in row] for row in share]
        cells = _heat_map(axes, share, "Blues", (0.0, 1.0), text, share > 0.5)
        axes.set_xticks(range(len(found.answers)), cut_apart(found.answers, 18),
                        rotation=60, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(len(found.objects)), cut_apart(found.objects, 18))
        axes.set(xlabel="recognized as", ylabel="object felt")
        axes.set_title(f"{cut(label, 50)}\n{100 * found.recognized[label]:.1f} % recognized")
        bar: Any = drawn.colorbar(cells, label="share of episodes [1]", fraction=0.05)
        bar.solids.set_edgecolor("face")
    return drawn


def draw_settings(plan: Plan, paired: Paired, metric: str) -> "Figure":
    """A panel for each factor: rows are the strategies of which it says something, columns levels;
    each cell gives the mean."""
    found = list(effects(plan, paired, metric))
    levels = {effect.factor: effect.levels for effect in found}
    factors = [key for axis in plan.study.axes for key in axis.keys if key in levels]
    mean = {strategy.name: paired.means[metric][0][[
        n for n, entry in enumerate(paired.entries) if entry.strategy == k]].mean()
        for k, strategy in enumerate(plan.study.strategies)}
    rows = [[effect for effect in found if effect.factor == factor] for factor in factors]
    tables = [np.array([effect.value for effect in row]) for row in rows]
    around = [np.array([[mean[effect.strategy]] for effect in row]) for row in rows]
    largest = max(1e-9, *(np.nanmax(np.abs(table - middle))
                          for table, middle in zip(tables, around, strict=True)))
    digits = 1 if largest >= 1 else 2
    with drawing():
        drawn = figure(max(LEAST_IN, len(factors) * 0.62 + 0.17 * sum(map(len, rows)) + 0.35))
        panels = drawn.subplots(len(factors), 1, squeeze=False,
                                height_ratios=[len(row) + 1 for row in rows])[:, 0]
        cells = None
        for axes, factor, row, table, middle in zip(panels, factors, rows, tables, around,
                                                    strict=True):
            off = table - middle
            text = [[number_text(value, digits) for value in values] for values in table]
            cells = _heat_map(axes, off, "PuOr_r", (-largest, largest), text,
                             abs(off) > 0.65 * largest)
            axes.set_xticks(range(table.shape[1]), [
                level.replace(" to ", "\nto ") for level in levels[factor]])
            axes.set_yticks(range(len(row)), cut_apart([effect.strategy for effect in row], 22))
            axes.set_xlabel(factor)
        assert cells is not None
        bar: Any = drawn.colorbar(cells, ax=list(panels), fraction=0.04,
                             label=f"{UNITS.get(metric, metric)},\noff the strategy's mean")
        bar.solids.set_edgecolor("face")
    return drawn


def _heat_map(axes: Any, values: np.ndarray, colours: str, limits: tuple[float, float],
             text: Sequence[Sequence[str]], dark: np.ndarray) -> Any:
    """Draws cells (row, column) with their texts, white where `dark`; returns the cells."""
    import matplotlib

    rows, columns = values.shape
    cells = axes.pcolormesh(np.arange(columns + 1) - 0.5, np.arange(rows + 1) - 0.5, values,
                            cmap=matplotlib.colormaps[colours].resampled(COLOUR_COUNT),
                            vmin=limits[0], vmax=limits[1])
    for row, column in np.ndindex(values.shape):
        axes.text(column, row, text[row][column], ha="center", va="center", fontsize=5.5,
                  color="white" if dark[row, column] else "black")
    axes.invert_yaxis()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    return cells
