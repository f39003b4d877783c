"""What a study consists of: its canonical form, its hash, and its fixed list of units of work.

A unit is a block of consecutive episodes of one cell. Its id is a hash of everything its rows
depend on, so that the same unit is found again after an interruption, in another shard, or in a
study that has grown; nothing that does not matter (paths, the study's name, other cells) is in it.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, fields
from functools import cache
from itertools import groupby, zip_longest
from operator import itemgetter
from pathlib import Path
from typing import Any

from strategies.planners.planner_file import files_beside
from strategies.poses.waypoints import WAYPOINT_KINDS
from strategies.reconstruct.plug_in_name import call_by_content, plug_in_file
from strategies.strategy import Strategy
from sweeps.spec.cell import SECTIONS, TABLES, Cell
from sweeps.spec.search import canonical_search, search_of
from sweeps.spec.study import ARM_KEY, FILE_KEYS, HAND_KEY, Axis, Body, Study, StudyTable

RESULTS_SCHEMA = 54  # raise when rows change their meaning: older units are then computed again
BLOCK = 64  # episodes of a unit; rows do not depend on it
TOGETHER = 8  # units of a cell before the next cell's turn: as many as one call takes
WIDEST = 100  # characters that are shown of a value
LEAST_RUNS = 8  # of a shard: the last one may be missing in some, an eighth of their work


@dataclass(frozen=True)
class Unit:
    """Episodes `start` to `stop` of one cell."""

    id: str
    cell_hash: str
    cell: Cell
    start: int
    stop: int


@dataclass(frozen=True)
class Plan:
    """A study with its canonical form and hash."""

    study: Study
    resolved: Mapping[str, Any]
    hash: str
    folders: tuple[Path, ...] = ()
    """Directories that keep what a study read back from its `resolved.json` was read from."""

    @property
    def block_count(self) -> int:
        """Units of one cell."""
        return -(-self.study.head.episodes_per_cell // BLOCK)

    @property
    def unit_count(self) -> int:
        """Units of the whole study."""
        return self.study.cell_count * self.block_count

    def units(self, shard: tuple[int, int] = (1, 1)) -> Iterator[Unit]:
        """The units of shard I of N, in the order they are run: every N-th run of some units."""
        index, count = shard
        run = self._run_length(count)
        mine = (found for number, found in enumerate(self.blocks())
                if number // run % count == index - 1)
        for indices, blocks in groupby(mine, key=itemgetter(0)):
            cell = self.study.cell(*indices)
            name = cell_hash(cell, self.study.objects[indices[1]])
            for _, block in blocks:
                yield self.unit(cell, name, block)

    def blocks(self) -> Iterator[tuple[tuple[int, int, int], int]]:
        """Every unit by its cell's strategy, object and setting, and its number in the cell.

        In the order they are run: the first of every cell before the next ones of any, so that
        entries can be compared when a part is done.
        """
        for start in range(0, self.block_count, TOGETHER):
            for cell in self.study.cells():
                for block in range(start, min(start + TOGETHER, self.block_count)):
                    yield cell, block

    def shard_size(self, shard: tuple[int, int]) -> int:
        """How many units a shard has."""
        index, count = shard
        run = self._run_length(count)
        begins = range((index - 1) * run, self.unit_count, count * run)
        return sum(min(run, self.unit_count - begin) for begin in begins[-1:]) + run * len(
            begins[:-1])

    def _run_length(self, shards: int) -> int:
        """Units that follow each other in a shard: what can be run in one call, so that shards have
        it too, but so few that a shard has at least eight runs."""
        together = self.study.group_size * min(self.block_count, TOGETHER)
        return max(1, min(together, self.unit_count // (LEAST_RUNS * shards)))

    def unit(self, cell: Cell, name: str, block: int) -> Unit:
        """Block `block` of a cell."""
        start = block * BLOCK
        stop = min(start + BLOCK, self.study.head.episodes_per_cell)
        return Unit(unit_id(name, start, stop), name, cell, start, stop)


def plan_study(study: Study, *, read_again: bool = True) -> Plan:
    """The plan of a study; its files are read once each, with `read_again` also those that were
    read for an earlier plan."""
    if read_again:
        forget_files()
    resolved = canonical_study(study)
    return Plan(study, resolved, digest(resolved))


def forget_files() -> None:
    """Has files that were hashed read again."""
    _file_hash.cache_clear()
    _TABLES.clear()


def digest(value: Any) -> str:
    """A hash of plain data, equal on every machine."""
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def cell_hash(cell: Cell, body: Body) -> str:
    """A hash of all that the episodes of a cell depend on."""
    return digest({
        "strategy": canonical_strategy(cell.strategy), "object": cell.object_name,
        "body": canonical_body(body), "seed": cell.seed,
        **{name: _same_table(getattr(cell, name)) for name in TABLES},
        **({} if cell.true is None else {"true": asdict(cell.true)})})


def unit_id(cell_name: str, start: int, stop: int) -> str:
    """The id of a block of episodes of a cell."""
    return digest([RESULTS_SCHEMA, cell_name, start, stop])


def part_of(unit: Unit, start: int, stop: int) -> Unit:
    """The unit of some of a unit's episodes."""
    return Unit(unit_id(unit.cell_hash, start, stop), unit.cell_hash, unit.cell, start, stop)


def canonical_strategy(strategy: Strategy) -> dict[str, Any]:
    """A strategy as plain data; a file of poses by its content."""
    waypoints = []
    for family in strategy.waypoints:
        values = asdict(family)  # type: ignore[arg-type]
        if "file" in values:
            values["sha256"] = _file_hash(values.pop("file"))
        waypoints.append({"kind": type(family).__name__.lower(), **values})
    found = {"name": strategy.name, "waypoints": waypoints, "closings": list(strategy.closings),
             "order": list(strategy.order), "options": [list(pair) for pair in strategy.options],
             **{key: getattr(strategy, key) for key in _PLAIN}}
    file, colon, function = strategy.call.rpartition(":")
    if colon and file.endswith(".py"):
        found |= {"call": f"{Path(file).name}:{function}", "call_sha256": program_hash(file)}
    return found


_PLAIN = ("call", "refit_every", "touches", "robot_time_s", "volume_ratio", "noise_stream")


def same_bodies(study: Study) -> Iterator[str]:
    """What to say of objects that are one body under several names, by their tables and the content
    of their files."""
    first: dict[str, str] = {}
    for body in study.objects:
        table = {key: value for key, value in body.table.items() if key != "name"}
        shape = digest([_without_folders("", table or {"object": body.name}, ""), body.sha256])
        if (other := first.setdefault(shape, body.name)) != body.name:
            yield (f"{other} and {body.name} are the same body, so that their episodes are the "
                   "same; intervals take them for two objects")


def canonical_body(body: Body) -> dict[str, Any]:
    """An object as plain data; files by their content, not their place."""
    return {"table": _without_folders("", body.table), "sha256": body.sha256}


def _without_folders(key: str, value: Any, file: str | None = None) -> Any:
    """A table whose files have their names alone, or all the name `file`."""
    if isinstance(value, Mapping):
        return {name: _without_folders(name, entry, file) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_without_folders("", entry, file) for entry in value]
    if key not in FILE_KEYS or not isinstance(value, str):
        return value
    return Path(value).name if file is None else file


def canonical_table(table: Any) -> dict[str, Any]:
    """A section of a spec as plain data; files that it names, of a function that recovers bodies
    and of known models, by their content."""
    values = asdict(table)
    if models := values.get("models"):
        values["models"] = f"sha256:{_file_hash(models)}"
    if "kind" in values:
        values["kind"] = _kind_by_content(values["kind"])
    if file := plug_in_file(values.get("reconstruct", "")):
        values["reconstruct"] = call_by_content(values["reconstruct"], program_hash(file))
    return values


def canonical_study(study: Study) -> dict[str, Any]:
    """A study as plain data, every default filled in: what `resolved.json` holds."""
    return json.loads(json.dumps({
        "results_schema": RESULTS_SCHEMA,
        "seed": study.head.seed,
        "episodes_per_cell": study.head.episodes_per_cell,
        "objects": {body.name: canonical_body(body) for body in study.objects},
        "strategies": {s.name: canonical_strategy(s) for s in study.strategies},
        **{name: canonical_table(table) for name, table in study.tables.items()},
        "sweep": [_canonical_axis(axis) for axis in study.axes],
        **({} if study.search is None else {"search": canonical_search(study.search)}),
    }))


def _canonical_axis(axis: Axis) -> dict[str, Any]:
    si = tuple(tuple(_kind_by_content(value) if key in (HAND_KEY, ARM_KEY) else value
                     for key, value in zip(axis.keys, point, strict=True)) for point in axis.si)
    return {"sampled": axis.sampled, "keys": axis.keys, "values": axis.values, "si": si}


def _kind_by_content(kind: str) -> str:
    """A hand's or an arm's name, or the content of its file."""
    return f"sha256:{_file_hash(kind)}/{Path(kind).name}" if kind.endswith(".toml") else kind


_TABLES: dict[int, tuple[Any, dict[str, Any]]] = {}
"""Canonical tables by the identity of the table, which is kept so that none other takes its place.
Most cells of a study share most of their tables. Equal ones may differ in kind: 1 and 1.0."""
_MOST_TABLES = 4096


def _same_table(table: Any) -> dict[str, Any]:
    """`canonical_table`, computed once of each table."""
    if (known := _TABLES.get(id(table))) is None:
        if len(_TABLES) >= _MOST_TABLES:
            _TABLES.clear()
        known = _TABLES[id(table)] = table, canonical_table(table)
    return known[1]


@cache
def _file_hash(file: str) -> str:
    if file.startswith("sha256:"):  # of a study read back from its canonical form
        return file.removeprefix("sha256:").partition("/")[0]
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()


def program_hash(file: str) -> str:
    """Of a planner's file and, if it imports any, of those beside it."""
    content = _file_hash(file)
    return files_hash(content, {} if file.startswith("sha256:") else files_beside(Path(file)))


def files_hash(content: str, beside: Mapping[str, str]) -> str:
    """The hash of a planner by that of its file and, by name, of those beside it."""
    return digest([content, dict(beside)]) if beside else content


def study_of(resolved: Mapping[str, Any], name: str = "", keep: str = "nothing") -> Study:
    """The study that `canonical_study` wrote, with the same units; `name` and what to `keep` are
    not part of it.

    Where meshes and files of poses were is not kept, only their content's hash: the units of such
    a study can be found, but not run.
    """
    def strategy(label: str, values: Mapping[str, Any]) -> Strategy:
        call = values["call"]
        if "call_sha256" in values:
            call = f"sha256:{values['call_sha256']}/{call}"
        plain = {key: values[key] for key in _PLAIN if key != "call"}
        return Strategy(label, tuple(family(v) for v in values["waypoints"]),
                        tuple(values["closings"]), tuple(values["order"]), call=call,
                        options=tuple((k, _tuples(v)) for k, v in values["options"]), **plain)

    def family(values: Mapping[str, Any]) -> object:
        given = {k: _tuples(v) for k, v in values.items() if k not in ("kind", "sha256")}
        if "sha256" in values:
            given["file"] = f"sha256:{values['sha256']}"
        kind = WAYPOINT_KINDS[values["kind"]]
        return kind(**{f.name: given[f.name] for f in fields(kind) if f.init and f.name in given})

    return Study(
        StudyTable(name=name, seed=resolved["seed"],
                   episodes_per_cell=resolved["episodes_per_cell"], keep=keep),
        tuple(Body(label, **values) for label, values in resolved["objects"].items()),
        tuple(strategy(label, values) for label, values in resolved["strategies"].items()),
        {section: table(**{k: _tuples(v) for k, v in resolved[section].items()})
         for section, table in SECTIONS.items()},
        tuple(Axis(**{k: _tuples(v) for k, v in axis.items()}) for axis in resolved["sweep"]),
        search_of(resolved["search"]) if "search" in resolved else None)


def _tuples(value: Any) -> Any:
    return tuple(_tuples(entry) for entry in value) if isinstance(value, list) else value


def differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Where two resolved studies differ, one line each, as `key: old -> new`."""
    before, after = dict(_leaves(by_key(old))), dict(_leaves(by_key(new)))
    if before == after:  # the same values, in another kind of sweep
        before, after = dict(_leaves(old)), dict(_leaves(new))
    return [f"{key}: {' -> '.join(_cut(before.get(key, 'absent'), after.get(key, 'absent')))}"
            for key in sorted(before | after) if before.get(key) != after.get(key)]


def by_key(resolved: Mapping[str, Any]) -> dict[str, Any]:
    """A resolved study with a list of values for every swept key, as `sweep.KEY`."""
    swept = {f"sweep.{key}": [point[n] for point in axis["values"]]
             for axis in resolved.get("sweep", ()) for n, key in enumerate(axis["keys"])}
    return {name: value for name, value in resolved.items() if name != "sweep"} | swept


def _cut(old: str, new: str) -> tuple[str, str]:
    """Two texts that differ, cut at their ends; where they would look alike, at their beginnings,
    too, so that what differs is seen."""
    if old[:WIDEST - 3] == new[:WIDEST - 3]:
        alike = next(n for n, (a, b) in enumerate(zip_longest(old, new)) if a != b)
        start = max(alike - WIDEST // 2, 0)
        old, new = f"...{old[start:]}", f"...{new[start:]}"
    return _shortened(old), _shortened(new)


def _shortened(text: str) -> str:
    return text if len(text) <= WIDEST else f"{text[:WIDEST - 3]}..."


def extends(old: Mapping[str, Any], new: Mapping[str, Any]) -> bool:
    """Whether the new study holds every episode of the old one, and perhaps more."""
    lists = ("objects", "strategies")
    same = all(old.get(key) == new.get(key) for key in {*old, *new}
               if key not in (*lists, "episodes_per_cell"))
    return (same and old["episodes_per_cell"] <= new["episodes_per_cell"] and all(
        old[key][name] == new[key].get(name) for key in lists for name in old[key]))


def _leaves(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(value, Mapping) and value:
        for name, entry in value.items():
            yield from _leaves(entry, f"{key}.{name}" if key else str(name))
    elif isinstance(value, list) and value and all(isinstance(v, Mapping) for v in value):
        for number, entry in enumerate(value):
            yield from _leaves(entry, f"{key}[{number}]")
    else:
        yield key, json.dumps(value)
