"""An episode alone has the columns, bit for bit, that it has beside others."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from strategies.catalogue import STRATEGIES
from strategies.strategy import Strategy
from strategies.waypoints import Ring
from sweeps.cell import Cell
from sweeps.episodes import run_cells, run_episodes

THEIRS = Path(__file__).parents[1] / "strategies" / "theirs.py"


def same(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray], row: int) -> None:
    """The only row of `one` is row `row` of `other`."""
    for name, values in one.items():
        np.testing.assert_array_equal(values[0], other[name][row], name)


def cell(strategy: Strategy, name: str) -> Cell:
    return Cell(strategy, {"name": name}, name, seed=3)


def test_a_neighbours_face_bars_no_end_from_being_crossed() -> None:
    strategy = Strategy("s", (Ring(count=2),), order=("containment", *["decide"] * 3))
    block, wedges = cell(strategy, "block"), cell(strategy, "wedge")
    alone, = run_cells([(block, np.array([11]))], "cpu")
    beside, _ = run_cells([(block, np.array([11])), (wedges, np.arange(6))], "cpu")
    same(alone, beside, 0)
    assert "planar" in alone["procedures"][0]


def test_a_budget_is_cut_by_what_each_world_could_make() -> None:
    funnels = cell(replace(STRATEGIES["ring18"], touches=48), "funnel")
    beside = run_episodes(funnels, np.arange(8), "cpu")
    assert beside["touches"].min() >= 48
    assert beside["touches"].max() < 48 + 8
    for episode in (5, 7):
        same(run_episodes(funnels, np.array([episode]), "cpu"), beside, episode)


def test_the_noise_of_a_world_is_its_own() -> None:
    """Worlds that grasp at other steps than their neighbours."""
    mixed = cell(Strategy("s", call=f"{THEIRS}:Mixed"), "block")
    beside = run_episodes(mixed, np.arange(6), "cpu")
    assert set(beside["procedures"]) == {"containment", "planar containment"}
    for episode in range(6):
        same(run_episodes(mixed, np.array([episode]), "cpu"), beside, episode)
