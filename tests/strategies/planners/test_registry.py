"""Planners are found by name."""

import subprocess
import sys

import pytest
from places import ROOT

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
