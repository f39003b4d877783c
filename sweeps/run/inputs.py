"""What a study was read from besides its spec: meshes, profiles, files of poses,
planners, known models, hands, arms.

A study keeps a copy of each below `inputs/HASH/`, under its own name, so that its episodes can be
run again when the originals have changed or the directory was moved. `HASH` is the one by which
`resolved.json` knows the content; a copy that no longer has it counts as missing. By
`inputs/files.json` the `spec.toml` beside it finds the copies.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

from strategies.planners.planner_file import files_beside
from strategies.reconstruct.plug_in_name import plug_in_file
from sweeps.output import write_atomic
from sweeps.run.changed_files import named_files
from sweeps.run.plan import files_hash, program_hash
from sweeps.spec.cell import Cell
from sweeps.spec.checks import arms_of
from sweeps.spec.errors import StoreError
from sweeps.spec.hands import hands_of
from sweeps.spec.named_files import KEPT, names_of
from sweeps.spec.objects import files_digest
from sweeps.spec.study import FILE_KEYS, Body, Study
from warpgrasp.parameters import ArmTable, HandTable

Kind = TypeVar("Kind", ArmTable, HandTable)

FOLDER = "inputs"
POSES = "poses.csv"
"""Of a copy of a file of poses, whose name is not known from `resolved.json`."""
MODELS = "models.json"
"""Of a copy of a file of known models, likewise."""


def keep_inputs(folder: Path, study: Study) -> None:
    """Copies what a study read into its directory, as far as it is not there yet.

    Raises OSError where that cannot be written, or a file has gone since the spec was read.
    """
    inputs = folder / FOLDER
    kept: dict[Path, str] = {}

    def keep(file: Path, copy: Path) -> None:
        _keep(file, copy)
        kept[file] = str(copy.relative_to(folder))

    for body in study.objects:
        files = [Path(file) for file in named_files(body.table)]
        if files and files_digest(files) != body.sha256:
            continue  # changed since the study was read: units that use them fail
        for number, file in enumerate(files):
            keep(file, inputs / body.sha256 / str(number) / file.name)
    for strategy in study.strategies:
        for family in strategy.waypoints:
            if file := getattr(family, "file", ""):
                keep(Path(file), inputs / _hash(Path(file)) / POSES)
    programs = [plug_in_file(strategy.call) for strategy in study.strategies]
    for file in filter(None, (*programs, plug_in_file(study.tables["fit"].reconstruct))):
        for name in (Path(file).name, *files_beside(Path(file))):
            keep(Path(file).with_name(name), inputs / program_hash(file) / name)
    if models := study.tables["recognition"].models:
        keep(Path(models), inputs / _hash(Path(models)) / MODELS)
    for kind in hands_of(study) | arms_of(study):
        if kind.endswith(".toml"):
            keep(Path(kind), inputs / _hash(Path(kind)) / Path(kind).name)
    if kept and study.base_dir:
        names = names_of(kept, study.base_dir)
        write_atomic(folder / KEPT, (json.dumps(names, indent=1) + "\n").encode())


def _keep(file: Path, copy: Path) -> None:
    content = file.read_bytes()
    if not copy.is_file() or copy.read_bytes() != content:
        copy.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(copy, content)


def kept_cell(cell: Cell, body: Body, folders: tuple[Path, ...]) -> Cell:
    """A cell of a study as `resolved.json` has it, with its files where a directory keeps them.

    Raises StoreError that names the file that none does.
    """
    names = list(named_files(cell.body_table))
    table, strategy = cell.body_table, cell.strategy
    if names:
        place = _find(folders, body.sha256, names[0], lambda place: body.sha256 == files_digest(
            [place / str(number) / name for number, name in enumerate(names)]))
        copies = iter([str(place / str(number) / name) for number, name in enumerate(names)])
        table = _with_files(table, lambda: next(copies))
    families = []
    for family in strategy.waypoints:
        if file := getattr(family, "file", ""):
            key = file.removeprefix("sha256:")
            place = _find(folders, key, f"poses of {strategy.name}",
                          lambda place, key=key: _hash(place / POSES) == key)
            family = replace(family, file=str(place / POSES))  # type: ignore[type-var]
        families.append(family)
    strategy = replace(strategy, waypoints=tuple(families))
    strategy = replace(strategy, call=_kept_call(strategy.call, folders))
    fits = replace(cell.fit, reconstruct=_kept_call(cell.fit.reconstruct, folders))
    recognition = cell.recognition
    if recognition.models:
        key = recognition.models.removeprefix("sha256:")
        place = _find(folders, key, "known models", lambda place: _hash(place / MODELS) == key)
        recognition = replace(recognition, models=str(place / MODELS))
    return replace(cell, body_table=table, strategy=strategy, fit=fits, recognition=recognition,
                   hand=_kept_kind(cell.hand, folders), arm=_kept_kind(cell.arm, folders),
                   true=cell.true and replace(cell.true, hand=_kept_kind(cell.true.hand, folders)))


def _kept_kind(table: Kind, folders: tuple[Path, ...]) -> Kind:
    """The table of a hand or an arm with its file where a directory keeps it."""
    if not table.kind.startswith("sha256:"):
        return table
    key, _, name = table.kind.removeprefix("sha256:").partition("/")
    place = _find(folders, key, name, lambda place: _hash(place / name) == key)
    return replace(table, kind=str(place / name))


def _kept_call(call: str, folders: tuple[Path, ...]) -> str:
    """A function of a user's file where a directory keeps it; names of ours stay."""
    if not call.startswith("sha256:"):
        return call
    key, _, rest = call.removeprefix("sha256:").partition("/")
    name = rest.rpartition(":")[0]
    place = _find(folders, key, name, lambda place: key == files_hash(
        _hash(place / name), {file.name: _hash(file) for file in sorted(place.glob("*.py"))
                              if file.name != name}))
    return f"{place}/{rest}"


def _find(folders: Sequence[Path], key: str, name: str, whole: Callable[[Path], bool]) -> Path:
    """The first directory that keeps the content of a hash."""
    for folder in folders:
        place = folder / FOLDER / key
        with suppress(OSError):
            if place.is_dir() and whole(place):
                return place.resolve()
    where = ", ".join(map(str, folders)) or "the study"
    raise StoreError(f"{name}: {where} keeps no copy with the content that the study was run with; "
                     "run the sweep again with its spec and its files, which keeps one")


def _with_files(value: Any, following: Callable[[], str]) -> Any:
    """A table with the files that it names, in its order, replaced."""
    if isinstance(value, Mapping):
        return {key: following() if key in FILE_KEYS and isinstance(entry, str)
                else _with_files(entry, following) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_with_files(entry, following) for entry in value]
    return value


def _hash(file: Path) -> str:
    return sha256(file.read_bytes()).hexdigest()
