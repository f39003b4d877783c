"""The leaderboard of a study: strategies ranked by a metric, each with its interval.

An entry is a strategy, under each setting of the grid and zip axes; Sobol and Latin hypercube
axes are draws of a nuisance and are averaged over: an episode repeated at many points counts once.
Entries are compared on the same objects and episodes. A failed episode counts too, or failing
would pay: it scores what its row has (the prior body) or, where the row has no number, IoU and
coverage 0 and the largest distance that any entry had on that object. `failure_rate` is the share
of failed episodes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from sweeps.analysis.bootstrap import (
    MeanOverObjects,
    Place,
    PlainMean,
    difference_to,
    estimate,
    probability_best,
)
from sweeps.analysis.entries import (
    HIGHER_IS_BETTER,
    METRICS,
    Entry,
    LeaderboardError,
    bounds_of,
    check_metric,
    entries_of,
    entry_axes,
    paired_blocks,
    values_of,
)
from sweeps.analysis.text_table import TextTable, number_text
from sweeps.run.plan import Plan
from sweeps.run.store import Store
from sweeps.run.unit_file import Columns

__all__ = ["METRICS", "Leaderboard", "LeaderboardError", "make_leaderboard"]
Leaderboard = TextTable
MANY_OBJECTS = 6  # below, the spread between objects is hardly known


@dataclass
class _Table:
    """Sums over one group of objects."""

    entries: list[Entry]
    metric: MeanOverObjects
    iou: MeanOverObjects
    plain: dict[str, PlainMean]
    offered: np.ndarray  # which entries name the object they felt
    episode_count: int = 0
    missing: int = 0
    objects: set[int] = field(default_factory=set)
    faults: dict[str, str] = field(default_factory=dict)  # of strategies: the first of each


PLAIN = ("recognized", "touches", "robot_time_s", "failure_rate")


def make_leaderboard(plan: Plan, stores: Sequence[Store], metric: str = "chamfer_mm",
                     by: Sequence[str] | None = None) -> Leaderboard:
    """Reads a study's units once, one at a time; memory does not grow with the episodes."""
    check_metric(metric)
    axes, per_object = entry_axes(plan, by)
    entries = entries_of(plan, axes)
    seed = int(plan.hash, 16)
    groups = [[n] for n in range(len(plan.study.objects))] if per_object else [
        list(range(len(plan.study.objects)))]
    rows: list[tuple[str, ...]] = []
    missing = measured = 0
    faults: dict[str, str] = {}
    for group in groups:
        table = _Table(entries, _mean(metric, entries, seed), _mean("iou", entries, seed),
                       {name: PlainMean(len(entries)) for name in PLAIN},
                       np.zeros(len(entries), bool))
        for number in group:
            _add_object(plan, stores, table, axes, number, metric)
            for mean in (table.metric, table.iou, *table.plain.values()):
                mean.finish_object()
        label = f"object={plan.study.objects[group[0]].name}" if per_object else ""
        rows += _rows(table, metric, label)
        missing += table.missing
        measured = max(measured, len(table.objects))
        faults |= {**table.faults, **faults}
    notes = (*_notes(plan, missing, measured),
             *(f"strategy {name} {fault}" for name, fault in sorted(faults.items())))
    return Leaderboard(_header(metric), tuple(rows), notes)


def _mean(metric: str, entries: Sequence[Entry], seed: int) -> MeanOverObjects:
    return MeanOverObjects(len(entries), 0.0 if metric in HIGHER_IS_BETTER else None, seed)


def _add_object(plan: Plan, stores: Sequence[Store], table: _Table, axes: Sequence[int],
                number: int, metric: str) -> None:
    for block in paired_blocks(plan, stores, table.entries, axes, number):
        if block.missing:
            table.missing += block.missing
            continue  # paired: a block counts for all entries or for none
        _add_block(table, block.rows, metric, (number, block.number))
        table.episode_count += block.count
        table.objects.add(number)


def _add_block(table: _Table, found: Sequence[Columns], metric: str, place: Place) -> None:
    for mean, name in ((table.metric, metric), (table.iou, "iou")):
        mean.add(np.column_stack([values_of(rows, name) for rows in found]), place)
    for name in PLAIN:
        table.plain[name].add(np.column_stack([values_of(rows, name) for rows in found]))
    for entry, rows in zip(table.entries, found, strict=True):
        fault = next((f"failed: {note}" if failed == "strategy_failed" else str(note)
                      for note, failed in zip(rows.get("note", ()), rows["status"], strict=False)
                      if note), "")
        if fault:
            table.faults.setdefault(entry.label, fault)
    table.offered |= [any(rows.get("recognized_as", ())) for rows in found]


def _header(metric: str) -> tuple[str, ...]:
    iou = ("iou", "iou_ci_low", "iou_ci_high") if metric != "iou" else ()
    rest = tuple(name for name in ("recognized", "touches", "robot_time_s") if name != metric)
    delta = "delta_to_best_mm" if metric.endswith("_mm") else "delta_to_best"
    return ("rank", "strategy", metric, f"{metric}_ci_low", f"{metric}_ci_high", delta,
            "delta_ci_low", "delta_ci_high", "p_best", *iou, *rest, "failure_rate", "n_objects",
            "n_episodes")


def _rows(table: _Table, metric: str, label: str) -> list[tuple[str, ...]]:
    sign = -1.0 if metric in HIGHER_IS_BETTER else 1.0
    means = table.metric.means()
    value = estimate(means, bounds_of(metric))
    key = np.where(np.isfinite(value.value), sign * value.value, np.inf)
    order = sorted(range(len(table.entries)), key=lambda n: (key[n], table.entries[n].label))
    delta = difference_to(means, order[0])
    best = probability_best(means, sign)
    iou = estimate(table.iou.means(), bounds_of("iou"))
    plain = {name: mean.means() for name, mean in table.plain.items()}
    plain["recognized"] = np.where(table.offered, plain["recognized"], np.nan)
    digits = 4 if metric in HIGHER_IS_BETTER else 3
    rows = []
    for rank, n in enumerate(order, 1):
        name = table.entries[n].label
        if label:
            name = f"{name[:-1]}, {label}]" if name.endswith("]") else f"{name} [{label}]"
        cells: dict[str, str] = {"rank": str(rank), "strategy": name}
        cells |= {metric: number_text(value.value[n], digits),
                  f"{metric}_ci_low": number_text(value.low[n], digits),
                  f"{metric}_ci_high": number_text(value.high[n], digits),
                  "delta": number_text(delta.value[n], digits),
                  "delta_ci_low": number_text(delta.low[n], digits),
                  "delta_ci_high": number_text(delta.high[n], digits),
                  "p_best": number_text(best[n], 3),
                  "failure_rate": number_text(plain["failure_rate"][n], 4),
                  "n_objects": str(len(table.objects)), "n_episodes": str(table.episode_count)}
        if metric != "iou":
            cells |= {"iou": number_text(iou.value[n], 4), "iou_ci_low": number_text(iou.low[n], 4),
                      "iou_ci_high": number_text(iou.high[n], 4)}
        for column, places in (("recognized", 4), ("touches", 2), ("robot_time_s", 2)):
            cells.setdefault(column, number_text(plain[column][n], places))
        rows.append(tuple(cells["delta" if column.startswith("delta_to") else column]
                          for column in _header(metric)))
    return rows


def _notes(plan: Plan, missing: int, count: int) -> Iterator[str]:
    if missing:
        yield (f"{missing} of {plan.unit_count} units are missing; blocks of episodes that not "
               "every entry has are left out")
    if count < MANY_OBJECTS:
        yield (f"{'one object' if count == 1 else f'{count} objects'} a ranking: how entries "
               f"would do on other objects is hardly known below {MANY_OBJECTS}")
