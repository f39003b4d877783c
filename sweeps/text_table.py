"""Tables on stdout: aligned text for people, JSON for programs."""

import csv
import io
import json
import math
import os
import re
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from warpgrasp.core.plain_text import csv_cell, on_one_line

WIDEST = 100_000
"""Columns of a printed table: a terminal may wrap it, but no cell is cut."""
MISSING = ("", "NA")
"""Cells of what is not known, or not there."""
WORDS = frozenset({"strategy", "object", "other", "recognized_as", "dominated_by", "best", "study",
                   "hash", "hand", "arm", "thumb", "closings", "senses", "source", "what", "unit",
                   "note"})
"""Columns of names and sentences: an object may be called 12, or NA."""
_NUMBER = re.compile(r"-?(0|[1-9]\d*)(\.\d+)?([eE][+-]?\d+)?", re.ASCII)


@dataclass(frozen=True)
class TextTable:
    """Rows of text under a header, and what a reader should know about them."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()

    def csv(self) -> bytes:
        """The bytes of a CSV file."""
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(self.header)
        writer.writerows([csv_cell(cell) for cell in row] for row in self.rows)
        return stream.getvalue().encode()

    def records(self) -> list[dict[str, Any]]:
        """The rows for JSON, see `json_record`."""
        return [json_record(dict(zip(self.header, row, strict=True))) for row in self.rows]


def number_text(value: float, digits: int) -> str:
    """A number with fixed digits; NA for what is not one, no minus before zero."""
    if not math.isfinite(value):
        return "NA"
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def json_record(cells: Mapping[str, str], words: Collection[str] = ()) -> dict[str, Any]:
    """Cells by the names of their columns, for JSON: numbers as such, None for what is not there.

    Text remains what stands in one of `WORDS`, or of `words`, and what is no number.
    """
    return {name: _json_cell(text, name in WORDS or name in words) for name, text in cells.items()}


def _json_cell(text: str, is_word: bool) -> str | int | float | None:
    if is_word:
        return text or None
    if text in MISSING:
        return None
    found = _NUMBER.fullmatch(text)
    if not found:
        return text
    number = float(text) if found[2] or found[3] else int(text)
    return number if math.isfinite(number) else text


def finite_or_none(value: float) -> float | None:
    """A number that JSON has, or None."""
    return value if math.isfinite(value) else None


def six_digits(value: float) -> float | None:
    """As `finite_or_none`, rounded to six digits."""
    return finite_or_none(float(f"{value:.6g}"))


def print_json(content: Any) -> None:
    """Prints a record, or several; infinite numbers and NaN, which JSON lacks, are refused."""
    print(json.dumps(content, indent=1, allow_nan=False))


def print_table(header: Sequence[str], rows: Sequence[Sequence[str]], as_json: bool,
                words: Collection[str] = ()) -> None:
    """Prints rows under a header; colour only on a terminal that wants it.

    As JSON a record a row, see `json_record`; `words` are columns of text beside `WORDS`.
    """
    if as_json:
        print_json([json_record(dict(zip(header, row, strict=True)), words) for row in rows])
        return
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0),
                  header_style="" if os.environ.get("NO_COLOR") else "bold")
    for n, name in enumerate(header):
        numeric = bool(rows) and all(is_number(row[n]) for row in rows)
        table.add_column(Text(name), justify="right" if numeric else "left", no_wrap=True)
    for row in rows:
        table.add_row(*(Text(on_one_line(cell)) for cell in row))
    console = Console(file=sys.stdout, width=WIDEST)
    with console.capture() as printed:
        console.print(table)
    print("\n".join(line.rstrip() for line in printed.get().splitlines()))


def is_number(text: str) -> bool:
    """Whether a cell of a table is a number, or stands for one that is not known."""
    try:
        float(text)
    except ValueError:
        return text in MISSING
    return True
