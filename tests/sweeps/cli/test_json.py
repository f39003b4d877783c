"""`--json` of every command: numbers are numbers, gaps are null, names are text."""

import json
import math
from collections.abc import Iterator
from inspect import signature
from pathlib import Path
from typing import Any

import pytest
from curved_episodes import wide_study, wide_text
from json_rows import NAMES, assert_same_cells, csv_rows
from studies import SMALL, write_spec

from sweeps.analysis import tables
from sweeps.cli import main as cli
from sweeps.cli.app import app
from sweeps.run import worker
from sweeps.text_table import json_record, print_json, print_table

ODD = SMALL.replace('"ring6"', '"12"\nwaypoints = { kind = "ring", count = 4 }').replace(
    '"wedge"', '{ object = "wedge", name = "007" }')
"""A strategy and an object whose names look like numbers."""
SWEPT = """
[sweep.grid]
"sensors.tendon_threshold_N" = [3.0, 6.0]
"""
BESIDE_STUDIES = {"doctor", "objects", "strategies", "hands", "arms", "validate", "sensitivity",
                  "race", "sweep", "check", "status"}
"""Tested below, each with the words that it needs; the others read a study and write a CSV."""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    wide_study(folder, wide_text(2, 3, 8, SWEPT))
    return folder


def told(capsys: pytest.CaptureFixture[str], *words: object) -> Any:
    """What a command prints as JSON, in which NaN and Infinity are no words."""
    capsys.readouterr()
    assert cli.run([*map(str, words), "--json"]) == 0
    printed = capsys.readouterr().out
    return json.loads(printed, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))


def numbers_as_text(content: Any, name: str = "") -> Iterator[str]:
    """Texts that a program would have to read as numbers, but for names."""
    if isinstance(content, dict):
        for key, value in content.items():
            yield from numbers_as_text(value, key)
    elif isinstance(content, list):
        for value in content:
            yield from numbers_as_text(value, name)
    elif isinstance(content, str) and name not in {*NAMES, "value", "hash", "study", "entries"}:
        try:
            float(content or "nan")
        except ValueError:
            return
        yield f"{name}: {content!r}"


def test_every_command_with_json_is_tested_here() -> None:
    made = {name: app[name].default_command for name in app}
    found = {name for name, command in made.items()
             if command is not None and "json" in signature(command).parameters}
    assert found == BESIDE_STUDIES | {"leaderboard", "table", "compare"}


@pytest.mark.parametrize("words", [
    ["leaderboard"], ["leaderboard", "--by", "strategy,object"], ["leaderboard", "--metric", "iou"],
    *(["table", kind, *(["--against", "best"] if kind == "same-time" else [])]
      for kind in tables.KINDS)])
def test_a_table_of_a_study_has_the_numbers_of_its_csv(
        words: list[str], study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = told(capsys, words[0], study, *words[1:], "-o", tmp_path / "t.csv")
    assert_same_cells(csv_rows(tmp_path / "t.csv"), found)
    assert [*numbers_as_text(found)] == []


def test_a_comparison_has_the_numbers_of_its_csv(study: Path, tmp_path: Path,
                                                 capsys: pytest.CaptureFixture[str]) -> None:
    found = told(capsys, "compare", study, study, "-o", tmp_path / "t.csv")
    assert_same_cells(csv_rows(tmp_path / "t.csv"), found["table"])
    assert [*numbers_as_text(found)] == []


def test_names_that_look_like_numbers_remain_names(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:run_episodes")
    spec, out = write_spec(tmp_path, ODD), tmp_path / "out"
    assert {row["strategy"] for row in told(capsys, "sweep", spec, "-o", out)} >= {"12", "mine"}
    rows = told(capsys, "table", out, "objects")
    assert {row["object"] for row in rows} == {"block", "007"}
    assert "12" in {row["strategy"] for row in rows}
    found = told(capsys, "race", spec, "-o", tmp_path / "race", "--within", 1e6)
    assert_same_cells(csv_rows(tmp_path / "race/race.csv"), found["table"])
    assert isinstance(found["chamfer_mm"], float)
    assert isinstance(found["best"], str)
    until = told(capsys, "sweep", spec, "-o", tmp_path / "until", "--until", 1e6)
    assert_same_cells(csv_rows(tmp_path / "until/leaderboard.csv"), until["table"])
    assert isinstance(until["best"], str)
    for content in (found, until, told(capsys, "status", out)):
        assert [*numbers_as_text({**content, "best": "a name"})] == []


def test_a_check_counts_in_numbers(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = write_spec(tmp_path, 'name = "1990"\n' + SMALL + SWEPT)
    found = told(capsys, "check", spec)
    assert [found[name] for name in (
        "study", "strategies", "objects", "settings", "cells", "episodes", "units")] == [
        "1990", 2, 2, 2, 8, 560, 16]
    assert isinstance(found["hash"], str)


@pytest.mark.parametrize(("words", "numbers"), [
    (["objects"], []), (["strategies"], []), (["doctor", "--no-test"], []),
    (["hands"], ["fingers", "joints", "driven"]), (["arms"], ["joints", "length [m]"]),
    (["validate", "--only", "puma"], ["ours", "theirs", "difference", "bound"])])
def test_lists_hold_numbers(words: list[str], numbers: list[str],
                            capsys: pytest.CaptureFixture[str]) -> None:
    if words[0] == "validate":
        pytest.importorskip("roboticstoolbox")
    rows = told(capsys, *words)
    assert [*numbers_as_text([{**row, "unit": "m"} for row in rows])] == []
    for name in numbers:
        assert {type(row[name]) for row in rows} <= {int, float, type(None)}, name
        assert any(row[name] is not None for row in rows), name


def test_versions_are_text(capsys: pytest.CaptureFixture[str]) -> None:
    """One of two parts would be read as a number, and 2.10 as 2.1."""
    assert all(isinstance(row["value"], str) for row in told(capsys, "doctor", "--no-test"))
    print_table(("what", "value"), [("numpy", "2.10")], True, words=("value",))
    assert json.loads(capsys.readouterr().out) == [{"what": "numpy", "value": "2.10"}]


@pytest.mark.parametrize(("text", "value"), [
    ("3", 3), ("-0.50", -0.5), ("0", 0), ("1e-05", 1e-05), ("", None), ("NA", None),
    ("3/6", "3/6"), ("007", "007"), ("1_000", "1_000"), ("nan", "nan"), ("inf", "inf"),
    ("1e999", "1e999"), ("+1", "+1"), (" 1", " 1"), ("٣", "٣"), ("1\n", "1\n")])
def test_only_what_json_calls_a_number_is_one(text: str, value: object) -> None:
    found = json_record({"x": text})["x"]
    assert (found, type(found)) == (value, type(value))


def test_what_json_lacks_is_refused() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        print_json({"within": math.inf})
