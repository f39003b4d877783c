"""Errors of specs and studies. All problems of a spec are reported at once, each with its line."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from warpgrasp.objects.catalogue_names import NAME_LIMIT

KeyPath = tuple[str | int, ...]
LISTED = 24  # names listed in full; longer lists are cut
MOST_PROBLEMS = 50  # printed of a spec


@dataclass(frozen=True)
class Problem:
    """One problem: `file:line`, the dotted key, and the message."""

    where: str
    key: str
    what: str

    def __str__(self) -> str:
        return ": ".join(part for part in (self.where, self.key, self.what) if part)


class SpecError(ValueError):
    """A spec that cannot be used; `problems` holds every reason."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        hidden = len(self.problems) - MOST_PROBLEMS
        super().__init__("\n".join([
            *map(str, self.problems[:MOST_PROBLEMS]),
            *([f"... and {hidden} more problems"] if hidden > 0 else [])]))


class Problems:
    """Collects problems while a file is checked; `lines` maps the path of a key to its line."""

    def __init__(self, file: str, lines: dict[KeyPath, int]) -> None:
        self.file = file
        self.lines = lines
        self.found: list[Problem] = []
        self.overrides: frozenset[KeyPath] = frozenset()
        """Where values of `--set` would stand in the file."""

    def at_swept(self, key: str) -> KeyPath:
        """Where to note what is wrong with the values of a key of a sweep."""
        place: KeyPath = ("sweep", "grid", key)
        return place if place in self.overrides else ("sweep",)

    def add(self, path: KeyPath, what: str) -> None:
        """Notes a problem at `path`, or at the nearest enclosing key that has a line; of a value of
        `--set` there."""
        if given := next((place for place in self.overrides if path[:len(place)] == place), None):
            self.found.append(Problem("--set", f"{given[-1]}{dotted(path[len(given):])}", what))
            return
        line = next((self.lines[path[:n]] for n in range(len(path), -1, -1)
                     if path[:n] in self.lines), 1)
        self.found.append(Problem(f"{self.file}:{line}", dotted(path), what))


Reader = Callable[[Any, KeyPath, Problems], Any]
"""Reads the value of a key, and notes what is wrong with it."""


def is_refused(reader: Reader, value: Any) -> bool:
    """Whether a reader finds something wrong with a value."""
    trial = Problems("", {})
    reader(value, (), trial)
    return bool(trial.found)


def dotted(path: KeyPath) -> str:
    """A path as text, such as `strategy[1].waypoints.count`; unusual keys are quoted."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            plain = part.replace("_", "a").replace("-", "a").isalnum()
            text += ("." if text else "") + (part if plain else short(part))
    return text


def short(value: object, limit: int = 60) -> str:
    """The `repr` of a value, cut to `limit` characters."""
    try:
        text = repr(value)
    except ValueError:  # an integer of too many digits to print
        text = "a huge number"
    return text if len(text) <= limit else text[:limit - 3] + "..."


def choose(name: object, valid: Iterable[str]) -> str:
    """The end of a message about an unknown name: the nearest valid ones and the whole list."""
    names = list(valid)
    near = get_close_matches(name[:80], names, n=1, cutoff=0.6) if isinstance(name, str) else []
    guess = f"did you mean {near[0]}? " if near else ""
    more = f", ... ({len(names)} in all)" if len(names) > LISTED else ""
    return f"{guess}there are: {', '.join(names[:LISTED])}{more}"


def check_name(name: Any, path: KeyPath, problems: Problems) -> str | None:
    """A name that can stand in a table and a CSV: short, printable, on one line."""
    if isinstance(name, str) and 0 < len(name) <= NAME_LIMIT and name.isprintable() and (
            name == name.strip()):
        return name
    what = "missing" if name is None else f"is {short(name)}"
    problems.add(path, f"{what}; should be a name of 1 to {NAME_LIMIT} printable characters")
    return None


class OtherStudy(ValueError):
    """The directory belongs to another spec; `lines` say where the two differ."""

    def __init__(self, folder: Path, lines: list[str],
                 advice: str = "choose another directory, or undo:") -> None:
        self.lines = lines
        shown = [f"  {line}" for line in lines[:20]]
        more = [f"  ... {len(lines) - 20} more"] if len(lines) > 20 else []
        super().__init__("\n".join([
            f"{folder}: belongs to another spec; {advice}",
            *shown, *more]))


class StoreError(ValueError):
    """A directory that cannot be used; the message says why."""

    def __init__(self, message: str, exit_code: int = 2) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class Held(StoreError):
    """Another run holds the directory."""
