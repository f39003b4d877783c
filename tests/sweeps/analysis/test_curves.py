"""Curves and what is read off them, against cases worked by hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from curved_episodes import (
    lists,
    table_rows,
    unfinished_study,
    wide_study,
    wide_text,
    written,
)
from studies import plan_of

from sweeps.analysis.bootstrap import REPLICATES, object_weights
from sweeps.analysis.curves import (
    Curves,
    _weights,
    curves_table,
    episode_steps,
    grid_of,
    mean_curve,
    on_grid,
    once_notes,
    reach,
    reach_table,
    read_curves,
    same_time_table,
)
from sweeps.analysis.entries import Entry, LeaderboardError
from sweeps.analysis.interval import completed
from sweeps.analysis.leaderboard import make_leaderboard
from sweeps.analysis.paired import Paired
from sweeps.figures.curves import draw_curves
from sweeps.run.plan import Plan, Unit
from sweeps.run.store import Store
from sweeps.run.unit_file import Columns, write_unit


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


def test_same_time_against_the_best(tmp_path: Path) -> None:
    """As of `pairs`; it used to be refused."""
    plan, store = wide_study(tmp_path, wide_text(3, 3, 8))
    curves = read_curves(plan, [store])
    board = make_leaderboard(plan, [store])
    best = board.rows[0][board.header.index("strategy")]
    assert same_time_table(curves, "best") == same_time_table(curves, best)
    with pytest.raises(LeaderboardError, match=r"--against is 'ss'; .* best or an entry's name; "):
        same_time_table(curves, "ss")
    with pytest.raises(LeaderboardError, match="--against is needed; should be best or an entry"):
        same_time_table(curves, None)


def test_who_fits_once_is_told_how_to_get_a_curve(tmp_path: Path) -> None:
    def rows(unit: Unit) -> Columns:
        found: Columns = {"touches": np.array([8, 10] * 4), "robot_time_s": np.full(8, 40.0),
                          "chamfer_mm": np.full(8, 3.0)}
        many = unit.cell.strategy.name == "sx"
        return found | {
            "curve_touches": lists([[4, t] if many else [] for t in found["touches"]]),
            "curve_time_s": lists([[20, 40] if many else []] * 8),
            "curve_chamfer_mm": lists([[9, 3] if many else []] * 8)}

    plan, store = written(tmp_path, 2, rows)
    curves = read_curves(plan, [store])
    table = curves_table(curves)
    assert "s: fitted once, at the end, so that there is no curve; sequences of" in (
        table.notes[-1])
    many = replace(curves, entries=curves.entries[:1] * 40, steps={
        axis: [found[:1] * 40 for found in steps] for axis, steps in curves.steps.items()})
    assert once_notes(many)[0].startswith("s, s, s, s, s and 35 more: fitted once, at the end")
    assert "NA" not in [row["chamfer_mm"] for row in table_rows(table)]
    drawn = draw_curves(curves, "touches").axes[0]
    lines = {line.get_label(): line for line in drawn.get_lines()}
    assert lines["s"].get_xdata() == [9.0]
    assert lines["s"].get_linestyle() == "None"
    assert lines["sx"].get_linestyle() != "None"


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
        grid = grid_of(curves, axis, 1)
        assert len(grid) <= 50
        found = mean_curve(curves, axis, 1, grid)
        # a failed episode's worst is taken over whole curves: no better than the leaderboard's
        assert found.value[-1] >= means[0, 1] - 1e-9
        known = np.isfinite(found.value)
        assert (found.low[known] <= found.value[known]).all()
        assert (np.diff(found.value[known]) <= 1e-9).all()  # these fakes only get better
        assert np.isnan(mean_curve(curves, axis, 1, np.zeros(1)).value[0])


@pytest.mark.parametrize("over", ["like-these", "these"])
def test_intervals_at_the_end_are_the_leaderboards(tmp_path: Path, over: str) -> None:
    """Percentiles of replicates held in 88 to 92 %."""
    def rows(unit: Unit) -> Columns:
        generator = np.random.default_rng(int(unit.id[:8], 16))
        return {"chamfer_mm": np.exp(generator.normal(1.5, 0.7) + generator.normal(0, 0.3, 8)),
                "robot_time_s": np.full(8, 50.0)}

    plan, store = written(tmp_path, 3, rows)
    curves = read_curves(plan, [store], over)
    named = "ci" if over == "like-these" else "these"
    board = {row["strategy"]: row for row in table_rows(make_leaderboard(plan, [store]))}
    last = {row["strategy"]: row for row in table_rows(curves_table(curves))}
    for label in curves.labels:
        assert [last[label][key] for key in ("chamfer_mm", "ci_low", "ci_high")] == [
            board[label][f"chamfer_mm{key}"] for key in ("", f"_{named}_low", f"_{named}_high")]


@pytest.mark.parametrize("episodes", [70, 134])
def test_a_unit_that_failed_counts_as_the_worst_at_the_end(tmp_path: Path, episodes: int) -> None:
    """Its six episodes, one in twelve or in 22, were left out, or the whole mean was."""
    plan = plan_of(tmp_path, wide_text(2, 2, episodes))
    store = Store(tmp_path)
    store.open_for(plan, None, "cpu")
    for unit in plan.units():
        count = unit.stop - unit.start
        if unit.cell.strategy.name == "s" and count == 6 and unit.cell.object_name == "block":
            store.log(unit).write_text("it broke")
            continue
        errors = np.random.default_rng(int(unit.id[:8], 16)).gamma(2.0, 2.0, count)
        write_unit(store.path(unit), unit.id, {
            "episode": np.arange(unit.start, unit.stop), "status": np.full(count, "ok", object),
            "touches": np.full(count, 8), "robot_time_s": np.full(count, 50.0),
            "chamfer_mm": errors, "prior_chamfer_mm": np.full(count, 40.0)})
    curves = read_curves(plan, [store], "these")
    last = {row["strategy"]: row for row in table_rows(curves_table(curves))}
    for row in table_rows(make_leaderboard(plan, [store]))[:2]:
        assert [last[row["strategy"]][key] for key in ("chamfer_mm", "ci_low", "ci_high")] == [
            row[f"chamfer_mm{key}"] for key in ("", "_these_low", "_these_high")]
    assert reach(curves, "touches", 0, 50.0).share == pytest.approx(1.0 - 3 / episodes)


def test_an_object_without_any_error_is_named_and_left_out(tmp_path: Path) -> None:
    def rows(unit: Unit) -> Columns:
        lost = unit.cell.object_name == "block"
        return {"chamfer_mm": np.full(8, np.nan) if lost else np.arange(1.0, 9.0),
                "robot_time_s": np.full(8, 50.0)}

    plan, store = written(tmp_path, 3, rows)
    made = curves_table(read_curves(plan, [store]))
    assert {row["chamfer_mm"] for row in table_rows(made)} == {"4.500"}
    assert any("no entry has any chamfer_mm on block" in note for note in made.notes)


def test_episodes_without_an_error_are_counted(tmp_path: Path) -> None:
    """They count as the worst all along. An object on which nothing has an error is left out."""

    def rows(unit: Unit) -> Columns:
        errors = np.arange(1.0, 9.0)
        errors[:3] = np.nan
        lost = unit.cell.object_name == "block"
        return {"chamfer_mm": np.full(8, np.nan) if lost else errors,
                "robot_time_s": np.full(8, 50.0)}

    plan, store = written(tmp_path, 3, rows)
    made = curves_table(read_curves(plan, [store]))
    assert [note for note in made.notes if "count as the worst" in note] == [
        "episodes without chamfer_mm count as the worst on their object: 6 of s, "
        "6 of sx"]


def test_a_mean_of_most_has_the_interval_of_those_alone() -> None:
    values = np.random.default_rng(3).normal(5.0, 1.0, (40, 2))
    values[[3, 20], 0] = np.nan
    known, every = values[np.isfinite(values[:, 0]), 0], completed(values)
    assert every[:, 0].mean() == pytest.approx(known.mean())
    assert every[:, 0].var(ddof=1) / 40 == pytest.approx(known.var(ddof=1) / 38)
    assert (every[:, 1] == values[:, 1]).all()


@pytest.mark.parametrize("late", [0, 1])
def test_too_few_fits_on_any_object_leave_no_mean(late: int) -> None:
    first = [[100.0 if body == late and n % 2 else 20.0 for n in range(8)] for body in range(2)]
    curves = replace(curves_over("these", 8, 8), steps={"touches": [
        [[(np.array([at]), np.array([4.0])) for at in own]] for own in first]})
    found = mean_curve(curves, "touches", 0, np.array([50.0, 100.0]))
    assert np.isnan(found.value).tolist() == [True, False]


def test_who_has_no_fit_yet_has_its_prior_at_the_same_time(tmp_path: Path) -> None:
    """It counted as the worst that others had by then, which may be far better than nothing."""
    def rows(unit: Unit) -> Columns:
        quick = unit.cell.strategy.name == "s"
        return {"chamfer_mm": np.full(8, 4.0 if quick else 3.0),
                "robot_time_s": np.full(8, 50.0 if quick else 300.0),
                "prior_chamfer_mm": 9.0 + np.arange(8)}

    plan, store = written(tmp_path, 2, rows)
    (row,) = table_rows(same_time_table(read_curves(plan, [store]), "s"))
    assert (row["chamfer_mm_then"], row["chamfer_mm_difference"]) == ("12.500", "8.500")
    assert row["wins"] == "0/2"
    first = next(unit for unit in plan.units() if unit.cell.strategy.name == "sx")
    store.path(first).unlink()
    store.log(first).write_text("it broke")
    (row,) = table_rows(same_time_table(read_curves(plan, [store]), "s"))
    assert row["chamfer_mm_then"] == "14.250"  # the worst prior, and the mean of the others'


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


def curves_over(over: str, *counts: int) -> Curves:
    """One entry, whose episodes, so many on each object, reach 5 mm after 20 touches and more."""
    episodes = [[(0, n) for n in range(count)] for count in counts]
    drawn = (object_weights(1, len(counts)) if over == "like-these"
             else np.ones((1 + REPLICATES, len(counts))))
    return Curves((Entry(0, "one", {}),), tuple("abc"[:len(counts)]),
                  {"touches": [[[(np.array([20.0 + n]), np.array([4.0])) for _, n in own]]
                               for own in episodes]}, [], episodes,
                  _weights(1, episodes, over), drawn, over, 1, ())


def test_an_error_of_just_the_bound_reaches_it() -> None:
    curves = curves_over("these", 8)
    assert [reach(curves, "touches", 0, bound).share for bound in (3.999, 4.0)] == [0.0, 1.0]


def test_reach_of_objects_like_these_holds_the_truth() -> None:
    """Of few objects percentiles of replicates alone held in half of the studies."""
    generator, held, trials = np.random.default_rng(3), 0, 60
    for trial in range(trials):
        at = [np.exp(3.0 + generator.normal(0.0, 0.5) + generator.normal(0.0, 0.3, 8))
              for _ in range(4)]
        episodes = [[(0, n) for n in range(8)] for _ in at]
        curves = Curves((Entry(0, "one", {}),), tuple("abcd"),
                        {"touches": [[[(np.array([t]), np.array([4.0])) for t in own]]
                                     for own in at]}, [], episodes,
                        _weights(trial, episodes, "like-these"), object_weights(trial, 4),
                        "like-these", trial, ())
        found = reach(curves, "touches", 0, 5.0)
        held += bool(found.low <= np.exp(3.0) <= found.high)
    assert held >= 0.87 * trials


def test_one_object_says_nothing_of_reach_on_others() -> None:
    found = reach(curves_over("like-these", 8), "touches", 0, 5.0)
    assert np.isnan([found.low, found.high]).all()


def test_who_is_near_without_a_touch_has_no_interval_on_a_log_scale() -> None:
    """Nor a warning of NumPy: what was given is within the bound, and nothing is touched."""
    curves = curves_over("like-these", 8, 8)
    none = [[[(np.zeros(1), np.array([4.0]))] * 8]] * 2
    found = reach(replace(curves, steps={"touches": none}), "touches", 0, 5.0)
    assert (found.share, found.median) == (1.0, 0.0)
    assert np.isnan([found.low, found.high]).all()


@pytest.mark.parametrize(("counts", "known"), [
    ((5,), False), ((6,), True), ((3, 3), False), ((3, 4), True), ((2, 2, 3), False),
    ((2, 3, 3), True)])
def test_the_median_of_few_episodes_of_these_objects_has_no_interval(
        counts: tuple[int, ...], known: bool) -> None:
    """Every object but one takes an episode away."""
    found = reach(curves_over("these", *counts), "touches", 0, 5.0)
    assert np.isfinite([found.low, found.high]).all() == known
    assert np.isfinite(found.median)


@pytest.mark.parametrize(("end", "step"), [(40.0, 1.0), (90.0, 2.0), (130.0, 5.0), (300.0, 10.0),
                                           (4000.0, 100.0)])
def test_places_of_many_refits_are_a_round_step_apart(end: float, step: float) -> None:
    at = np.linspace(end / 200, end, 200)
    curves = replace(curves_over("these", 6), steps={"touches": [[[(at, 9.0 - at / end)] * 6]]})
    grid = grid_of(curves, "touches", 0)
    np.testing.assert_allclose(np.diff(grid[1:-1]), step)
    np.testing.assert_allclose(grid[1:-1] / step, np.rint(grid[1:-1] / step))
    assert (grid[0], grid[-1]) == (at[0], end)


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
