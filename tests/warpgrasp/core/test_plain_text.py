"""Text of users in terminals and spreadsheets."""

import csv
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from warpgrasp.core.plain_text import csv_cell, on_one_line, printable


@given(st.text())
def test_nothing_of_a_text_steers_a_terminal(text: str) -> None:
    shown = on_one_line(text)
    assert shown.isprintable() or not any(ord(c) < 32 or c in "\u202e\u200f\u2028" for c in shown)
    assert len(shown.splitlines()) <= 1


def test_escapes_are_shown_and_other_text_stays() -> None:
    assert printable("a \x1b[31mred\u202eeman\r\n") == "a \\x1b[31mred\\u202eeman\\r\n"
    assert printable("größer 80 mm, 日本\n  indented") == "größer 80 mm, 日本\n  indented"


@pytest.mark.parametrize("cell", ["=1+1", "+A1", "@SUM(A1)", "-mine", "=cmd|' /C calc'!A0"])
def test_no_cell_begins_a_formula(cell: str) -> None:
    text = io.StringIO()
    csv.writer(text).writerow([csv_cell(cell)])
    assert next(csv.reader(io.StringIO(text.getvalue())))[0] == f"'{cell}"


@pytest.mark.parametrize("cell", ["-1.5", "+3", "-0.00", "ring6", "", "NA", "-1e-9", "a=b"])
def test_numbers_and_usual_names_stay(cell: str) -> None:
    assert csv_cell(cell) == cell
