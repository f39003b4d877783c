"""Planners are found by name."""

import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT

from strategies.planners.planner_file import PlannerError
from strategies.planners.registry import find_planner
from strategies.ready_made import run_together


def test_every_ready_made_planner_is_found_in_a_fresh_process() -> None:
    """In one that has run other tests, modules that register planners are there already."""
    code = ("from strategies.planners.registry import find_planner\n"
            "from strategies.ready_made import STRATEGIES\n"
            "for strategy in STRATEGIES.values():\n"
            "    strategy.call and find_planner(strategy.call)\n")
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


@pytest.mark.parametrize(("call", "models_alone", "with_free_forms"), [
    ("", True, True),  # an order given in advance
    ("even", True, True), ("oracle", True, True),
    ("gaussian-process", True, False),  # which searches by free forms where they may stand
    ("any-object", False, False), ("mine.py:Planner", False, False), ("unheard-of", False, False)])
def test_units_run_together_where_their_planner_lets_them(
        call: str, models_alone: bool, with_free_forms: bool) -> None:
    assert run_together(call, False) == models_alone
    assert run_together(call, True) == with_free_forms


NAMED = """from strategies.planners.register import planner


@planner("{name}")
def mine(belief):
    return []
"""


def test_a_planner_of_a_file_is_known_there_alone(tmp_path: Path) -> None:
    """Its name was known too where the file had been run before: when a spec is checked, but not
    where the strategy of that name is run."""
    file = tmp_path / "mine.py"
    file.write_text(NAMED.format(name="of-a-file"))
    assert find_planner(f"{file}:mine")(None) == []
    with pytest.raises(PlannerError, match="no strategy 'of-a-file'"):
        find_planner("of-a-file")


def test_no_planner_takes_the_place_of_one_that_ships(tmp_path: Path) -> None:
    before = find_planner("coverage")
    file = tmp_path / "mine.py"
    file.write_text(NAMED.format(name="coverage"))
    with pytest.raises(PlannerError, match=r"mine\.py:4: ValueError: planner 'coverage': a strat"):
        find_planner(f"{file}:mine")
    assert find_planner("coverage") is before


def test_a_decorator_without_a_name_is_told_with_the_line(tmp_path: Path) -> None:
    """What was registered answered with the belief itself, in every episode."""
    file = tmp_path / "mine.py"
    for decorator in ("@planner", "@planner(3)", '@planner("")'):
        file.write_text("from strategies.planners.register import planner\n"
                        f"{decorator}\ndef f(belief):\n    return []\n")
        with pytest.raises(PlannerError, match=r"mine\.py:[23]: TypeError: planner: its name is "
                           r".*; should be a text, as in @planner\(\"mine\""):
            find_planner(f"{file}:f")
