"""A study's episodes for analyses of your own: as an Arrow table, or streamed to one flat file.

A flat file has one row an episode, a contact, or a point of a curve, and plain columns alone: the
swept keys are columns too. What has no value is null (an empty cell in CSV), so that means skip
it. Strategies come in the order of the spec, then objects, settings and episodes. Of a race there
are the episodes that each entry took, in the rungs that are over.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa

from sweeps.analysis.entries import (
    averaged_points,
    entries_of,
    entry_axes,
    setting_index,
    value_text,
)
from sweeps.output import atomic_file, note
from sweeps.run.grown_units import begun_in
from sweeps.run.plan import Plan, Unit, cell_hash, unit_id
from sweeps.run.race_record import race_of, read_race_note, taken_blocks
from sweeps.run.store import Store, damaged_notes, open_study
from sweeps.run.unit_file import Columns, holds_lists
from sweeps.spec.errors import StoreError
from sweeps.spec.study import Study
from warpgrasp.core.plain_text import csv_cell

GROUP = 65_536
"""Rows written together: few enough for memory, many enough for Parquet."""
NAMES = ("episode", "strategy", "object", "seed")


def read_rows(*folders: str | Path) -> pa.Table:
    """Every finished episode of a study, a row each; `.to_pandas()` where pandas is installed.

    Beside the columns of the units, `setting` numbers the point of the swept axes, and each swept
    key is a column of its own, as text. `folders` hold one study, or its shards. Units that are
    missing, failed or damaged are told on stderr. Raises TypeError for what is no name of a
    directory, StoreError for one that cannot be read or the race of a search, or where no unit is
    finished, OtherStudy where they are not of one study.
    """
    if not folders:
        raise StoreError("read_rows: no directory is named; should be that of a study")
    for folder in folders:
        if not isinstance(folder, str | Path):
            raise TypeError(f"read_rows: is given {folder!r:.80}; should be the name of a "
                            "directory, and of others after it")
    plan, stores = open_study([Path(folder) for folder in folders])
    parts: list[pa.Table] = []
    units = failed = 0
    for unit, setting in _units(plan, stores):
        units += 1
        rows = _first(store.read(unit) for store in stores)
        if rows is None:
            failed += any(store.log(unit).exists() for store in stores)
        else:
            count = len(rows["status"])
            rows = rows | {"setting": np.full(count, setting, np.int64)} | {
                key: np.full(count, str(value), object)
                for key, value in unit.cell.setting.items()}
            parts.append(pa.table({name: values.tolist() if values.dtype == object else values
                                   for name, values in rows.items()}))
    if not parts:
        raise StoreError(_nothing(Path(folders[0]), 0, "episodes"))
    for line in (*_notes(units, failed, len(parts), len(parts), "episodes"),
                 *damaged_notes(stores)):
        note(line)
    return pa.concat_tables(parts, promote_options="default")


def write_rows(folders: Sequence[Path], out: Path, what: str) -> tuple[int, list[str]]:
    """Writes a study's `episodes`, `contacts` or `curves` to a .parquet or .csv file, whole or not
    at all; memory does not grow with the study. Returns the number of rows, and notes.

    Raises StoreError where the study has none of them, OtherStudy as `read_rows`, OSError where
    the file cannot be written.
    """
    plan, stores = open_study(folders)
    find, _ = KINDS[what]
    known = _contact_types(plan, stores) if what == "contacts" else {}
    units = finished = found = count = failed = 0
    waiting: list[pa.Table] = []
    with atomic_file(out) as stream, _writer(stream, out.suffix) as write:
        for unit, setting in _units(plan, stores):
            units += 1
            if not any(store.path(unit).exists() for store in stores):
                failed += any(store.log(unit).exists() for store in stores)
                continue
            finished += 1
            columns = find(stores, unit)
            if columns is None:
                continue
            found += 1
            waiting.append(_table(columns, known, unit, setting, plan.study))
            count += len(waiting[-1])
            if sum(map(len, waiting)) >= GROUP:
                write(waiting)
                waiting = []
        if not found:
            raise StoreError(_nothing(folders[0], finished, what))
        write(waiting)
    return count, [*_race_notes(plan, stores), *_notes(units, failed, finished, found, what),
                   *damaged_notes(stores)]


def _units(plan: Plan, stores: Sequence[Store]) -> Iterator[tuple[Unit, int]]:
    """Every unit, as far as it is there, with the number of its setting; of a race those of the
    rungs that are over."""
    study = plan.study
    if races := [note for store in stores if (note := race_of(plan, store)) is not None]:
        yield from _race_units(plan, races, stores[0].folder)
        return
    longest = begun_in(stores)
    for strategy, body, setting in sorted(study.cells()):
        cell = study.cell(strategy, body, setting)
        name = cell_hash(cell, study.objects[body])
        for block in range(plan.block_count):
            yield longest(plan.unit(cell, name, block)), setting


def _race_units(plan: Plan, races: Sequence[dict[str, Any]], folder: Path
                ) -> Iterator[tuple[Unit, int]]:
    """Those that the notes of a race name, in the order of the study."""
    study = plan.study
    if study.search is not None:
        raise StoreError(f"{folder} holds a race of what a [search] proposed: see its search.csv "
                         "and race.csv. Rows are of entries that the spec itself has", 3)
    axes = entry_axes(plan, None)[0]
    entries = {entry.label: entry for entry in entries_of(plan, axes)}
    blocks = {(entries[told["label"]].strategy, body,
               setting_index(plan, case | entries[told["label"]].points), first, last)
              for race in races for told in race["entries"] if told["label"] in entries
              for body, first, last in taken_blocks(study, race, told["stops"])
              for case in averaged_points(plan, axes)}
    for indices, of_cell in groupby(sorted(blocks), key=lambda block: block[:3]):
        cell = study.cell(*indices)
        name = cell_hash(cell, study.objects[indices[1]])
        for *_, first, last in of_cell:
            yield Unit(unit_id(name, first, last), name, cell, first, last), indices[2]


def _first(found: Iterator[Columns | None]) -> Columns | None:
    return next((columns for columns in found if columns is not None), None)


def _episodes(stores: Sequence[Store], unit: Unit) -> Columns | None:
    """A unit's rows without their lists."""
    rows = _first(store.read(unit) for store in stores)
    return rows and {name: values for name, values in rows.items() if not holds_lists(values)}


def _curves(stores: Sequence[Store], unit: Unit) -> Columns | None:
    """The curves of a unit's rows, one below the other; a row a point."""
    rows = _first(store.read(unit) for store in stores)
    curves = {name: values for name, values in (rows or {}).items() if name.startswith("curve_")}
    if rows is None or not curves:
        return None
    counts = [len(curve) for curve in next(iter(curves.values()))]
    points = [np.arange(count, dtype=np.int64) for count in counts]
    return {name: np.repeat(rows[name], counts) for name in NAMES} | {
        "point": np.concatenate(points)} | {
        name.removeprefix("curve_"): np.concatenate(list(values))
        for name, values in curves.items()}


def _contacts(stores: Sequence[Store], unit: Unit) -> Columns | None:
    return _first(store.read_contacts(unit) for store in stores)


KINDS: dict[str, tuple[Callable[[Sequence[Store], Unit], Columns | None], str]] = {
    "episodes": (_episodes, "rows"), "contacts": (_contacts, "contacts"),
    "curves": (_curves, "curves")}


def _contact_types(plan: Plan, stores: Sequence[Store]) -> dict[str, pa.DataType]:
    """The columns of the contacts of all units: hands differ in their number of joints."""
    found: dict[str, pa.DataType] = {}
    for unit, _ in _units(plan, stores):
        for store in stores:
            found = store.contact_types(unit) | found
    return found


def _table(columns: Columns, known: dict[str, pa.DataType], unit: Unit, setting: int, study: Study
           ) -> pa.Table:
    """A unit's columns, with those of its setting after its names, and nulls in those `known` ones
    that it has not."""
    count = len(next(iter(columns.values())))
    arrays = {name: _array(columns[name]) for name in NAMES if name in columns}
    arrays["setting"] = pa.array(np.full(count, setting, np.int64))
    for key, kind in _setting_types(study).items():
        value = unit.cell.setting.get(key)
        if value is not None and kind == pa.string():
            value = value_text(value)
        arrays[key] = pa.array([value] * count, kind)
    for name in known | columns:
        if name not in arrays:
            arrays[name] = (_array(columns[name]) if name in columns
                            else pa.nulls(count, known[name]))
    return pa.table(arrays)


def _array(values: np.ndarray) -> pa.Array:
    """Text, of which there may be none, or numbers, of which NaN becomes null."""
    return pa.array(values, pa.string() if values.dtype == object else None, from_pandas=True)


def _setting_types(study: Study) -> dict[str, pa.DataType]:
    """The type of each swept key: of numbers and truth values their own, else text."""
    found = {}
    for axis in study.axes:
        for n, key in enumerate(axis.keys):
            kinds = {type(point[n]) for point in axis.values}
            found[key] = {frozenset({bool}): pa.bool_(), frozenset({int}): pa.int64(),
                          frozenset({float}): pa.float64(),
                          frozenset({int, float}): pa.float64()}.get(frozenset(kinds), pa.string())
    return found


@contextmanager
def _writer(stream: BinaryIO, ending: str) -> Iterator[Callable[[Sequence[pa.Table]], None]]:
    """What writes tables one below the other, all of the first one's columns."""
    import pyarrow.csv
    import pyarrow.parquet

    as_csv = ending.lower() == ".csv"
    writer: Any = None
    schema: pa.Schema | None = None

    def write(tables: Sequence[pa.Table]) -> None:
        nonlocal writer, schema
        for table in tables:
            schema = schema or table.schema
            if table.schema != schema:
                raise StoreError("the units of the study do not have the same columns: different "
                                 "versions made them; run the sweep again in a new directory")
        if not tables:
            return
        if writer is None:
            writer = (pyarrow.csv.CSVWriter(stream, schema) if as_csv else
                      pyarrow.parquet.ParquetWriter(stream, schema, compression="zstd"))
        whole = pa.concat_tables(tables)
        writer.write_table(_without_formulas(whole) if as_csv else whole)

    try:
        yield write
    finally:
        if writer is not None:
            writer.close()


def _without_formulas(table: pa.Table) -> pa.Table:
    """Text that a spreadsheet would run begins with an apostrophe; numbers stay as they are."""
    for n, field in enumerate(table.schema):
        if field.type == pa.string():
            table = table.set_column(n, field, pa.chunked_array(
                [[text and csv_cell(text) for text in chunk.to_pylist()] for chunk in
                 table.column(n).chunks], pa.string()))
    return table


def _nothing(folder: Path, finished: int, what: str) -> str:
    if not finished:
        return (f"{folder}: no unit is finished yet; `warpgrasp status` says how far it is, and "
                "how many failed")
    if what == "contacts":
        return (f"{folder}: keeps no contacts; write keep = \"contacts\" at the top of its spec "
                "and run the sweep again")
    return f"{folder}: holds no curves"


def _race_notes(plan: Plan, stores: Sequence[Store]) -> Iterator[str]:
    for store in stores:
        if race_of(plan, store) is not None:
            yield (f"{store.folder} holds a race: rows are those of its rungs that are over, of an "
                   "entry as many as it took part in")
        elif read_race_note(store.logs) is not None:
            yield (f"{store.folder} holds a sweep that was finished before it was raced: rows are "
                   "those of the sweep")


def _notes(units: int, failed: int, finished: int, found: int, what: str) -> Iterator[str]:
    if failed:
        yield (f"{failed} of {units} units failed and have no rows; see "
               "logs/*.failed.log")
    if missing := units - finished - failed:
        yield f"{missing} of {units} units are missing"
    if found < finished:
        yield f"{finished - found} finished units have no {KINDS[what][1]}"
