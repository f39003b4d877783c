"""What a sweep can tell apart: against sweeps drawn with a known difference."""

from pathlib import Path

import numpy as np
import pytest
from fake_episodes import cell_by_cell, rows_of
from scipy.stats import f_oneway
from studies import SMALL, fill, plan_of, write_spec

from sweeps.analysis.interval import ObjectMeans
from sweeps.cli import main as cli
from sweeps.race.power import Spreads, pilot_spreads, told_apart
from sweeps.run.unit_file import Columns
from sweeps.spec.cell import Cell


@pytest.mark.parametrize(("over", "between", "entries", "episodes"), [
    ("these", 0.0, 2, 16), ("like-these", 1.5, 2, 16), ("these", 0.0, 8, 16),
    ("like-these", 1.5, 8, 16), ("these", 0.0, 2, 2), ("these", 0.0, 8, 3)])
def test_the_difference_told_is_shown_by_four_sweeps_in_five(over: str, between: float,
                                                             entries: int, episodes: int) -> None:
    """Leaderboards with that difference between two of their entries, drawn 400 times."""
    objects, own = 6, 3.0
    spreads = Spreads(np.full((1, objects), own**2), np.full(1, between**2), 8)
    apart = told_apart(spreads, entries, objects, episodes)[0 if over == "these" else 1]
    rng, shown = np.random.default_rng(1), 0
    for _ in range(400):
        board = ObjectMeans(entries, 0)
        for _ in range(objects):
            means = 5.0 + rng.normal(0.0, between, entries) / np.sqrt(2.0)
            values = means + rng.normal(0.0, own, (episodes, entries)) / np.sqrt(2.0)
            board.add(values + apart * (np.arange(entries) == 1))
        found = board.differences(0, over)
        shown += found.low[1] > 0
    assert shown / 400 == pytest.approx(0.8, abs=0.06)


def test_one_episode_of_each_object_tells_nothing_of_these_objects() -> None:
    spreads = Spreads(np.ones((1, 6)), np.ones(1), 8)
    these, like = told_apart(spreads, 2, 6, 1)
    assert np.isnan(these)
    assert np.isfinite(like)


def test_outcomes_that_all_agree_in_a_pilot_do_not_tell_the_least_difference() -> None:
    """The difference was 0. One entry is always right, as both were there, and the other misses
    that often."""
    objects, episodes = 6, 8
    spreads = Spreads(np.zeros((1, objects)), np.zeros(1), 2, chances=True)
    apart, like = told_apart(spreads, 2, objects, episodes)
    assert 0.0 < like < 1.0
    rng, shown = np.random.default_rng(1), 0
    for _ in range(400):
        board = ObjectMeans(2, 0, chances=True)
        for _ in range(objects):
            board.add((rng.random((episodes, 2)) >= [0.0, apart]).astype(float))
        shown += board.differences(0, "these").high[1] < 0
    assert 0.75 < shown / 400 < 0.95
    assert not np.isfinite(told_apart(spreads, 8, 2, 2)).any()  # more than any shares differ by


def test_an_object_without_scores_tells_nothing(tmp_path: Path) -> None:
    """The spread is of the others; it was printed as nan."""
    def without_block(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
        rows = rows_of(cell, episodes, device)
        lost = cell.object_name == "block"
        return rows | {"chamfer_mm": np.where(lost, np.nan, rows["chamfer_mm"])}

    plan = plan_of(tmp_path / "spec", SMALL.replace("= 70\no", "= 6\no"))
    objects = len(plan.study.objects)
    fill(tmp_path / "whole", plan)
    fill(tmp_path / "pilot", plan, cell_by_cell(without_block))
    whole, found = (pilot_spreads(tmp_path / name, "chamfer_mm") for name in ("whole", "pilot"))
    assert found.within.shape[1] == objects - 1 == whole.within.shape[1] - 1
    assert np.isin(found.within, whole.within).all()


def test_spreads_of_a_pilot_are_the_components_of_its_variance(tmp_path: Path) -> None:
    """The variance between groups of equal size over that within is F of a one-way analysis."""
    plan, episodes = plan_of(tmp_path / "spec", SMALL.replace("= 70\no", "= 6\no")), 6
    drawn = np.random.default_rng(2).normal(0.0, 1.0, (2, episodes)) + [[0.0], [3.0]]

    def apart(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
        number = [body.name for body in plan.study.objects].index(cell.object_name)
        lead = drawn[number, episodes] * (cell.strategy.name == "mine")
        return rows_of(cell, episodes, device) | {"chamfer_mm": 20.0 + lead}

    fill(tmp_path / "pilot", plan, cell_by_cell(apart))
    found = pilot_spreads(tmp_path / "pilot", "chamfer_mm")
    within = drawn.var(axis=1, ddof=1)
    assert found.within[0] == pytest.approx(within)
    assert found.between[0] == pytest.approx(
        within.mean() * (f_oneway(*drawn).statistic - 1.0) / episodes)


def test_check_reads_a_pilot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = plan_of(tmp_path / "spec", SMALL.replace("= 70\no", "= 6\no"))
    fill(tmp_path / "pilot", plan)
    spec = write_spec(tmp_path)
    assert cli.run(["check", str(spec), "--pilot", str(tmp_path / "pilot")]) == 0
    told = capsys.readouterr().out.splitlines()[-1]
    assert told.startswith("tells_apart")
    assert told.endswith("differences of chamfer_mm that 80 % of such sweeps show "
                         "(from 6 episodes)")
    timed = ["check", str(spec), "--pilot", str(tmp_path / "pilot"), "--metric", "robot_time_s"]
    assert cli.run(timed) == 0
    assert " s on these objects, " in capsys.readouterr().out
    changed = SMALL.replace('"wedge"]', '"funnel"]').replace('"ring6"', '"ring18"')
    other = write_spec(tmp_path, changed)
    assert cli.run(["check", str(other), "--pilot", str(tmp_path / "pilot")]) == 0
    assert capsys.readouterr().out.rstrip().endswith(
        "(from 6 episodes of a pilot without strategies ring18 and objects funnel)")
    assert cli.run(["check", str(spec), "--pilot", str(tmp_path)]) == 2
    assert "holds no study" in capsys.readouterr().err
    alone = plan_of(tmp_path / "one", SMALL.partition('[[strategy]]\nname = "mine"')[0])
    fill(tmp_path / "lone", alone)
    assert cli.run(["check", str(spec), "--pilot", str(tmp_path / "lone")]) == 2
    assert "should hold two entries or more" in capsys.readouterr().err
