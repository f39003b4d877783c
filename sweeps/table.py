"""Tables on stdout: aligned text for people, JSON for programs."""

import json
import os
import sys
from collections.abc import Sequence


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
