"""Files that a command is asked to write: never over what a study consists of.

A study's directory is recognized by its `resolved.json`, or by `units/` beside `logs/`.
"""

import errno
import os
import time
from pathlib import Path

from sweeps.output import write_atomic
from sweeps.spec.errors import StoreError

RESULTS = ("leaderboard.csv", "race.csv", "race.svg", "search.csv", "sensitivity.csv",
           "sensitivity.md")
"""What the command that works on a study writes there at its end."""
OWN_FILES = ("spec.toml", "resolved.json", "environment.json", "sensitivity.toml", *RESULTS)
OWN_FOLDERS = ("units", "contacts", "logs", "inputs")
OTHER_FORMATS = (".json", ".parquet", ".xlsx", ".html", ".md", ".svg", ".png", ".pdf")
"""Endings of files that would not be read as CSV."""
_MOMENT_S = 0.2
_DENIED = os.strerror(errno.EACCES)


def is_study(folder: Path) -> bool:
    """Whether a directory holds a study, or what is left of one."""
    return (folder / "resolved.json").exists() or (
        (folder / "units").is_dir() and (folder / "logs").is_dir())


def other_files(folder: Path) -> list[str]:
    """Names of what is in a directory that holds no study, but what one begins with. Raises
    OSError."""
    found = _strangers(folder)
    if found and set(found) <= {"logs", "units"}:
        time.sleep(_MOMENT_S)  # a run that begins beside makes one after the other
        found = _strangers(folder)
    return found


def _strangers(folder: Path) -> list[str]:
    if not folder.exists():
        return []
    found = sorted(file.name for file in folder.iterdir()
                   if not file.name.startswith(".lock-") and file.name != "sensitivity.toml")
    return [] if is_study(folder) else found  # asked last: one may just have begun


def study_of_file(path: Path, own: str = "") -> Path | None:
    """The directory of the study that a file belongs to by its place and name; None of others, and
    of `own`, a result in the study's directory that the command may write anew."""
    path = Path(os.path.realpath(path))  # what a link stands for would be written over
    place = path.parent
    if is_study(place) and path.name != own and (
            path.name in OWN_FILES or path.name.startswith(".lock-")):
        return place
    return _study_around(place)


def _study_around(place: Path) -> Path | None:
    """The study of which a folder is one of its own, or lies in one."""
    return next((above.parent for above in (place, *place.parents)
                 if above.name in OWN_FOLDERS and is_study(above.parent)), None)


def why_unwritable(path: Path, own: str = "") -> str:
    """Why a result cannot be written there, as far as that is known beforehand; else empty. `own`
    is as for `study_of_file`."""
    if (study := study_of_file(path, own)) is not None:
        return f"{path}: belongs to the study in {study}; choose another name or folder"
    if not path.parent.is_dir():
        return f"{path}: cannot be written: there is no folder {path.parent}"
    if path.is_dir():
        return f"{path}: cannot be written: it is a folder"
    if path.exists() and not path.is_file():  # a pipe or a device, written to itself
        return "" if os.access(path, os.W_OK) else f"{path}: cannot be written: {_DENIED}"
    path = Path(os.path.realpath(path))
    probe = path.with_name(f".{path.name}.{os.urandom(6).hex()}.tmp")
    try:  # a disk may be read-only, a name too long
        probe.touch(exist_ok=False)
        probe.unlink()
    except OSError as error:
        return f"{path}: cannot be written: {error.strerror}"
    return ""


def check_result(path: Path | None, own: str = "") -> None:
    """Raises StoreError for a file that cannot be written, see `why_unwritable`; None is none."""
    if path is not None and (why := why_unwritable(path, own)):
        raise StoreError(why)


def check_table(path: Path | None, own: str = "") -> None:
    """`check_result` of a table, which is CSV: the name of a file may not say otherwise."""
    check_result(path, own)
    if path is not None and path.suffix.lower() in OTHER_FORMATS:
        raise StoreError(f"{path}: would be CSV; should end in .csv (--json prints JSON)")


def write_result(path: Path, content: bytes, own: str = "") -> None:
    """Writes a file as a whole or not at all. Raises StoreError that names it."""
    check_result(path, own)
    try:
        write_atomic(path, content)
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {error.strerror or error}") from None


def make_folder(folder: Path) -> None:
    """Makes a directory for the files of a command, unless it is there.

    Raises StoreError where it cannot be made, and for a study's: files of another command would lie
    among its own.
    """
    place = Path(os.path.realpath(folder))
    if (study := place if is_study(place) else _study_around(place)) is not None:
        raise StoreError(f"{folder}: belongs to the study in {study}; choose a directory of its "
                         "own")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"{folder}: cannot be written: {error.strerror or error}") from None
