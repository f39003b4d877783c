"""A TOML file of a user's, read once into a table that says what is wrong with it.

Hands and arms are read by it; what they mean is checked by their own rooms.
"""

import json
import tomllib
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

LARGEST_BYTES = 1 << 20
_MOST_PROBLEMS = 20
Table = TypeVar("Table", bound=BaseModel)


def read_strict(
    file: Path, table: type[Table], error_type: type[ValueError], command: str
) -> Table:
    """The table that a TOML file holds.

    Raises `error_type` with the file, the element, and what would be right; `command` is the one
    that writes such files.
    """
    try:
        with file.open("rb") as stream:
            raw = stream.read(LARGEST_BYTES + 1)
    except OSError as error:
        raise error_type(f"{file}: cannot be read: {error.strerror or error}; should be a TOML "
                         f"file as `{command}` writes it") from None
    if len(raw) > LARGEST_BYTES:
        raise error_type(f"{file}: is larger than {LARGEST_BYTES >> 20} MiB, the most of such a "
                         "file")
    given: Any = None
    try:
        given = tomllib.loads(raw.decode("utf-8-sig"))  # of Windows editors, too
        # As JSON, where a strict table takes lists for tuples, but no text or boolean for a number.
        return table.model_validate_json(json.dumps(given, default=str), strict=True)
    except ValidationError as error:
        raise error_type("\n".join(
            f"{file}: {place_of_element(e['loc'], given)}: {e['msg'][:1].lower()}{e['msg'][1:]}"
            f"{_meant(table, e['loc']) if e['type'] == 'extra_forbidden' else ''}"
            for e in error.errors()[:_MOST_PROBLEMS])) from None
    except (ValueError, RecursionError) as error:
        raise error_type(f"{file}: is not valid TOML: {str(error)[:200]}") from None


def place_of_element(place: Sequence[str | int], given: Any) -> str:
    """Where an element stands in what was given, by the names that it has there: `finger index:
    joint joint_3: axis[0]`, or by number where it has none: `palm[2].box_mm`."""
    text = ""
    for part in place:
        given = _inside(given, part)
        name = given.get("name") if isinstance(given, dict) else None
        if isinstance(part, str):
            text += f"{'' if not text or text.endswith(': ') else '.'}{part}"
        elif isinstance(name, str) and name.isprintable():
            text += f" {name}: "
        else:
            text += f"[{part}]"
    return text.removesuffix(": ") or "the file"


def _inside(given: Any, part: str | int) -> Any:
    try:
        return given[part]
    except (KeyError, IndexError, TypeError):  # what is missing
        return None


def _meant(table: type[BaseModel], place: Sequence[str | int]) -> str:
    """The key that may be meant by one that there is not."""
    for part in place[:-1]:
        if part in table.model_fields:  # neither a number in a list nor a name of the user's
            table = _table_in(table.model_fields[str(part)].annotation) or table
    near = get_close_matches(str(place[-1]), table.model_fields, n=1)
    return f"; did you mean {near[0]}?" if near else ""


def _table_in(annotation: Any) -> type[BaseModel] | None:
    """The table that an annotation has in it, as in `list[Table]`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(_table_in, get_args(annotation))), None)
