"""Tables on stdout: aligned text for people, JSON for programs."""

import csv
import io
import json
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass


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
        writer.writerows(self.rows)
        return stream.getvalue().encode()


def number_text(value: float, digits: int) -> str:
    """A number with fixed digits; NA for what is not one, no minus before zero."""
    if not math.isfinite(value):
        return "NA"
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if float(text) == 0 else text


def print_table(header: Sequence[str], rows: Sequence[Sequence[str]], as_json: bool) -> None:
    """Prints rows under a header; colour only on a terminal that wants it."""
    if as_json:
        print(json.dumps([dict(zip(header, row, strict=True)) for row in rows], indent=1))
        return
    widths = [max(len(cell) for cell in column) for column in zip(header, *rows, strict=True)]
    numeric = [bool(rows) and all(_is_number(row[n]) for row in rows) for n in range(len(header))]

    def line(cells: Sequence[str]) -> str:
        placed = (cell.rjust(width) if right else cell.ljust(width)
                  for cell, width, right in zip(cells, widths, numeric, strict=True))
        return "  ".join(placed).rstrip()

    bold = sys.stdout.isatty() and not os.environ.get("NO_COLOR")
    print(f"\033[1m{line(header)}\033[0m" if bold else line(header))
    for row in rows:
        print(line(row))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return text == "NA"
    return True
