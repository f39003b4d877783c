"""Files of the user's that a spec names: each is found, read once, and its name made absolute.

A study keeps copies, and beside the `spec.toml` that it keeps they are taken, so that its directory
can be given away.

`[fit] reconstruct` is a word, or a function in a file; `[recognition] models` is a file that
`warpgrasp learn` wrote. `arm = "ur5e"`, an arm that ships or a TOML file, stands in place of
`[arm]`; in a sweep, `arm = ["puma560", "ur5e"]` compares arms.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path, PurePath
from typing import Any

from strategies.planners.planner_file import PlannerError
from strategies.reconstruct.plug_in_name import BUILT_IN as WORDS
from strategies.reconstruct.plug_in_name import find_plug_in, plug_in_file
from sweeps.spec.errors import KeyPath, Problems, choose, short
from sweeps.spec.study import Axis
from warpgrasp.parameters import (
    FLOATING,
    PUMA560,
    RecognitionTable,
)

KEY = "fit.reconstruct"
MODELS_LIMIT = 1 << 24
"""Bytes of a file of models."""
CSV_LIMIT = 1 << 20  # bytes of a file of poses or of a profile
MESH_LIMIT = 1 << 28
UNSWEPT = "recognition.models"
"""The key that names a file; a study keeps one."""
ARM_LIMIT = 1 << 20
KEPT = Path("inputs/files.json")
"""Beside the `spec.toml` that a study keeps: under which copy each file that it names is found."""


class NoFile(ValueError):
    """A file that cannot be used; the message says why."""


def named_file(value: Any, base_dir: Path, limit: int) -> Path:
    """The file a spec names, relative to the spec, made absolute; beside the spec that a study
    keeps, the copy that it has. Raises NoFile.

    Devices, pipes and the endless files of /proc, which say that they are empty, are refused.
    """
    if not isinstance(value, str) or not value:
        raise NoFile(f"is {short(value)}; should be a file")
    try:
        file = kept_file(value, base_dir) or _absolute(base_dir / value)
        if not file.is_file():
            raise FileNotFoundError(file)
        size = file.stat().st_size
    except (OSError, ValueError, RuntimeError):
        raise NoFile(f"{short(value)} is not a file; looked for as "
                     f"{short(str(base_dir / value), 200)}") from None
    if size == 0:
        raise NoFile(f"{short(value)} is empty")
    if size > limit:
        raise NoFile(f"{short(value)} is larger than {limit >> 20} MiB, the limit")
    return file


def _absolute(file: Path) -> Path:
    """The whole path, by the links that the spec names, unless `..` leads elsewhere by them."""
    plain, true = Path(os.path.abspath(file)), file.resolve()
    return plain if plain.resolve() == true else true


def kept_files(base_dir: Path) -> dict[str, str]:
    """The copies of a study, relative to its directory, by the names of the spec beside them;
    none beside other specs."""
    return _json(base_dir / KEPT)


def kept_name(spec: Path) -> str:
    """The name of the study that keeps a spec; empty where none does."""
    return str(_json(spec.with_name("resolved.json")).get("name", ""))


def _json(file: Path) -> dict[str, Any]:
    try:
        found = json.loads(file.read_text())
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def kept_file(name: str, base_dir: Path) -> Path | None:
    """The copy of a file that the spec names, if a study keeps the spec and one."""
    copy = kept_files(base_dir).get(os.path.normpath(name))
    return (base_dir / copy).resolve() if copy else None


def kept_matching(pattern: str, base_dir: Path) -> list[Path]:
    """The copies of the files that a pattern stood for, in the order of their names."""
    wanted = PurePath(os.path.normpath(pattern))
    kept = {PurePath(name): copy for name, copy in kept_files(base_dir).items()}
    return [(base_dir / kept[name]).resolve() for name in sorted(kept)
            if name.is_absolute() == wanted.is_absolute() and _matches(name.parts, wanted.parts)]


def _matches(parts: Sequence[str], wanted: Sequence[str]) -> bool:
    if not wanted:
        return not parts
    if wanted[0] == "**":
        inside = bool(parts) and parts[0] != os.pardir
        return _matches(parts, wanted[1:]) or (inside and _matches(parts[1:], wanted))
    return (bool(parts) and fnmatchcase(parts[0], wanted[0])
            and _matches(parts[1:], wanted[1:]))


def names_of(copies: Mapping[Path, str], base_dir: Path) -> dict[str, str]:
    """What `kept_files` will find: `copies` are those of the files read, by their whole paths.

    A file has its name relative to the spec, and its whole path. Of a file that is itself a copy,
    what it was called before.
    """
    before: dict[Path, list[str]] = {}
    for name, copy in kept_files(base_dir).items():
        before.setdefault((base_dir / copy).resolve(), []).append(name)
    names: dict[str, str] = {}
    for file, copy in copies.items():
        own = [os.path.relpath(file, base_dir), str(file)]
        names.update(dict.fromkeys(before.get(file, own), copy))
    return names


def read_reconstruct(value: str, base_dir: Path, problems: Problems) -> str:
    """The word, or `file.py:function` with its file made absolute; what is wrong is noted."""
    path = "fit", "reconstruct"
    if value in WORDS:
        return value
    file = plug_in_file(value)
    if not file:
        problems.add(path, f"is {short(value)}; {choose(value, WORDS)}; or a function in a "
                     'file, as "mine.py:my_network"')
        return WORDS[0]
    try:
        call = f"{named_file(file, base_dir, CSV_LIMIT)}:{value.rpartition(':')[2]}"
    except NoFile as error:
        problems.add(path, str(error))
        return WORDS[0]
    try:
        find_plug_in(call)
    except PlannerError as error:
        problems.add(path, str(error))
    return call


def check_swept_reconstruct(values: Any, path: KeyPath, problems: Problems) -> None:
    """Notes a value of a sweep that is no word: a plug-in is named in [fit]."""
    for value in values:
        if value not in WORDS:
            problems.add(path, f"{KEY}: is {short(value)}; {choose(value, WORDS)}; a function of "
                         "yours is named in [fit], not in a sweep")


def with_models(
    table: RecognitionTable, base_dir: Path, problems: Problems
) -> RecognitionTable:
    """The table with its file made absolute; what is wrong with the file is noted."""
    if not table.models:
        return table
    path = ("recognition", "models")
    try:
        file = named_file(table.models, base_dir, MODELS_LIMIT)
    except NoFile as error:
        problems.add(path, str(error))
        return table
    # Heavy, and only a study with a file of its own needs it.
    from strategies.recognition.known_models import ModelsError, models_from_file

    try:
        unused = models_from_file(str(file)).unused
    except ModelsError as error:
        problems.add(path, str(error))
    else:
        if table.way in unused:
            problems.add(("recognition", "way"), f"{table.way}: was not tried on every object of "
                         f"{file.name}, so that nothing can be recognized by it; should be "
                         "as_felt, or learn the objects with strategies that try it")
    return replace(table, models=str(file))


def read_arm(value: str, base_dir: Path, problems: Problems, path: KeyPath = ("arm", "kind")
             ) -> str:
    """The name of an arm that ships, or its file made absolute; what is wrong is noted."""
    if value in (PUMA560, FLOATING):
        return value
    from warpgrasp.arms.arm_file import SHIPPED_ARMS, arm_from_file
    from warpgrasp.arms.arm_model import ArmError

    if value in SHIPPED_ARMS:
        return value
    if not value.endswith(".toml"):
        known = (PUMA560, FLOATING, *SHIPPED_ARMS)
        problems.add(path, f"no arm {short(value)}; {choose(value, known)}; or a TOML file, as "
                     "`warpgrasp arm URDF -o my_arm.toml` writes it")
        return PUMA560
    try:
        file = str(named_file(value, base_dir, ARM_LIMIT))
        arm_from_file(Path(file))
    except (NoFile, ArmError) as error:
        problems.add(path, str(error))
        return PUMA560
    return file


def with_files(axis: Axis, key: str, read: Callable[..., str], base_dir: Path, problems: Problems
               ) -> Axis:
    """An axis of a sweep whose hands or arms, under `key`, are found: `read` is `read_hand` or
    `read_arm`."""
    if key not in axis.keys:
        return axis
    at = axis.keys.index(key)
    path = problems.at_swept(key)
    si = tuple((*point[:at], read(point[at], base_dir, problems, path), *point[at + 1:])
               for point in axis.si)
    return replace(axis, si=si)
