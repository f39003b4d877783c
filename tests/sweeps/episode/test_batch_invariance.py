"""An episode alone has the columns, bit for bit, that it has beside others."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from places import HELPERS
from studies import plan_of

from strategies.poses.waypoints import Ring
from strategies.ready_made import PLANNED_TOGETHER, STRATEGIES
from strategies.strategy import Strategy
from sweeps.episode.episodes import run_block, run_cells, run_episodes
from sweeps.run.unit_file import Columns
from sweeps.spec.cell import CONTACTS, Cell, batch_key

THEIRS = HELPERS / "theirs.py"


def same(one: Mapping[str, np.ndarray], other: Mapping[str, np.ndarray], row: int) -> None:
    """The only row of `one` is row `row` of `other`, with its contacts."""
    assert len(one[CONTACTS][0]["status"]) > 0
    for name, values in one.items():
        if name == CONTACTS:
            for column, found in values[0].items():
                np.testing.assert_array_equal(found, other[name][row][column], column)
        else:
            np.testing.assert_array_equal(values[0], other[name][row], name)


def cell(strategy: Strategy, name: str) -> Cell:
    return Cell(strategy, {"name": name}, name, seed=3, keep="contacts")


@pytest.mark.slow
def test_a_neighbours_face_bars_no_end_from_being_crossed() -> None:
    strategy = Strategy("s", (Ring(count=2),), order=("containment", *["decide"] * 3))
    block, wedges = cell(strategy, "block"), cell(strategy, "wedge")
    alone, = run_cells([(block, np.array([11]))], "cpu")
    beside, _ = run_cells([(block, np.array([11])), (wedges, np.arange(6))], "cpu")
    same(alone, beside, 0)
    assert "planar" in alone["procedures"][0]


@pytest.mark.slow
def test_a_budget_is_cut_by_what_each_world_could_make() -> None:
    funnels = cell(replace(STRATEGIES["ring18"], touches=48), "funnel")
    beside = run_episodes(funnels, np.arange(8), "cpu")
    assert beside["touches"].min() >= 48
    assert beside["touches"].max() < 48 + 8
    for episode in (5, 7):
        same(run_episodes(funnels, np.array([episode]), "cpu"), beside, episode)


@pytest.mark.slow
def test_the_noise_of_a_world_is_its_own() -> None:
    """Worlds that grasp at other steps than their neighbours."""
    mixed = cell(Strategy("s", call=f"{THEIRS}:Mixed"), "block")
    beside = run_episodes(mixed, np.arange(6), "cpu")
    assert set(beside["procedures"]) == {"containment", "planar containment"}
    for episode in range(6):
        same(run_episodes(mixed, np.array([episode]), "cpu"), beside, episode)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(PLANNED_TOGETHER))
def test_planners_that_are_called_for_many_keep_worlds_apart(name: str) -> None:
    """Beside worlds of other objects, which end at other steps."""
    strategy = replace(STRATEGIES[name], touches=40, options=(
        (("tried", 2),) if name == "oracle" else ()))
    wedges, bottles = cell(strategy, "wedge"), cell(strategy, "wine_bottle")
    beside, others = run_cells([(wedges, np.arange(3)), (bottles, np.arange(5))], "cpu")
    same(run_episodes(wedges, np.array([1]), "cpu"), beside, 1)
    same(run_episodes(bottles, np.array([4]), "cpu"), others, 4)


@pytest.mark.slow
def test_waypoints_of_neighbours_change_no_row() -> None:
    """Strategies that differ in where their poses stand are run in one call, object by object."""
    low, high = (Strategy(f"tilt{tilt}", (Ring(count=2, tilt_rad=np.radians(tilt)),))
                 for tilt in (40, 60))
    parts = [(cell(strategy, name), np.arange(2)) for strategy in (low, high)
             for name in ("block", "wedge")]
    assert len({repr(batch_key(one)) for one, _ in parts}) == 1
    beside = run_cells(parts, "cpu")
    for (mine, episodes), rows in zip(parts, beside, strict=True):
        assert rows["strategy"].tolist() == [mine.strategy.name] * 2
        assert rows["object"].tolist() == [mine.object_name] * 2
        same(run_cells([(mine, episodes[1:])], "cpu")[0], rows, 1)


def test_what_can_be_run_in_one_call() -> None:
    ring = Strategy("a", (Ring(count=2),))
    key = batch_key(cell(ring, "block"))
    assert batch_key(cell(replace(ring, name="b", waypoints=(Ring(count=2, aim=0.3),)), "wedge")
                     ) == key
    for other in (replace(ring, waypoints=(Ring(count=3),)), replace(ring, refit_every=1),
                  replace(ring, closings=("together",)), replace(ring, noise_stream=1)):
        assert batch_key(cell(other, "block")) != key
    own = Strategy("a", call="ring6")
    assert batch_key(cell(own, "block")) != batch_key(cell(replace(own, name="b"), "block"))


def together(parts: list[Columns]) -> Columns:
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


@pytest.mark.slow
@pytest.mark.parametrize("splits", [(4,), (1, 6), (2, 3, 5)])
def test_rows_do_not_depend_on_the_batch(tmp_path: Path, splits: tuple[int, ...]) -> None:
    cell = next(plan_of(tmp_path).units()).cell
    episodes = np.arange(8)
    whole = run_episodes(cell, episodes, "cpu")
    parts = together([run_episodes(cell, part, "cpu") for part in np.split(episodes, splits)])
    for name, values in whole.items():
        assert values.tolist().__repr__() == parts[name].tolist().__repr__(), name


@pytest.mark.slow
def test_strategies_meet_the_same_objects(tmp_path: Path) -> None:
    """Common random numbers: what is drawn of an object does not depend on the strategy."""
    plan = plan_of(tmp_path)
    first, second = (plan.study.cell(n, 0, 0) for n in range(2))
    blocks = [run_block(cell, np.arange(3), "cpu") for cell in (first, second)]
    assert (blocks[0].truth.body_pose == blocks[1].truth.body_pose).all()
    assert (blocks[0].prior.radius_m == blocks[1].prior.radius_m).all()
