"""Entries of `objects` that stand for several: members of families, mesh files by a pattern, and
each of the stable poses of any."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from sweeps.output import init_warp, quiet_stdout
from sweeps.spec.errors import KeyPath, Problems, choose, short
from sweeps.spec.named_files import kept_matching
from warpgrasp.objects.catalogue_names import (
    BODY_NAMES,
    FAMILY_NAMES,
    MOST_SEED,
    NAME_LIMIT,
    PUBLIC,
    SETS,
    family_hint,
    member_of_family,
)

MOST_OBJECTS = 1000
"""Of one entry."""
_FAMILY = {"family", "set", "first", "count"}
_NAMED = {"object", "name"}
_MESHES = {"meshes", "units"}
EACH = "each"
"""Of an entry's `stable_pose`: every stable pose is an object of its own."""


def expanded(value: Any, path: KeyPath, base_dir: Path, problems: Problems) -> Iterator[Any]:
    """The entry itself, or all that it stands for; what is wrong with it is noted."""
    if not isinstance(value, Mapping) or "stable_pose" not in value:
        yield from _members(value, path, base_dir, problems)
        return
    number = value["stable_pose"]
    if number != EACH and not (type(number) is int and number >= 1):
        problems.add((*path, "stable_pose"), f"is {short(number)}; should be a whole number from "
                     f'1, the likeliest pose, or "{EACH}"')
        return
    named = "name" in value
    for table in _members({k: v for k, v in value.items() if k != "stable_pose"}, path, base_dir,
                          problems):
        count = _pose_count(table, base_dir) if number == EACH else 0
        for k in range(1, count + 1) if count else (number if number != EACH else 1,):
            yield table | {"stable_pose": k} | (
                {"name": pose_name(name, k)} if (name := _name_of(table)) and not (
                    named and not count) else {})


def pose_name(name: str, number: int) -> str:
    """The name of an object in its stable pose of a number."""
    suffix = f"-pose-{number}"
    return name[:NAME_LIMIT - len(suffix)] + suffix


def _name_of(table: Mapping[str, Any]) -> str:
    """The name that an object's table gives it."""
    file = table.get("mesh", table.get("profile", ""))
    return str(table.get("name", table.get("object", Path(str(file)).stem)))


def _pose_count(table: Mapping[str, Any], base_dir: Path) -> int:
    """How many stable poses an object has; none where it cannot be built, which is noted later."""
    from warpgrasp.geometry.body import BodyError
    from warpgrasp.objects.catalogue import body_from_table  # heavy; other entries need none
    from warpgrasp.objects.stable_pose import stable_poses

    init_warp()
    try:
        with quiet_stdout():
            return len(stable_poses(body_from_table(table, base_dir)))
    except BodyError:
        return 0


def _members(value: Any, path: KeyPath, base_dir: Path, problems: Problems) -> Iterator[Any]:
    """As `expanded`, of an entry that names no stable pose."""
    if isinstance(value, str) and member_of_family(value):
        yield member_table(value)
    elif isinstance(value, Mapping) and "object" in value:
        yield from _named(value, path, problems)
    elif isinstance(value, Mapping) and "family" in value:
        yield from _family(value, path, problems)
    elif isinstance(value, Mapping) and "meshes" in value:
        yield from _meshes(value, path, base_dir, problems)
    else:
        yield value


def _named(value: Mapping[str, Any], path: KeyPath, problems: Problems) -> Iterator[Any]:
    if _note_unknown(value, _NAMED, path, problems):
        return
    what = value["object"]
    own = {"name": value["name"]} if "name" in value else {}
    if isinstance(what, str) and member_of_family(what):
        yield member_table(what) | own
    elif isinstance(what, str) and what in BODY_NAMES:
        yield {"object": what, "name": what} | own
    else:
        hint = family_hint(what) if isinstance(what, str) else ""
        problems.add((*path, "object"), f"no object {short(what)}; {hint}"
                     f"{choose(what, BODY_NAMES)}")


def member_table(name: str) -> dict[str, Any]:
    """The table of a member of a family, such as "mug-17"."""
    # Its random numbers need Warp, which a spec without families does not.
    from warpgrasp.objects.families import family_table

    return family_table(name) or {}


def _family(value: Mapping[str, Any], path: KeyPath, problems: Problems) -> Iterator[Any]:
    if _note_unknown(value, _FAMILY, path, problems):
        return
    family, half = value["family"], value.get("set", "public")
    if not isinstance(family, str) or family not in FAMILY_NAMES:
        problems.add((*path, "family"), f"is {short(family)}; {choose(family, FAMILY_NAMES)}")
        return
    if not isinstance(half, str) or half not in SETS:
        problems.add((*path, "set"), f"is {short(half)}; {choose(half, SETS)}")
        return
    room = PUBLIC if half == "public" else MOST_SEED + 1 - SETS[half]
    first, count = value.get("first", 0), value.get("count", 8)
    for key, number, low in (("first", first, 0), ("count", count, 1)):
        if type(number) is not int or not low <= number <= room:
            problems.add((*path, key), f"is {short(number)}; should be a whole number from {low} "
                         f"to {room}")
            return
    if first + count > room:
        problems.add((*path, "count"), f"is {count}; from {first} on there are {room - first}")
        return
    for seed in range(SETS[half] + first, SETS[half] + first + count):
        yield member_table(f"{family}-{seed}")


def _meshes(value: Mapping[str, Any], path: KeyPath, base_dir: Path,
            problems: Problems) -> Iterator[Any]:
    if _note_unknown(value, _MESHES, path, problems):
        return
    pattern = value["meshes"]
    if not isinstance(pattern, str) or not pattern:
        problems.add((*path, "meshes"), f"is {short(pattern)}; should be files by a pattern such "
                     'as "scans/*.ply"')
        return
    whole = Path(pattern)
    root = Path(whole.anchor) if whole.is_absolute() else base_dir
    try:
        # Beside the spec that a study keeps lie copies of other files, too.
        files = kept_matching(pattern, base_dir) or sorted(
            f for f in root.glob(str(whole.relative_to(whole.anchor)))
            if f.is_file() and not f.name.startswith("."))
    except (ValueError, OSError, NotImplementedError) as error:
        problems.add((*path, "meshes"), f"is {short(pattern)}; is no pattern of files: {error}")
        return
    if not files:
        problems.add((*path, "meshes"), f"no file matches {short(pattern)}; relative to the spec "
                     f"that is {short(str(root / pattern), 200)}")
    elif len(files) > MOST_OBJECTS:
        problems.add((*path, "meshes"), f"{len(files)} files match; at most {MOST_OBJECTS}")
    else:
        units = {"units": value["units"]} if "units" in value else {}
        yield from ({"mesh": str(file), "name": file.stem[:NAME_LIMIT], **units}
                    for file in files)


def _note_unknown(value: Mapping[str, Any], known: set[str], path: KeyPath,
                  problems: Problems) -> bool:
    """Notes keys that are not known; whether there are any."""
    unknown = [key for key in value if key not in known]
    for key in unknown:
        problems.add((*path, key), f"unknown key; {choose(key, sorted(known))}")
    return bool(unknown)
