"""The `objects` of a spec: catalogue names, meshes, compounds, superquadrics."""

import hashlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from sweeps.output import init_warp, quiet_stdout
from sweeps.spec.errors import KeyPath, Problems, check_name, choose, short
from sweeps.spec.named_files import CSV_LIMIT, MESH_LIMIT, NoFile, named_file
from sweeps.spec.object_sets import expanded, member_table, pose_name
from sweeps.spec.study import FILE_KEYS, Body
from warpgrasp.core.plain_text import on_one_line
from warpgrasp.objects.catalogue_names import (
    BODY_NAMES,
    NAME_LIMIT,
    NO_ANSWER,
    NONE_OF_THESE,
    family_hint,
    member_of_family,
)

SHAPES = ("mesh", "compound", "superquadric", "profile", "object")


class ObjectError(ValueError):
    """An object that cannot be built; the message says why."""


def read_objects(values: Any, base_dir: Path, problems: Problems) -> tuple[Body, ...]:
    """Every object of a spec, those of families and patterns included; each is built once to
    check it."""
    path: KeyPath = ("objects",)
    if not isinstance(values, list):
        problems.add(path, f"is {short(values)}; should be a list such as [\"block\"]")
        return ()
    if not values and path in problems.lines:
        problems.add(path, "is empty; name at least one object")
    found: list[Body] = []
    entries = [(n, value) for n, entry in enumerate(values)
               for value in expanded(entry, (*path, n), base_dir, problems)]
    for n, value in entries:
        body = read_object(value, (*path, n), base_dir, problems)
        if body and any(body.name == other.name for other in found):
            problems.add((*path, n), f"is {body.name!r} a second time; give one another name")
        elif body:
            found.append(body)
    return tuple(found)


def read_object(value: Any, path: KeyPath, base_dir: Path, problems: Problems) -> Body | None:
    """One object; None where something is wrong with it."""
    if isinstance(value, str):
        if value not in BODY_NAMES:
            problems.add(path, f"no object {short(value)}; {family_hint(value)}"
                         f"{choose(value, BODY_NAMES)}; or a mesh, "
                         'as in { mesh = "mug.stl", units = "cm" }')
            return None
        return Body(value, {"name": value})
    if not isinstance(value, Mapping):
        problems.add(path, f"is {short(value)}; should be a name or a table")
        return None
    given = [shape for shape in SHAPES if shape in value]
    if len(given) != 1:
        problems.add(path, f"should hold exactly one of {', '.join(SHAPES)}")
        return None
    files: list[Path] = []
    try:
        table = _absolute(value, path, base_dir, files)
    except _FileProblem as error:
        problems.add(error.path, error.what)
        return None
    if given[0] in FILE_KEYS:
        table.setdefault("name", files[0].stem)
    name = check_name(table.get("name"), (*path, "name"), problems)
    if name is None:
        return None
    try:
        _build(table, base_dir)
    except ObjectError as error:
        problems.add(path, str(error))
        return None
    return Body(name, table, files_digest(files) if files else "")


def object_of_argument(what: str, units: str | None,
                       stable_pose: int | None = None) -> dict[str, Any]:
    """The table of an object named on the command line, lying in a stable pose if one is numbered;
    `ObjectError` says what is wrong."""
    table = _table_of_argument(what, units)
    if stable_pose is None:
        return table
    table = {"object": what, **table} if set(table) == {"name"} else table
    table = table | {"name": pose_name(str(table["name"]), stable_pose),
                     "stable_pose": stable_pose}
    try:
        _build(table, Path())
    except ObjectError as error:
        raise ObjectError(f"--stable-pose: of {what}: {error}") from None
    return table


def floating_notes(bodies: Iterable[Body]) -> Iterator[str]:
    """What to say of meshes and compounds of which parts float, each built again for it."""
    asked = [body for body in bodies if {"mesh", "compound"} & body.table.keys()
             and not member_of_family(body.name)]
    if not asked:
        return
    from warpgrasp.objects.catalogue import body_from_table
    from warpgrasp.objects.floating import floating_parts

    for body in asked:
        for part in floating_parts(body_from_table(body.table, Path())):
            low, high = (f"{1e3 * z:.0f}" for z in (part.low_m[2], part.high_m[2]))
            x, y = (f"{500 * (part.low_m[k] + part.high_m[k]):.0f}" for k in (0, 1))
            yield (f"{body.name}: a part floats: that from {low} to {high} mm above the table, "
                   f"about x {x} and y {y} mm, touches neither the table nor another part; fingers "
                   "feel it there. Lower it, or join it to the rest")


def _table_of_argument(what: str, units: str | None) -> dict[str, Any]:
    if what in BODY_NAMES:
        return {"name": what}
    if member_of_family(what):
        return member_table(what)
    file = Path(what)
    if not file.is_file():
        if units is not None:
            raise ObjectError(f"{what}: there is no such mesh file")
        raise ObjectError(f"no object {what!r}; {family_hint(what)}{choose(what, BODY_NAMES)}; or "
                          "a mesh file with --units m|cm|mm|in")
    if units is None:
        raise ObjectError(f"{what}: a mesh needs its units: --units m, cm, mm or in")
    name = on_one_line(file.stem)[:NAME_LIMIT]  # rows are UTF-8, and names of files need not be
    table = {"mesh": str(file.resolve()), "units": units, "name": name}
    _build(table, Path())
    return table


def _build(table: Mapping[str, Any], base_dir: Path) -> None:
    """Build the object once. Raises ObjectError for any failure, also of a reader, and for a name
    that tables have for what is no object."""
    if table.get("name") in (NONE_OF_THESE, NO_ANSWER):
        raise ObjectError(f"is named {table['name']!r}, which tables of what was recognized have "
                          "for other things; give it another name")
    init_warp()
    from warpgrasp.geometry.body import BodyError
    from warpgrasp.objects.body_baking import check_walls
    from warpgrasp.objects.catalogue import body_from_table  # heavy; names need no building

    try:
        with quiet_stdout():
            check_walls(body_from_table(table, base_dir))
    except BodyError as error:
        raise ObjectError(str(error)) from error
    except Exception as error:  # not foreseen, but a user's file or table is no reason to crash
        raise ObjectError(f"cannot be built: {type(error).__name__}: {error}; the template of "
                        "`warpgrasp init` shows how objects are written") from error


class _FileProblem(Exception):
    def __init__(self, path: KeyPath, what: str) -> None:
        self.path = path
        self.what = what


def _absolute(table: Mapping[str, Any], path: KeyPath, base_dir: Path,
              files: list[Path]) -> dict[str, Any]:
    """The table with every file it names made absolute; the files are noted in order."""
    found: dict[str, Any] = {}
    for key, value in table.items():
        if key in FILE_KEYS:
            try:
                limit = MESH_LIMIT if key == "mesh" else CSV_LIMIT
                files.append(named_file(value, base_dir, limit))
            except NoFile as error:
                raise _FileProblem((*path, key), str(error)) from None
            found[key] = str(files[-1])
        elif isinstance(value, Mapping):
            found[key] = _absolute(value, (*path, key), base_dir, files)
        elif isinstance(value, list):
            found[key] = [_absolute(entry, (*path, key, n), base_dir, files)
                          if isinstance(entry, Mapping) else entry
                          for n, entry in enumerate(value)]
        else:
            found[key] = value
    return found


def files_digest(files: Sequence[Path]) -> str:
    """A hash of the content of the files that an object's table names, in its order."""
    return hashlib.sha256(b"".join(map(_content, files))).hexdigest()


def _content(file: Path) -> bytes:
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").digest()
