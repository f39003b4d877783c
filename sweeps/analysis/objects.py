"""Each entry on each object: the median over episodes with its interval, and what it cost; or the
settings of a study side by side.

The interval is the distribution-free one between order statistics (exact binomial coverage of at
least 95 %), so that it needs neither a normal spread nor random numbers. An episode repeated at
many points of an axis that is averaged over is one, at its mean over them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sweeps.analysis.entries import HIGHER_IS_BETTER, digits_of
from sweeps.analysis.paired import Paired
from sweeps.text_table import TextTable, number_text

ALSO = ("touches", "robot_time_s", "failure_rate")


@dataclass(frozen=True)
class ObjectRow:
    """One entry on one object."""

    label: str
    object: str
    median: float
    low: float
    high: float
    mean: float
    p90: float
    """The value that nine in ten episodes are better than."""
    also: tuple[float, ...]
    episodes: int


BESIDE = ("chamfer_mm", "iou")
"""Metrics of the table `beside`."""


def object_rows(paired: Paired, metric: str) -> Iterator[ObjectRow]:
    """Object by object, the entries in their order."""
    for number, name in enumerate(paired.objects):
        values = paired.values[metric][number]
        worse = 0.1 if metric in HIGHER_IS_BETTER else 0.9
        for n, label in enumerate(paired.labels):
            mine = values[:, n]
            low, high = median_interval(mine)
            yield ObjectRow(
                label, name, float(np.median(mine)), low, high, float(mine.mean()),
                float(np.quantile(mine, worse)),
                tuple(float(paired.values[also][number][:, n].mean()) for also in ALSO),
                len(mine))


def median_interval(values: np.ndarray) -> tuple[float, float]:
    """The order statistics that hold the median with at least 95 %; infinite where too few."""
    from scipy.stats import binom

    ordered = np.sort(values)
    below = int(binom.ppf(0.025, len(ordered), 0.5))
    if not np.isfinite(ordered).all() or 2 * binom.cdf(below - 1, len(ordered), 0.5) > 0.05:
        return float("nan"), float("nan")
    if below == 0:
        return float("-inf"), float("inf")
    return float(ordered[below - 1]), float(ordered[len(ordered) - below])


def objects_table(paired: Paired, metric: str) -> TextTable:
    """The table of `warpgrasp table DIR objects`."""
    digits = digits_of(metric)
    header = ("object", "strategy", f"{metric}_median", "ci_low", "ci_high", f"{metric}_mean",
              f"{metric}_p90", "touches", "robot_time_s", "failure_rate", "n_episodes")
    rows = tuple(
        (row.object, row.label,
         *(number_text(v, digits) for v in (row.median, row.low, row.high, row.mean, row.p90)),
         number_text(row.also[0], 2), number_text(row.also[1], 2), number_text(row.also[2], 4),
         str(row.episodes))
        for row in object_rows(paired, metric))
    return TextTable(header, rows, paired.notes_of_data)


def beside_table(paired: Paired) -> TextTable:
    """The table of `warpgrasp table DIR beside`: means of each strategy on each object, the
    settings of a study side by side; empty where a strategy has no such setting."""
    columns: dict[tuple[str, int], None] = {}  # a setting, and which of the same text it is
    of_strategies: dict[int, dict[tuple[str, int], int]] = {}  # entries by their columns
    for n, entry in enumerate(paired.entries):
        own = of_strategies.setdefault(entry.strategy, {})
        column = entry.setting, sum(setting == entry.setting for setting, _ in own)
        own[column] = n
        columns[column] = None
    header = ("object", "strategy", *(f"{metric} {setting}".strip() for metric in BESIDE
                                      for setting, _ in columns))
    rows = []
    for number, name in enumerate(paired.objects):
        for own in of_strategies.values():
            first = paired.entries[next(iter(own.values()))]
            cells = (number_text(float(paired.values[metric][number][:, own[column]].mean()), 2)
                     if column in own else "" for metric in BESIDE for column in columns)
            rows.append((name, first.label.removesuffix(f" [{first.setting}]"), *cells))
    return TextTable(header, tuple(rows), paired.notes_of_data)
