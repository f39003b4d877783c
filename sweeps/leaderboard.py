"""The leaderboard of a study: strategies ranked by a metric, each with its interval.

An entry is a strategy, under each setting of the grid and zip axes; Sobol and Latin hypercube
axes are draws of a nuisance and are averaged over. Entries are compared on the same objects and
episodes. A failed episode counts too, or failing would pay: it scores what its row says (the body
the strategy was told before it touched anything) or, where the row has no number, IoU and coverage
0 and the largest distance that any entry had on that object. `failure_rate` says how many failed.
"""

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np

from sweeps.bootstrap import (
    MeanOverObjects,
    PlainMean,
    difference_to,
    episode_weights,
    estimate,
    object_weights,
    probability_best,
)
from sweeps.plan import Plan, Unit, cell_hash
from sweeps.problems import choose
from sweeps.store import Store
from sweeps.unit_file import Columns

LOWER_IS_BETTER = ("chamfer_mm", "hausdorff95_mm", "touches", "robot_time_s", "arm_path_m",
                   "fit_rms_mm")
HIGHER_IS_BETTER = ("iou", "coverage5mm", "recognized")
METRICS = (*LOWER_IS_BETTER, *HIGHER_IS_BETTER)
MANY_OBJECTS = 6  # below, the spread between objects is hardly known


class LeaderboardError(ValueError):
    """A leaderboard that cannot be made; the message says why."""


@dataclass(frozen=True)
class Leaderboard:
    """Rows of text under a header, and what a reader should know about them."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()

    def csv(self) -> bytes:
        """The bytes of `leaderboard.csv`."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(self.header)
        writer.writerows(self.rows)
        return stream.getvalue().encode()


@dataclass
class _Entry:
    """One row in the making: a strategy and its points on the axes that tell entries apart."""

    strategy: int
    label: str
    points: dict[int, int]  # axis -> point


@dataclass
class _Table:
    """Sums over one group of objects."""

    entries: list[_Entry]
    metric: MeanOverObjects
    iou: MeanOverObjects
    plain: dict[str, PlainMean]
    offered: np.ndarray  # which entries name the object they felt
    episode_count: int = 0
    missing: int = 0
    objects: set[int] = field(default_factory=set)


PLAIN = ("recognized", "touches", "robot_time_s", "failure_rate")


def make_leaderboard(plan: Plan, stores: Sequence[Store], metric: str = "chamfer_mm",
                     by: Sequence[str] | None = None) -> Leaderboard:
    """Reads a study's units once, one at a time; memory does not grow with the episodes."""
    if metric not in METRICS:
        raise LeaderboardError(f"--metric: no metric {metric!r}; {choose(metric, METRICS)}")
    axes, per_object = _grouping(plan, by)
    entries = _entries(plan, axes)
    seed = int(plan.hash, 16)
    groups = [[n] for n in range(len(plan.study.objects))] if per_object else [
        list(range(len(plan.study.objects)))]
    rows: list[tuple[str, ...]] = []
    missing = 0
    for group in groups:
        table = _Table(entries, _mean(metric, entries), _mean("iou", entries),
                       {name: PlainMean(len(entries)) for name in PLAIN},
                       np.zeros(len(entries), bool))
        weights = object_weights(seed, len(group))
        for place, number in enumerate(group):
            _add_object(plan, stores, table, axes, number, metric, seed)
            for mean in (table.metric, table.iou):
                mean.finish_object(weights[:, place])
            for mean in table.plain.values():
                mean.finish_object()
        label = f"object={plan.study.objects[group[0]].name}" if per_object else ""
        rows += _rows(table, metric, label)
        missing += table.missing
    return Leaderboard(_header(metric), tuple(rows), tuple(_notes(plan, missing, per_object)))


def _mean(metric: str, entries: Sequence[_Entry]) -> MeanOverObjects:
    return MeanOverObjects(len(entries), 0.0 if metric in HIGHER_IS_BETTER else None)


def _grouping(plan: Plan, by: Sequence[str] | None) -> tuple[list[int], bool]:
    """The axes that tell entries apart, and whether each object is ranked by itself."""
    if by is None:
        return [n for n, axis in enumerate(plan.study.axes) if not axis.sampled], False
    known = ["strategy", "object", *(key for axis in plan.study.axes for key in axis.keys)]
    for name in by:
        if name not in known:
            raise LeaderboardError(f"--by: {name!r} is nothing to group by; {choose(name, known)}")
    axes = [n for n, axis in enumerate(plan.study.axes) if set(axis.keys) & set(by)]
    return axes, "object" in by


def _entries(plan: Plan, axes: Sequence[int]) -> list[_Entry]:
    entries = []
    for number, strategy in enumerate(plan.study.strategies):
        for points in product(*(range(len(plan.study.axes[n].values)) for n in axes)):
            told = [f"{key}={_text(value)}" for n, point in zip(axes, points, strict=True)
                    for key, value in zip(plan.study.axes[n].keys,
                                          plan.study.axes[n].values[point], strict=True)]
            label = strategy.name + (f" [{', '.join(told)}]" if told else "")
            entries.append(_Entry(number, label, dict(zip(axes, points, strict=True))))
    return entries


def _text(value: Any) -> str:
    if isinstance(value, tuple):
        return "(" + " ".join(map(_text, value)) + ")"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _cases(plan: Plan, axes: Sequence[int]) -> Iterator[dict[int, int]]:
    """The points of all axes that entries are averaged over."""
    rest = [n for n in range(len(plan.study.axes)) if n not in axes]
    for points in product(*(range(len(plan.study.axes[n].values)) for n in rest)):
        yield dict(zip(rest, points, strict=True))


def _setting_index(plan: Plan, points: dict[int, int]) -> int:
    index = 0
    for n, axis in enumerate(plan.study.axes):
        index = index * len(axis.values) + points[n]
    return index


def _add_object(plan: Plan, stores: Sequence[Store], table: _Table, axes: Sequence[int],
                number: int, metric: str, seed: int) -> None:
    for case_number, case in enumerate(_cases(plan, axes)):
        cells = [plan.study.cell(entry.strategy, number,
                                 _setting_index(plan, {**case, **entry.points}))
                 for entry in table.entries]
        hashes = [cell_hash(cell, plan.study.objects[number]) for cell in cells]
        for block in range(plan.block_count):
            units = [plan.unit(cell, name, block)
                     for cell, name in zip(cells, hashes, strict=True)]
            found = [_find(stores, unit) for unit in units]
            if any(rows is None for rows in found):
                table.missing += sum(rows is None for rows in found)
                continue  # paired: a block counts for all entries or for none
            _add_block(table, [rows for rows in found if rows is not None], metric,
                       episode_weights(seed, (number, case_number, block),
                                       units[0].stop - units[0].start))
            table.episode_count += units[0].stop - units[0].start
            table.objects.add(number)


def _find(stores: Sequence[Store], unit: Unit) -> Columns | None:
    """A unit's rows; a unit that was set aside counts as episodes that all failed."""
    for store in stores:
        if (rows := store.read(unit)) is not None:
            return rows
    if any(store.log(unit).exists() for store in stores):
        return {"status": np.full(unit.stop - unit.start, "unit_failed", object)}
    return None


def _add_block(table: _Table, found: Sequence[Columns], metric: str, weights: np.ndarray) -> None:
    failed = [_failed(rows) for rows in found]
    for mean, name in ((table.metric, metric), (table.iou, "iou")):
        mean.add(np.column_stack([_values(rows, name) for rows in found]), weights)
    for name in PLAIN:
        columns = [bad.astype(float) if name == "failure_rate" else _values(rows, name)
                   for rows, bad in zip(found, failed, strict=True)]
        table.plain[name].add(np.column_stack(columns))
    table.offered |= [any(rows.get("recognized_as", ())) for rows in found]


def _failed(rows: Columns) -> np.ndarray:
    """Which episodes failed: their status says so, or no body came out."""
    failed = rows["status"] != "ok"
    if "chamfer_mm" in rows:
        failed = failed | ~np.isfinite(rows["chamfer_mm"].astype(float))
    return failed.astype(bool)


def _values(rows: Columns, name: str) -> np.ndarray:
    count = len(rows["status"])
    if name == "recognized":
        if "recognized_as" not in rows:
            return np.zeros(count)
        return (rows["recognized_as"] == rows["object"]).astype(float)
    return rows[name].astype(float) if name in rows else np.full(count, np.nan)


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
    value = estimate(means)
    key = np.where(np.isfinite(value.value), sign * value.value, np.inf)
    order = sorted(range(len(table.entries)), key=lambda n: (key[n], table.entries[n].label))
    delta = difference_to(means, order[0])
    best = probability_best(means, sign)
    iou = estimate(table.iou.means())
    plain = {name: mean.means() for name, mean in table.plain.items()}
    plain["recognized"] = np.where(table.offered, plain["recognized"], np.nan)
    digits = 4 if metric in HIGHER_IS_BETTER else 3
    rows = []
    for rank, n in enumerate(order, 1):
        name = table.entries[n].label
        if label:
            name = f"{name[:-1]}, {label}]" if name.endswith("]") else f"{name} [{label}]"
        cells: dict[str, str] = {"rank": str(rank), "strategy": name}
        cells |= {metric: _number(value.value[n], digits),
                  f"{metric}_ci_low": _number(value.low[n], digits),
                  f"{metric}_ci_high": _number(value.high[n], digits),
                  "delta": _number(delta.value[n], digits),
                  "delta_ci_low": _number(delta.low[n], digits),
                  "delta_ci_high": _number(delta.high[n], digits),
                  "p_best": _number(best[n], 3),
                  "failure_rate": _number(plain["failure_rate"][n], 4),
                  "n_objects": str(len(table.objects)), "n_episodes": str(table.episode_count)}
        if metric != "iou":
            cells |= {"iou": _number(iou.value[n], 4), "iou_ci_low": _number(iou.low[n], 4),
                      "iou_ci_high": _number(iou.high[n], 4)}
        for column, places in (("recognized", 4), ("touches", 2), ("robot_time_s", 2)):
            cells.setdefault(column, _number(plain[column][n], places))
        rows.append(tuple(cells["delta" if column.startswith("delta_to") else column]
                          for column in _header(metric)))
    return rows


def _number(value: float, digits: int) -> str:
    if not np.isfinite(value):
        return "NA"
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def _notes(plan: Plan, missing: int, per_object: bool) -> Iterator[str]:
    if missing:
        yield (f"{missing} of {plan.unit_count} units are missing; blocks of episodes that not "
               "every entry has are left out")
    count = 1 if per_object else len(plan.study.objects)
    if count < MANY_OBJECTS:
        yield (f"{'one object' if count == 1 else f'{count} objects'} a ranking: how entries "
               f"would do on other objects is hardly known below {MANY_OBJECTS}")
