"""Tables on stdout: aligned text for people, JSON for programs."""

import csv
import io
import json
import math
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from warpgrasp.core.plain_text import csv_cell, on_one_line

WIDEST = 100_000
"""Columns of a printed table: a terminal may wrap it, but no cell is cut."""


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
        return text in ("", "NA")
    return True
