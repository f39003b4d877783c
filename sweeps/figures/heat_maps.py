"""Heat maps: the confusion matrix of an entry, and the means at each level of swept factors."""

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from sweeps.analysis.confusion import Confusion
from sweeps.analysis.entries import LeaderboardError
from sweeps.analysis.paired import Paired
from sweeps.analysis.settings import effects
from sweeps.figures.style import (
    COLUMN_IN,
    cut_apart,
    cut_to,
    drawing,
    figure,
    metric_label,
    slant,
    text_width_in,
)
from sweeps.run.plan import Plan
from sweeps.spec.errors import choose
from sweeps.text_table import number_text
from warpgrasp.objects.catalogue_names import BODY_NAMES

if TYPE_CHECKING:
    from matplotlib.figure import Figure
COLOUR_COUNT = 47
"""Odd, for the middle of a diverging map; matplotlib rasterizes colour bars of 49 and more."""
CELL_PT, LEAST_PT, TICK_PT = 5.5, 4.0, 6.5
"""Text of cells as wished and as small as it may become, and of ticks, in points."""
MOST_SLANTED = 10
"""Columns of answers; more have upright labels, for which there is room."""
MOST_NAMED = 13
"""Columns of answers; of more there is no room for names."""
TOLD = 50
"""Characters of a line that explains numbers."""
ROWS_IN, ROW_IN = 2.4, (0.13, 0.3)
"""Inches that the rows of answers share, and the least and most that one has."""
BAR_IN = 1.1
"""Inches beside a map of settings and its names, for the colour bar, about."""
NAME_IN = 1.0
"""Inches that an object's name may take of a figure's width."""
LEAST_IN = 2.1
"""Inches of height that the colour bar's label needs."""


def draw_confusion(found: Confusion, label: str | None = None) -> "Figure":
    """The matrix of the entry `label`, by default of the one that is right most often.

    Raises LeaderboardError for an unknown entry, and where none names the object.
    """
    if not found.labels:
        raise LeaderboardError("confusion: no strategy of this study names what it felt"
                               if found.objects else
                               "confusion: no block of episodes is finished for every strategy "
                               "yet; `warpgrasp status` says how far it is")
    if label is None:
        label = max(found.labels, key=lambda name: found.recognized[name])
    if label not in found.labels:
        raise LeaderboardError(f"--strategy: no strategy {label!r}; {choose(label, found.labels)}")
    answers = _answers_shown(found, label)
    counts = np.array([[found.counts[label, body][answer] for answer in answers]
                       for body in found.objects], float)
    share = 100.0 * counts / counts.sum(axis=1, keepdims=True)
    rows, columns, said = _named_or_numbered(found.objects, answers)
    turned = 60.0 if len(answers) <= MOST_SLANTED else 90.0
    longest = max(text_width_in(name, TICK_PT) for name in columns.values())
    longest += 0.12 * said.count("\n")
    row_in = float(np.clip(ROWS_IN / len(found.objects), *ROW_IN))
    with drawing():
        drawn = figure(0.85 + row_in * len(found.objects) + longest * np.sin(np.radians(turned)))
        axes = drawn.add_subplot()
        text = [[f"{value:.0f}" if value > 0 else "" for value in row] for row in share]
        cells = _heat_map(axes, share, "Blues", (0.0, 100.0), text, share > 50.0)
        axes.set_xticks(list(columns), list(columns.values()),
                        rotation=turned, ha="right", rotation_mode="anchor",
                        va="center" if turned == 90.0 else "baseline")
        axes.set_yticks(range(len(rows)), rows)
        axes.set(xlabel=f"recognized as{said}", ylabel="object felt")
        drawn.suptitle(f"{cut_to(label, 0.95 * COLUMN_IN)}\n"
                       f"{100 * found.recognized[label]:.1f} % recognized", fontsize=7.5)
        bar: Any = drawn.colorbar(cells, label="episodes [%]", fraction=0.05)
        bar.solids.set_edgecolor("face")
        _fitted(drawn, axes, len(answers))
    return drawn


def _answers_shown(found: Confusion, label: str) -> list[str]:
    """Answers that the entry gave, and objects of the study that it could have named."""
    given = {answer for body in found.objects
             for answer, count in found.counts[label, body].items() if count}
    return [answer for answer in found.answers if answer in given
            or (answer in found.objects and answer in BODY_NAMES)] or list(found.answers)


def _named_or_numbered(objects: Sequence[str], answers: Sequence[str]
                       ) -> tuple[list[str], dict[int, str], str]:
    """Labels of rows, those of columns by their places, and what explains the latter: of many
    columns some have the numbers that rows have, too."""
    if len(answers) <= MOST_NAMED:
        names = _names([*objects, *answers])
        return names[:len(objects)], dict(enumerate(names[len(objects):])), ""
    others = [answer for answer in answers if answer not in objects]
    number = {name: n for n, name in enumerate([*objects, *others], 1)}
    step = -(-len(answers) // MOST_NAMED)
    told = ", ".join(f"{number[name]} {name}" for name in others)
    return ([f"{number[name]} {short}" for name, short in zip(objects, _names(objects),
                                                              strict=True)],
            {place: str(number[answers[place]]) for place in range(0, len(answers), step)},
            " the object of this number" + "".join(
                "\n" + line for line in textwrap.wrap(told, TOLD)))


def _names(names: Sequence[str]) -> list[str]:
    """Names that still differ and are at most NAME_IN wide."""
    short = [cut_to(name, NAME_IN, TICK_PT) for name in cut_apart(names, 18)]
    if len(set(short)) == len(set(names)):
        return short
    for width in range(17, 5, -1):
        short = cut_apart(names, width)
        if max(text_width_in(name, TICK_PT) for name in short) <= NAME_IN:
            return short
    return cut_apart(names, 5)


def _fitted(drawn: "Figure", axes: Any, columns: int) -> None:
    """Makes the texts of cells smaller where these are narrow, or leaves them out."""
    drawn.draw_without_rendering()
    room = axes.get_window_extent().width / drawn.dpi / columns
    widest = max((text_width_in(text.get_text(), CELL_PT) for text in axes.texts), default=0.0)
    size = CELL_PT * min(1.0, 0.95 * room / max(widest, 1e-9))
    for text in list(axes.texts):
        if size < LEAST_PT:
            text.remove()
        else:
            text.set_fontsize(size)


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
    largest = max(1e-9, *(np.nanmax(np.abs(table - middle), initial=0.0)
                          for table, middle in zip(tables, around, strict=True)))
    digits = 1 if largest >= 1 else 2
    rows_named = [cut_apart([effect.strategy for effect in row], 22) for row in rows]
    room = COLUMN_IN - BAR_IN - max(text_width_in(name, TICK_PT)
                                    for names in rows_named for name in names)
    ticks = {factor: _column_labels(names, room) for factor, names in levels.items()}
    turned_in = sum(0.8 * np.sin(np.radians(turned)) * max(
        text_width_in(name, TICK_PT) for name in names) for names, turned in ticks.values()
        if turned)
    with drawing():
        drawn = figure(max(LEAST_IN, len(factors) * 0.62 + 0.17 * sum(map(len, rows)) + 0.35)
                       + turned_in)
        panels = drawn.subplots(len(factors), 1, squeeze=False,
                                height_ratios=[len(row) + 1 for row in rows])[:, 0]
        cells = None
        for axes, factor, of_rows, table, middle in zip(panels, factors, rows_named, tables, around,
                                                        strict=True):
            off = table - middle
            text = [[number_text(value, digits) for value in values] for values in table]
            cells = _heat_map(axes, off, "PuOr_r", (-largest, largest), text,
                             abs(off) > 0.65 * largest)
            names, turned = ticks[factor]
            axes.set_xticks(range(table.shape[1]), names, rotation=turned, rotation_mode="anchor",
                            ha="right" if turned else "center",
                            va="center" if turned == 90.0 else "top")
            axes.set_yticks(range(len(of_rows)), of_rows)
            axes.set_xlabel(factor)
        assert cells is not None
        name, _, way = metric_label(metric).rpartition(", ")
        bar: Any = drawn.colorbar(cells, ax=list(panels), fraction=0.04,
                                  label=f"{name},\noff the strategy's mean;\n{way}")
        bar.solids.set_edgecolor("face")
    return drawn


def _column_labels(levels: Sequence[str], room_in: float) -> tuple[list[str], float]:
    """Labels of columns and how far they are turned, which those are that have no room; all have
    `room_in` inches."""
    lines = [level.replace(" to ", "\nto ") for level in levels]
    wide = max(text_width_in(line, TICK_PT) for level in lines for line in level.split("\n"))
    if wide <= room_in / len(levels) - 0.05:
        return lines, 0.0
    return cut_apart(levels, 18), slant(len(levels))


def _heat_map(axes: Any, values: np.ndarray, colours: str, limits: tuple[float, float],
             text: Sequence[Sequence[str]], dark: np.ndarray) -> Any:
    """Draws cells (row, column) with their texts, white where `dark`; returns the cells."""
    import matplotlib

    rows, columns = values.shape
    cells = axes.pcolormesh(np.arange(columns + 1) - 0.5, np.arange(rows + 1) - 0.5, values,
                            cmap=matplotlib.colormaps[colours].resampled(COLOUR_COUNT),
                            vmin=limits[0], vmax=limits[1])
    for row, column in np.ndindex(values.shape):
        axes.text(column, row, text[row][column], ha="center", va="center", fontsize=CELL_PT,
                  color="white" if dark[row, column] else "black")
    axes.invert_yaxis()
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)
    return cells
