"""A TOML file of a user's, read once into a table that says what is wrong with it.

Hands and arms are read by it; what they mean is checked by their own rooms.
"""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

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
    try:
        return table.model_validate(tomllib.loads(raw.decode()))
    except ValidationError as error:
        raise error_type("\n".join(
            f"{file}: {dotted(e['loc'])}: {e['msg'][:1].lower()}{e['msg'][1:]}"
            for e in error.errors()[:_MOST_PROBLEMS])) from None
    except (ValueError, RecursionError) as error:
        raise error_type(f"{file}: is not valid TOML: {str(error)[:200]}") from None


def dotted(place: Sequence[str | int]) -> str:
    """Where an element stands: `finger[2].joint[0].axis`."""
    text = ""
    for part in place:
        text += f"[{part}]" if isinstance(part, int) else f"{'.' if text else ''}{part}"
    return text or "the file"
