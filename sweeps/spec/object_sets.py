"""Entries of `objects` that stand for several: members of families, mesh files by a pattern."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from sweeps.spec.errors import KeyPath, Problems, choose, short
from warpgrasp.objects.catalogue_names import (
    FAMILY_NAMES,
    MOST_SEED,
    NAME_LIMIT,
    PUBLIC,
    SETS,
    member_of_family,
)

MOST_OBJECTS = 1000
"""Of one entry."""
_FAMILY = {"family", "set", "first", "count"}
_MESHES = {"meshes", "units"}


def expanded(value: Any, path: KeyPath, base_dir: Path, problems: Problems) -> Iterator[Any]:
    """The entry itself, or all that it stands for; what is wrong with it is noted."""
    if isinstance(value, str) and member_of_family(value):
        yield member_table(value)
    elif isinstance(value, Mapping) and "family" in value:
        yield from _family(value, path, problems)
    elif isinstance(value, Mapping) and "meshes" in value:
        yield from _meshes(value, path, base_dir, problems)
    else:
        yield value


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
        files = sorted(f for f in root.glob(str(whole.relative_to(whole.anchor))) if f.is_file())
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
