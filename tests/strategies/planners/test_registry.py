"""Planners are found by name."""

import subprocess
import sys

from places import ROOT


def test_every_ready_made_planner_is_found_in_a_fresh_process() -> None:
    """In one that has run other tests, modules that register planners are there already."""
    code = ("from strategies.planners.registry import find_planner\n"
            "from strategies.ready_made import STRATEGIES\n"
            "for strategy in STRATEGIES.values():\n"
            "    strategy.call and find_planner(strategy.call)\n")
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)
