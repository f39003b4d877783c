"""What is wrong with a spec: all problems at once, each with its place and what would be right."""

from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Any

from warpgrasp.body_names import NAME_LIMIT

Path = tuple[str | int, ...]
LISTED = 24  # names listed in full; longer lists are cut


@dataclass(frozen=True)
class Problem:
    """One thing wrong: `file:line`, the dotted key, and the sentence that says what."""

    where: str
    key: str
    what: str

    def __str__(self) -> str:
        return ": ".join(part for part in (self.where, self.key, self.what) if part)


class SpecError(ValueError):
    """A spec that cannot be used; `problems` holds every reason."""

    def __init__(self, problems: Iterable[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in self.problems))


class Problems:
    """Collects problems while a file is checked; `lines` maps the path of a key to its line."""

    def __init__(self, file: str, lines: dict[Path, int]) -> None:
        self.file = file
        self.lines = lines
        self.found: list[Problem] = []

    def add(self, path: Path, what: str) -> None:
        """Notes a problem at `path`, or at the nearest enclosing key that has a line."""
        line = next((self.lines[path[:n]] for n in range(len(path), -1, -1)
                     if path[:n] in self.lines), 1)
        self.found.append(Problem(f"{self.file}:{line}", dotted(path), what))

    def raise_if_any(self) -> None:
        """Raises all that was found as one `SpecError`, in the order of the file."""
        if self.found:
            raise SpecError(sorted(self.found, key=lambda p: int(p.where.rpartition(":")[2])))


def dotted(path: Path) -> str:
    """A path as one reads it: `strategy[1].waypoints.count`; odd keys in quotes."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            plain = part.replace("_", "a").replace("-", "a").isalnum()
            text += ("." if text else "") + (part if plain else short(part))
    return text


def short(value: object, limit: int = 60) -> str:
    """A value as a message shows it, cut to a bearable length."""
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


def check_name(name: Any, path: Path, problems: Problems) -> str | None:
    """A name that can stand in a table and a CSV: short, printable, on one line."""
    if isinstance(name, str) and 0 < len(name) <= NAME_LIMIT and name.isprintable() and (
            name == name.strip()):
        return name
    what = "missing" if name is None else f"is {short(name)}"
    problems.add(path, f"{what}; should be a name of 1 to {NAME_LIMIT} printable characters")
    return None
