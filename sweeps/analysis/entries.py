"""What is compared: entries of a study, and the blocks of episodes that all of them have.

An entry is a strategy under one setting of the axes that define entries. The rest of the axes
are cases that an entry is averaged over. A block of episodes counts for all entries or for none.

Beside the entries stands a reference, `given-prior`: what an entry scores that touches nothing.
Every row holds the scores of the prior that its strategy was given (columns `prior_...`), so that
it needs no episodes of its own.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from strategies.ready_made import REFERENCE
from sweeps.run.plan import Plan, Unit, cell_hash, part_of
from sweeps.spec.errors import choose
from sweeps.spec.study import Axis

if TYPE_CHECKING:
    from sweeps.run.store import Store
    from sweeps.run.unit_file import Columns
LOWER_IS_BETTER = ("chamfer_mm", "normalized_chamfer", "hausdorff95_mm", "touches",
                   "robot_time_s", "arm_path_m", "fit_rms_mm")
HIGHER_IS_BETTER = ("iou", "coverage5mm", "recognized")
METRICS = (*LOWER_IS_BETTER, *HIGHER_IS_BETTER)
SCORES = ("chamfer_mm", "normalized_chamfer", "hausdorff95_mm", "iou", "coverage5mm")
"""Metrics that the prior has, in columns of their own."""
CHANCES = ("recognized", "failure_rate")
"""Metrics that are 0 or 1 in an episode."""
COSTS = ("touches", "robot_time_s", "arm_path_m")
ROUNDING = 1e-9
"""Share of a score that its mean over many rows may be off by."""
_TELLING = ("object.", "stereo.")
"""Tables whose keys change what is given, or on which objects."""


def bounds_of(metric: str) -> tuple[float, float]:
    """Between what values a mean can lie."""
    return 0.0, 1.0 if metric in HIGHER_IS_BETTER else np.inf


def sign_of(metric: str) -> float:
    """What a metric is multiplied by so that less is better: 1 or -1."""
    return -1.0 if metric in HIGHER_IS_BETTER else 1.0


def digits_of(metric: str) -> int:
    """Decimal places of a metric in a table."""
    return 4 if metric in HIGHER_IS_BETTER else 3


class LeaderboardError(ValueError):
    """A comparison that cannot be made; the message says why."""


@dataclass(frozen=True)
class Entry:
    """A strategy and its points on the axes that tell entries apart."""

    strategy: int
    label: str
    points: dict[int, int]  # axis -> point
    setting: str = ""
    """What the label says of the points, such as "strategy.count=3"; empty where nothing."""


@dataclass(frozen=True)
class PairedBlock:
    """The rows that every entry has of the same episodes; None where a unit is missing."""

    number: int
    count: int  # episodes
    found: tuple[Columns | None, ...]

    @property
    def missing(self) -> int:
        """How many entries lack this block."""
        return sum(rows is None for rows in self.found)

    @property
    def rows(self) -> list[Columns]:
        """An entry each; for a block that misses nothing."""
        return [rows for rows in self.found if rows is not None]


def check_metric(metric: str) -> None:
    """Raises LeaderboardError for a metric that there is not."""
    if metric not in METRICS:
        raise LeaderboardError(f"--metric: no metric {metric!r}; {choose(metric, METRICS)}")


def entry_axes(plan: Plan, by: Sequence[str] | None) -> tuple[list[int], bool]:
    """The axes that define entries, and whether each object is ranked by itself."""
    if by is None:
        return [n for n, axis in enumerate(plan.study.axes) if not axis.sampled], False
    known = ["strategy", "object", *(key for axis in plan.study.axes for key in axis.keys)]
    for name in by:
        if name not in known:
            raise LeaderboardError(f"--by: {name!r} is nothing to group by; {choose(name, known)}")
    axes = [n for n, axis in enumerate(plan.study.axes) if set(axis.keys) & set(by)]
    return axes, "object" in by


def entries_of(plan: Plan, axes: Sequence[int]) -> list[Entry]:
    """Every strategy under every setting of `axes`; once where an axis says nothing of it."""
    entries = []
    texts = {n: point_texts(plan.study.axes[n]) for n in axes}
    for number, strategy in enumerate(plan.study.strategies):
        idle = plan.study.idle[number]
        for points in product(*(range(1 if n in idle else len(plan.study.axes[n].values))
                                for n in axes)):
            told = [text for n, point in zip(axes, points, strict=True) if n not in idle
                    for text in texts[n][point]]
            setting = ", ".join(told)
            entries.append(Entry(number, strategy.name + (f" [{setting}]" if told else ""),
                                 dict(zip(axes, points, strict=True)), setting))
    return entries


@dataclass(frozen=True)
class Reference:
    """A prior that some entries were given."""

    label: str
    entries: tuple[int, ...]


def references_of(plan: Plan, entries: Sequence[Entry]) -> list[Reference]:
    """The references of a study's entries, in the order of the entries."""
    texts = {n: point_texts(axis) for n, axis in enumerate(plan.study.axes)
             if any(key.startswith(_TELLING) for key in axis.keys)}
    groups: dict[tuple[str, ...], list[int]] = {}
    for number, entry in enumerate(entries):
        told = tuple(text for n, of_points in texts.items() if n in entry.points
                     for text in of_points[entry.points[n]])
        groups.setdefault(told, []).append(number)
    return [Reference(REFERENCE + (f" [{', '.join(told)}]" if told else ""), tuple(numbers))
            for told, numbers in groups.items()]


def prior_column(metric: str) -> str | None:
    """The column of rows that holds the prior's score; None where there is none."""
    return f"prior_{metric}" if metric in SCORES else None


def point_texts(axis: Axis) -> list[list[str]]:
    """Of each point of an axis its keys with their values, as labels show them."""
    columns = [value_texts(column) for column in zip(*axis.values, strict=True)]
    return [[f"{key}={text}" for key, value, text in zip(axis.keys, point, texts, strict=True)
             if value is not None]
            for point, texts in zip(axis.values, zip(*columns, strict=True), strict=True)]


def value_texts(values: Sequence[Any]) -> list[str]:
    """Swept values as labels show them, in so many digits that different ones differ."""
    found = [value_text(value) for value in values]
    if len({*found}) < len({*values}):
        found = [value_text(value, exact=True) for value in values]
    return found


def value_text(value: Any, exact: bool = False) -> str:
    """A swept value as a label shows it, to six digits or `exact`."""
    if isinstance(value, tuple):
        return "(" + " ".join(value_text(part, exact) for part in value) + ")"
    return f"{value:.6g}" if isinstance(value, float) and not exact else str(value)


def paired_blocks(plan: Plan, stores: Sequence[Store], entries: Sequence[Entry],
                  axes: Sequence[int], body: int) -> Iterator[PairedBlock]:
    """The blocks of episodes on one object, every case, read one at a time. Of a study that is
    growing, the blocks that it had before where not all entries have more yet."""
    earlier = sorted({count for store in stores for count in store.earlier()}, reverse=True)
    for case in averaged_points(plan, axes):
        cells = [plan.study.cell(entry.strategy, body,
                                 setting_index(plan, {**case, **entry.points}))
                 for entry in entries]
        hashes = [cell_hash(cell, plan.study.objects[body]) for cell in cells]
        for block in range(plan.block_count):
            units = [plan.unit(cell, name, block)
                     for cell, name in zip(cells, hashes, strict=True)]
            yield _paired_block(stores, block, units, earlier)


def _paired_block(stores: Sequence[Store], number: int, units: Sequence[Unit],
                  earlier: Sequence[int]) -> PairedBlock:
    start, stop = units[0].start, units[0].stop
    found = tuple(_find(stores, unit) for unit in units)
    ends = [count for count in earlier if start < count < stop]
    if any(rows is None for rows in found):
        for end in ends:
            short = tuple(_beginning(stores, unit, rows, [n for n in ends if n >= end], end)
                          for unit, rows in zip(units, found, strict=True))
            if all(rows is not None for rows in short):
                stores[0].growing = True
                return PairedBlock(number, end - start, short)
    return PairedBlock(number, stop - start, found)


def _beginning(stores: Sequence[Store], unit: Unit, rows: Columns | None, ends: Sequence[int],
               end: int) -> Columns | None:
    """The rows of a unit's episodes before `end`, from the unit or its part up to one of `ends`."""
    parts = (_find(stores, part_of(unit, unit.start, stop)) for stop in ends)
    rows = rows if rows is not None else next((part for part in parts if part is not None), None)
    return rows and {name: values[:end - unit.start] for name, values in rows.items()}


def averaged_points(plan: Plan, axes: Sequence[int]) -> Iterator[dict[int, int]]:
    """The points of the axes that entries are averaged over: of all but `axes`."""
    rest = [n for n in range(len(plan.study.axes)) if n not in axes]
    for points in product(*(range(len(plan.study.axes[n].values)) for n in rest)):
        yield dict(zip(rest, points, strict=True))


def setting_index(plan: Plan, points: Mapping[int, int]) -> int:
    """The setting at these points, one of each axis."""
    index = 0
    for n, axis in enumerate(plan.study.axes):
        index = index * len(axis.values) + points[n]
    return index


def _find(stores: Sequence[Store], unit: Unit) -> Columns | None:
    """A unit's rows; a unit that was set aside counts as episodes that all failed."""
    for store in stores:
        if (rows := store.read(unit)) is not None:
            return rows
    if any(store.log(unit).exists() for store in stores):
        return {"status": np.full(unit.stop - unit.start, "unit_failed", object)}
    return None


def failed(rows: Columns) -> np.ndarray:
    """Which episodes failed: by their status, or because no body was recovered."""
    bad = rows["status"] != "ok"
    if "chamfer_mm" in rows:
        bad = bad | ~np.isfinite(rows["chamfer_mm"].astype(float))
    return bad.astype(bool)


FAULTS = ("strategy_failed", "not_possible")
"""Statuses of episodes whose notes say what is wrong with their strategy."""


def fault_of(rows: Columns) -> str:
    """What the first of these episodes says whose strategy is at fault; empty where none is."""
    pairs = zip(rows["status"], rows.get("note", ()), strict=False)
    return next((str(note) for status, note in pairs if note and status in FAULTS), "")


def fault_line(label: str, fault: str) -> str:
    """The line that says what is wrong with a strategy."""
    return f"strategy {label} failed: {fault}"


def asked_to_recognize(rows: Columns) -> bool:
    """Whether rows tell what objects were taken for; a unit that failed would have."""
    return "recognized" in rows or bool((rows["status"] == "unit_failed").all())


def ranked_values(rows: Columns, metric: str) -> np.ndarray:
    """`values_of` a metric that entries are ranked by: what an episode cost whose strategy was at
    fault is not known, or failing early would pay."""
    values = values_of(rows, metric)
    return np.where(np.isin(rows["status"], FAULTS), np.nan, values) if metric in COSTS else values


def values_of(rows: Columns, name: str) -> np.ndarray:
    """A column as numbers, NaN where the rows have none; `failure_rate` too.

    A failed episode without a value of which more is better has 0. Rows of a unit that failed
    recognized nothing.
    """
    count = len(rows["status"])
    if name == "failure_rate":
        return failed(rows).astype(float)
    if name == "recognized" and name not in rows:
        return np.zeros(count)
    values = rows[name].astype(float) if name in rows else np.full(count, np.nan)
    if name in HIGHER_IS_BETTER:
        values = np.where(failed(rows) & ~np.isfinite(values), 0.0, values)
    return values
