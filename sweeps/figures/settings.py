"""Heat maps of the swept factors: the difference of each level from the strategy's mean."""

from typing import TYPE_CHECKING

import numpy as np

from sweeps.analysis.paired import Paired
from sweeps.analysis.settings import Effect, effects
from sweeps.figures.style import UNITS, cut, drawing, figure, heat_map
from sweeps.run.plan import Plan

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_settings(plan: Plan, paired: Paired, metric: str) -> "Figure":
    """A panel for each factor: rows are strategies, columns levels; each cell gives the mean."""
    found = list(effects(plan, paired, metric))
    factors = list(dict.fromkeys(effect.factor for effect in found))
    names = [strategy.name for strategy in plan.study.strategies]
    tables = [np.array([effect.value for effect in found if effect.factor == factor])
              for factor in factors]
    around = np.array([paired.means[metric][0][[n for n, entry in enumerate(paired.entries)
                                                if entry.strategy == k]].mean()
                       for k in range(len(names))])
    largest = max(max(np.nanmax(np.abs(table - around[:, None])) for table in tables), 1e-9)
    digits = 1 if largest >= 1 else 2
    with drawing():
        drawn = figure(len(factors) * (0.62 + 0.17 * len(names)) + 0.35)
        panels = drawn.subplots(len(factors), 1, squeeze=False)[:, 0]
        cells = None
        for axes, factor, table in zip(panels, factors, tables, strict=True):
            off = table - around[:, None]
            text = [[f"{value:.{digits}f}" for value in row] for row in table]
            cells = heat_map(axes, off, "PuOr_r", (-largest, largest), text,
                             abs(off) > 0.65 * largest)
            axes.set_xticks(range(table.shape[1]), [
                level.replace(" to ", "\nto ") for level in _levels(found, factor)])
            axes.set_yticks(range(len(names)), [cut(name, 22) for name in names])
            axes.set_xlabel(factor)
        assert cells is not None
        drawn.colorbar(cells, ax=list(panels), fraction=0.04,
                       label=f"{UNITS.get(metric, metric)},\noff the strategy's mean")
    return drawn


def _levels(found: list[Effect], factor: str) -> tuple[str, ...]:
    return next(effect.levels for effect in found if effect.factor == factor)
