"""What a table printed as JSON should hold, told from its CSV."""

import csv
from pathlib import Path
from typing import Any

NAMES = {"strategy", "object", "other", "recognized_as", "dominated_by"}
"""Columns that remain text whatever stands in them."""


def csv_rows(file: Path) -> list[dict[str, str]]:
    return list(csv.DictReader(file.read_text().splitlines()))


def assert_same_cells(rows: list[dict[str, str]], records: list[dict[str, Any]]) -> None:
    """Each number of a CSV is a number of the JSON, each gap a null, other text the same."""
    assert len(rows) == len(records) > 0
    for row, record in zip(rows, records, strict=True):
        assert list(row) == list(record)
        for name, text in row.items():
            found = record[name]
            if name in NAMES:
                assert found == (text or None), name
            elif text in ("", "NA"):
                assert found is None, name
            else:
                assert_number(name, text, found)


def assert_number(name: str, text: str, found: Any) -> None:
    try:
        number = float(text)
    except ValueError:
        assert found == text, name
        return
    assert type(found) in (int, float), f"{name}: {found!r}"
    assert found == number, name
