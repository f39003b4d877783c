"""Curves and what is read off them, against cases worked by hand."""

from pathlib import Path

import numpy as np
import pytest
from curved_episodes import lists, table_rows, unfinished_study, wide_study, wide_text

from sweeps.analysis.curves import (
    episode_steps,
    grid_of,
    mean_curve,
    on_grid,
    reach,
    reach_table,
    read_curves,
    same_time_table,
)
from sweeps.analysis.entries import LeaderboardError
from sweeps.analysis.paired import Paired
from sweeps.run.plan import Plan
from sweeps.run.store import Store


def test_same_time_without_a_finished_block_is_told(tmp_path: Path) -> None:
    plan, store = unfinished_study(tmp_path, 1, 0)
    with pytest.raises(LeaderboardError, match="no block of episodes is finished"):
        same_time_table(read_curves(plan, [store]), "s")


def test_same_time_passes_over_an_object_that_all_fail_on(tmp_path: Path) -> None:
    """It says nothing of who was ahead; the others still do."""
    plan, store = wide_study(tmp_path, wide_text(2, 3, 8))
    for unit in plan.units():
        if unit.cell.object_name == "block":
            store.path(unit).unlink()
            store.log(unit).write_text("it broke")
    (row,) = table_rows(same_time_table(read_curves(plan, [store]), "s"))
    assert row["wins"].endswith("/2")
    assert float(row["ci_low"]) <= float(row["chamfer_mm_difference"]) <= float(row["ci_high"])


def test_a_step_function_holds_its_last_value() -> None:
    steps = (np.array([2.0, 5.0]), np.array([9.0, 4.0]))
    found = on_grid(steps, np.array([0.0, 2.0, 4.9, 5.0, 99.0]))
    assert np.isnan(found[0])
    assert found[1:].tolist() == [9.0, 9.0, 4.0, 4.0]


def test_rows_without_curves_are_one_step() -> None:
    rows = {"status": np.array(["ok", "bad"], object), "touches": np.array([10, 4]),
            "chamfer_mm": np.array([3.0, np.nan])}
    first, second = episode_steps(rows, "touches")
    assert (first[0].tolist(), first[1].tolist()) == ([10.0], [3.0])
    assert np.isnan(second[1]).all()
    rows["curve_touches"] = lists([[5, 10], []])
    rows["curve_chamfer_mm"] = lists([[6, 3], []])
    first, second = episode_steps(rows, "touches")
    assert first[1].tolist() == [6.0, 3.0]
    assert len(second[0]) == 1


def test_mean_curves_end_at_the_leaderboards_mean(
        study: tuple[Plan, Store], paired: Paired) -> None:
    plan, store = study
    curves = read_curves(plan, [store])
    means = paired.means["chamfer_mm"]
    for axis in ("touches", "time_s"):
        grid = grid_of(curves, axis)
        assert len(grid) <= 50
        found = mean_curve(curves, axis, 1, grid)
        # a failed episode's worst is taken over whole curves: no better than the leaderboard's
        assert found.value[-1] >= means[0, 1] - 1e-9
        known = np.isfinite(found.value)
        assert (found.low[known] <= found.value[known]).all()
        assert (np.diff(found.value[known]) <= 1e-9).all()  # these fakes only get better
        assert np.isnan(found.value[0])


def test_reach_by_hand(study: tuple[Plan, Store]) -> None:
    plan, store = study
    curves = read_curves(plan, [store])
    pooled = []
    for found in curves.steps["touches"]:
        pooled += [next((a for a, e in zip(*steps, strict=True) if e <= 5), np.inf)
                   for steps in found[0]]
    got = reach(curves, "touches", 0, 5.0)
    assert got.share == np.isfinite(pooled).mean()
    assert got.median == np.sort(pooled)[len(pooled) // 2 - 1]  # 16 episodes on each of 6
    assert got.low <= got.median <= got.high
    assert len(reach_table(curves).rows) == 6
    assert {row["within_mm"] for row in table_rows(reach_table(curves))} == {"5", "3"}


def test_errors_at_the_same_time_are_those_when_the_other_ended(
    study: tuple[Plan, Store]
) -> None:
    plan, store = study
    curves = read_curves(plan, [store])
    label = curves.labels[0]
    rows = table_rows(same_time_table(curves, label))
    assert [row["strategy"] for row in rows] == curves.labels[1:]
    for entry, row in enumerate(rows, 1):
        means = []
        for found in curves.steps["time_s"]:
            ends = [steps[0][-1] for steps in found[0]]
            every = np.array([[on_grid(steps, np.array([end]))[0] for steps, end in
                               zip(one, ends, strict=True)] for one in found])
            means.append(np.where(np.isfinite(every), every, np.nanmax(every)).mean(1))
        then = np.mean(means, axis=0)
        assert row["chamfer_mm_then"] == f"{then[entry]:.3f}"
        assert abs(float(row["chamfer_mm_difference"]) - (then[entry] - then[0])) < 2e-3
        assert float(row["ci_low"]) <= float(row["ci_high"])
    with pytest.raises(LeaderboardError, match="there are"):
        same_time_table(curves, "nobody")
