"""The other tables beside the leaderboard, against scipy, definitions and cases worked by hand."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from curved_episodes import (
    SWEPT,
    table_rows,
    unfinished_study,
    wide_study,
    wide_text,
    written,
)
from fake_episodes import cell_by_cell
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from sweeps.analysis.confusion import confusion_table, read_confusion
from sweeps.analysis.curves import (
    curves_table,
    grid_of,
    mean_curve,
    reach,
    reach_table,
    read_curves,
    same_time_table,
)
from sweeps.analysis.leaderboard import make_leaderboard
from sweeps.analysis.objects import ALSO, median_interval, object_rows, objects_table
from sweeps.analysis.paired import NO_OBJECTS, Paired, read_paired
from sweeps.analysis.pairs import (
    compare_pairs,
    pairs_table,
)
from sweeps.analysis.pareto import COST, dominating, find_front, pareto_table
from sweeps.analysis.settings import effects, read_settings, settings_table
from sweeps.analysis.tables import KINDS, Asked
from sweeps.cli import main as cli
from sweeps.run.plan import Plan, Unit
from sweeps.run.store import Store
from sweeps.run.unit_file import write_files


@pytest.mark.parametrize("count", [6, 7, 16, 64, 101])
def test_median_intervals_are_scipys(count: int) -> None:
    values = np.random.default_rng(count).normal(0, 1, count)
    expected = stats.quantile_test(values, q=0, p=0.5).confidence_interval(0.95)
    assert median_interval(values) == (expected.low, expected.high)


def test_few_episodes_have_no_median_interval(paired: Paired) -> None:
    assert median_interval(np.array([1.0, 2.0, 3.0])) == (-np.inf, np.inf)
    assert np.isnan(median_interval(np.array([1.0] * 9 + [np.nan]))).all()
    rows = list(object_rows(paired, "chamfer_mm"))
    assert len(rows) == 18
    assert rows[1].median == np.median(paired.values["chamfer_mm"][0][:, 1])
    assert len(objects_table(paired, "chamfer_mm").rows) == 18


@pytest.mark.parametrize("objects", [1, 2])
def test_a_sampled_axis_that_changes_nothing_proves_nothing(objects: int, tmp_path: Path) -> None:
    """The same poses and noise at every point: tests and medians are those of the episodes."""
    axis = '[sweep.sobol]\nn = 16\n"object.yaw_deg" = { low = -180, high = 180 }\n'
    found = []
    for name, more in (("alone", ""), ("swept", axis)):
        plan, store = wide_study(tmp_path / name, wide_text(2, objects, 8, more))
        paired = read_paired(plan, [store], ["chamfer_mm", *ALSO])
        (pair,) = compare_pairs(paired, "chamfer_mm")
        found.append((pair, objects_table(paired, "chamfer_mm").rows, read_curves(plan, [store])))
    (alone, medians, once), (swept, of_swept, often) = found
    assert swept.p_episodes == pytest.approx(alone.p_episodes, rel=1e-9)
    assert medians == of_swept
    assert swept.these == pytest.approx(alone.these, rel=1e-9)
    assert swept.like_these == pytest.approx(alone.like_these, rel=1e-9, nan_ok=True)
    grid = grid_of(once, "touches", 0)
    ends = [mean_curve(curves, "touches", 0, grid) for curves in (once, often)]
    assert np.ptp([end.value[-1] for end in ends]) < 1e-9
    first, second = (end.high[-1] - end.low[-1] for end in ends)
    assert first == pytest.approx(second, rel=0.15)


@pytest.mark.parametrize("there", [1, 2])
def test_unfinished_studies_have_the_intervals_of_what_is_there(
        there: int, tmp_path: Path) -> None:
    """Neither points nor nothing, and no replicate that drew only what is missing."""
    plan, store = unfinished_study(tmp_path, 3, there)
    curves = read_curves(plan, [store])
    first_fits = [at[0] for found in curves.steps["time_s"] for at, _ in found[0]]
    end = mean_curve(curves, "touches", 0, grid_of(curves, "touches", 0))
    assert end.low[-1] < end.value[-1] < end.high[-1]
    (row,) = table_rows(same_time_table(curves, "s"))
    assert float(row["ci_low"]) < float(row["chamfer_mm_difference"]) < float(row["ci_high"])
    # Widened, as few objects deserve, it may begin a little before the first of all fits.
    assert reach(curves, "time_s", 0, 20.0).low > 0.9 * min(first_fits)
    first, *_ = table_rows(pareto_table(
        read_paired(plan, [store], ["chamfer_mm", "robot_time_s"]), "chamfer_mm"))
    assert float(first["chamfer_mm_ci_low"]) < float(first["chamfer_mm_ci_high"])


def test_a_replicate_that_drew_nothing_leaves_the_others(tmp_path: Path) -> None:
    """Of four episodes one replicate in fifty draws none."""
    plan, store = wide_study(tmp_path, wide_text(2, 1, 4))
    curves = read_curves(plan, [store])
    assert (curves.weights[0].sum(axis=1) == 0).any()
    end = mean_curve(curves, "time_s", 0, grid_of(curves, "time_s", 0))
    assert end.low[-1] < end.value[-1] < end.high[-1]
    (row,) = table_rows(same_time_table(curves, "s"))
    assert float(row["ci_low"]) <= float(row["chamfer_mm_difference"]) <= float(row["ci_high"])


def test_one_episode_has_no_intervals(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 1, 1))
    curves = read_curves(plan, [store])
    paired = read_paired(plan, [store], ["chamfer_mm", "robot_time_s"])
    for table in (curves_table(curves), same_time_table(curves, "s"), reach_table(curves),
                  pairs_table(paired, "chamfer_mm"), pareto_table(paired, "chamfer_mm")):
        for row in table_rows(table):
            bounds = [value for key, value in row.items() if "ci_" in key or key == "p_front"]
            assert set(bounds) == {"NA"}


def test_confusion_counts_every_episode(study: tuple[Plan, Store]) -> None:
    plan, store = study
    found = read_confusion(plan, [store])
    told = {(unit.cell.strategy.name, unit.cell.object_name): store.read(unit)
            for unit in plan.units()}
    for row in table_rows(confusion_table(found)):
        rows: Any = told[row["strategy"], row["object"]]
        count = (rows["recognized_as"] == row["recognized_as"]).sum()
        assert (row["n_episodes"], row["share"]) == (str(count), f"{count / 16:.4f}")
    assert sum(c.total() for c in found.counts.values()) == 3 * 6 * 16


def test_confusion_is_of_the_blocks_that_every_entry_has(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 2, 70))
    first = next(unit for unit in plan.units() if unit.cell.strategy.name == "s")
    store.path(first).unlink()
    found = read_confusion(plan, [store])
    assert "1 of 8 units are missing; blocks" in found.notes[0]
    left = {"block": 6, "large_cylinder": 70}  # of two blocks, 64 and 6
    assert {key: count.total() for key, count in found.counts.items()} == {
        (label, body): left[body] for label in ("s", "sx") for body in left}
    for row in table_rows(make_leaderboard(plan, [store]))[:2]:
        assert found.recognized[row["strategy"]] == pytest.approx(
            float(row["recognized"]), abs=5e-5)


def test_an_entry_that_names_some_objects_only_has_the_leaderboards_share(tmp_path: Path) -> None:
    def rows(unit: Unit) -> dict[str, Any]:
        asked = unit.cell.object_name == "block"
        return {"chamfer_mm": np.arange(8.0)} | ({"recognized": np.arange(8) < 6} if asked else {})

    plan, store = written(tmp_path, 2, rows)
    found = read_confusion(plan, [store])
    for row in table_rows(make_leaderboard(plan, [store])):
        assert found.recognized[row["strategy"]] == float(row["recognized"]) == 0.375


def test_levels_of_a_factor_keep_to_the_scores_range(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, SWEPT)
    paired = read_settings(plan, [store], "iou")
    shape = (len(paired.objects), 1, len(paired.entries))
    wild = np.random.default_rng(1).uniform(0.0, 1.0, shape)
    wild = np.round(wild.mean(axis=2, keepdims=True)) + 0.0 * wild  # 0 or 1 on each object
    wild[0], wild[1] = 0.0, 1.0
    effect = next(effects(plan, replace(
        paired, values={"iou": tuple(wild)}, means={"iou": wild.mean(axis=0)}), "iou"))
    assert np.ptp([effect.low, effect.high], axis=0).min() > 0.9
    assert 0 <= min(effect.low) < max(*effect.high, effect.spread[2]) <= 1


def test_levels_that_differ_by_luck_alone_have_a_spread_that_may_be_none(tmp_path: Path) -> None:
    """The interval is of a difference, not of the largest of some differences."""
    plan, store = wide_study(tmp_path, SWEPT)
    paired = read_settings(plan, [store], "chamfer_mm")
    luck = np.random.default_rng(2).normal(
        5.0, 1.0, (len(paired.objects), 16, len(paired.entries)))
    found = list(effects(plan, replace(
        paired, values={"chamfer_mm": tuple(luck)},
        means={"chamfer_mm": luck.mean(axis=(0, 1))[None]}), "chamfer_mm"))
    for effect in found:
        assert effect.spread[1] < 0.0 < effect.spread[0] < effect.spread[2]


@pytest.mark.parametrize("over", ["these", "like-these"])
def test_equal_levels_hardly_ever_have_a_spread_that_excludes_none(tmp_path: Path, over: str
                                                                   ) -> None:
    """Of eight equal levels the interval of the two that are farthest apart, as if these had been
    chosen beforehand, excluded 0 in four studies of ten."""
    plan, store = wide_study(tmp_path, wide_text(
        1, 6, 2, '[sweep.grid]\n"sensors.tendon_threshold_N" = [1, 2, 3, 4, 5, 6, 7, 8]'))
    paired = read_settings(plan, [store], "chamfer_mm", over)
    rng, trials, claims = np.random.default_rng(3), 100, 0
    for _ in range(trials):
        luck = rng.normal(5.0, 1.0, (6, 16, 8))
        effect = next(effects(plan, replace(
            paired, values={"chamfer_mm": tuple(luck)},
            means={"chamfer_mm": luck.mean(axis=(0, 1))[None]}), "chamfer_mm"))
        claims += effect.spread[1] > 0.0
    assert claims <= 0.05 * trials + 6


@settings(max_examples=50)
@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=1, max_size=8))
def test_dominance_by_definition(points: list[tuple[int, int]]) -> None:
    by = dominating(*np.array(points, float).T)
    for n, (e, c) in enumerate(points):
        for k, (error, cost) in enumerate(points):
            assert by[n, k] == (error <= e and cost <= c and (error, cost) != (e, c))


def test_an_entry_is_dominated_by_a_cheaper_one_that_is_as_good_but_for_rounding() -> None:
    """Shares of the same objects in another order: their means differ in the last bit."""
    error = -np.array([[0.3, 0.2, 0.1], [0.1, 0.2, 0.3]]).mean(axis=1)
    assert error[0] > error[1]
    assert dominating(error, np.array([1.0, 2.0])).tolist() == [[False, False], [True, False]]


def test_pareto_of_equal_cost_is_the_best(paired: Paired) -> None:
    first, *rest = table_rows(pareto_table(paired, "chamfer_mm"))
    assert (first["dominated_by"], first["p_front"]) == ("", "1.000")
    assert {row["dominated_by"] for row in rest} == {"s"}


def test_of_all_that_dominate_an_entry_the_best_is_named(paired: Paired) -> None:
    means = {"chamfer_mm": np.array([[3.0, 2.0, 1.0]]), COST: np.array([[10.0, 5.0, 6.0]])}
    assert find_front(replace(paired, means=means), "chamfer_mm").dominated_by == (2, None, None)


@pytest.mark.parametrize("over", ["like-these", "these"])
def test_intervals_are_the_leaderboards(tmp_path: Path, over: str) -> None:
    """Those of `pareto` and `settings` were percentiles of replicates, which held in 88 to 92 %."""
    text = wide_text(2, 6, 8, '[sweep.grid]\n"sensors.tendon_threshold_N" = [3.0, 6.0]\n')
    plan, store = wide_study(tmp_path, text)
    named = "ci" if over == "like-these" else "these"
    told = [f"chamfer_mm{end}" for end in ("", f"_{named}_low", f"_{named}_high")]
    board = {row["strategy"]: [row[key] for key in told]
             for row in table_rows(make_leaderboard(plan, [store]))}
    asked = Asked(plan, [store], "chamfer_mm", None, over)
    keys = [f"chamfer_mm{end}" for end in ("", "_ci_low", "_ci_high")]
    for row in table_rows(KINDS["pareto"][0](asked)):
        assert [row[key] for key in keys] == board[row["strategy"]]
    for row in table_rows(KINDS["settings"][0](asked)):
        entry = f"{row['strategy']} [{row['factor']}={row['level']}]"
        assert [row[key] for key in keys] == board[entry]


def test_nobody_made_the_touches_of_units_that_failed(tmp_path: Path) -> None:
    """They counted as the most of any entry, in `pareto` and `objects`, not in the leaderboard."""
    plan, store = wide_study(tmp_path, wide_text(3, 3, 8))
    for unit in plan.units():
        if unit.cell.strategy.name == "sx" and unit.cell.object_name != "block":
            store.path(unit).unlink()
            store.log(unit).write_text("it broke")
    board = {row["strategy"]: row for row in table_rows(make_leaderboard(plan, [store]))}
    asked = Asked(plan, [store], "chamfer_mm", None, None)
    pareto = {row["strategy"]: row for row in table_rows(KINDS["pareto"][0](asked))}
    objects = [row for row in table_rows(KINDS["objects"][0](asked)) if row["strategy"] == "sx"]
    for name, row in pareto.items():
        assert row["robot_time_s"] == board[name]["robot_time_s"]
        assert row["chamfer_mm"] == board[name]["chamfer_mm"]
    assert pareto["sx"]["robot_time_s_ci_low"] == "NA"  # of one object
    assert pareto["s"]["robot_time_s_ci_low"] != "NA"
    block, *rest = objects
    assert (block["touches"], block["robot_time_s"]) == (
        board["sx"]["touches"], board["sx"]["robot_time_s"])
    assert {row[key] for row in rest for key in ("touches", "robot_time_s")} == {"NA"}
    assert pareto["s"]["p_front"] == "1.000"


def test_where_no_object_has_a_value_nothing_is_said_of_intervals(tmp_path: Path) -> None:
    """"0 objects, 16 episodes in all: below 48 the interval of these objects holds less often"."""
    plan, store = wide_study(tmp_path, wide_text(2, 2, 8))
    for unit in plan.units():
        store.path(unit).unlink()
        store.log(unit).write_text("it broke")
    notes = read_paired(plan, [store], ["chamfer_mm"]).notes
    assert NO_OBJECTS in notes
    assert not any("below 48" in note for note in notes)


def test_a_strategy_whose_units_all_failed_leaves_the_front_to_the_others(tmp_path: Path) -> None:
    """Nobody's time was known then: no entry was dominated, and none had a p_front."""
    def fronts(names: int, failed: str) -> dict[str, tuple[str, str]]:
        folder = tmp_path / f"{names}"
        plan, store = wide_study(folder, wide_text(names, 3, 8))
        for unit in plan.units():
            if unit.cell.strategy.name == failed:
                store.path(unit).unlink()
                store.log(unit).write_text("it broke")
        found = KINDS["pareto"][0](Asked(plan, [store], "chamfer_mm", None, None))
        return {row["strategy"]: (row["dominated_by"], row["p_front"])
                for row in table_rows(found)}

    found = fronts(3, "sxx")
    assert found.pop("sxx")[1] == "NA"
    assert found == fronts(2, "")
    assert found["sx"][0] == "s"


def test_replicates_of_all_metrics_are_of_the_same_objects(tmp_path: Path) -> None:
    """Where an object is lost for the first metric, others were drawn apart from it."""
    plan, store = wide_study(tmp_path, wide_text(2, 4, 8))
    for unit in plan.units():
        rows = dict(store.read(unit) or {})
        lost = unit.cell.object_name == "wedge"
        rows["chamfer_mm"] = np.full(8, np.nan) if lost else rows["robot_time_s"]
        write_files(store.path(unit), unit.id, rows)
    paired = read_paired(plan, [store], ["chamfer_mm", "robot_time_s"])
    assert paired.means["chamfer_mm"] == pytest.approx(paired.means["robot_time_s"])
    assert len(paired.values["robot_time_s"]) == 4


def test_effects_of_swept_factors(tmp_path: Path) -> None:
    """The stand-in gains 0.1 mm a newton and does not care for the yaw."""
    plan, store = wide_study(tmp_path, SWEPT)
    paired = read_settings(plan, [store], "chamfer_mm")
    assert len(settings_table(plan, paired, "chamfer_mm").rows) == 2 * (2 + 4)
    found = list(effects(plan, paired, "chamfer_mm"))
    assert [(e.strategy, e.factor) for e in found] == [
        (s, f) for s in ("s", "sx") for f in ("sensors.tendon_threshold_N", "object.yaw_deg")]
    threshold, yaw = found[:2]
    assert threshold.levels == ("3", "6")
    assert threshold.value[1] - threshold.value[0] == pytest.approx(0.3, abs=0.05)
    assert threshold.share == pytest.approx(1.0, abs=1e-6)
    assert threshold.spread[1] > 0.2
    assert len(yaw.levels) == 4
    assert yaw.settings == (8, 8, 8, 8)
    assert yaw.share < 1e-6


def test_levels_that_were_sampled_rise(tmp_path: Path) -> None:
    """They came in the order of the sample."""
    sampled = '[sweep.sobol]\nn = 8\n"object.yaw_deg" = { low = -90, high = 90 }\n'
    plan, store = wide_study(tmp_path, wide_text(1, 2, 2, sampled))
    effect, = effects(plan, read_settings(plan, [store], "chamfer_mm"), "chamfer_mm")
    assert len(effect.levels) == 8
    assert list(map(float, effect.levels)) == sorted(map(float, effect.levels))
    given = [value for value, in plan.study.axes[0].values]
    assert [float(effect.levels[level]) for level in effect.level_of] == pytest.approx(
        given, abs=0.01)


def test_first_order_shares_of_an_additive_function(monkeypatch: pytest.MonkeyPatch,
                                                    tmp_path: Path) -> None:
    """On a full grid the shares of an additive response are its variances' and sum to one."""
    import curved_episodes

    @cell_by_cell
    def additive(cell: Any, episodes: np.ndarray, device: str) -> dict[str, np.ndarray]:
        value = cell.sensors.tendon_threshold_N + 2.0 * cell.sensors.tension_noise_N
        return {"status": np.full(len(episodes), "ok"),
                "chamfer_mm": np.full(len(episodes), value)}

    monkeypatch.setattr(curved_episodes, "run_episodes", additive)
    plan, store = wide_study(tmp_path, wide_text(1, 2, 2, """
[sweep.grid]
"sensors.tendon_threshold_N" = [2.0, 3.0, 4.0]
"sensors.tension_noise_N" = [0.0, 1.0]
"""))
    first, second = effects(plan, read_settings(plan, [store], "chamfer_mm"), "chamfer_mm")
    assert first.share == pytest.approx((2 / 3) / (2 / 3 + 1))
    assert second.share == pytest.approx(1 / (2 / 3 + 1))


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "settings"])
def test_the_command_writes_the_same_bytes_twice(
        study: tuple[Plan, Store], tmp_path: Path, kind: str,
        capsys: pytest.CaptureFixture[str]) -> None:
    folder = str(study[1].folder)
    against = ["--against", "s"] if kind == "same-time" else []
    for name in ("a.csv", "b.csv"):
        assert cli.run(["table", folder, kind, *against, "-o", str(tmp_path / name)]) == 0
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    assert capsys.readouterr().out.split()[0] in ("strategy", "object")


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind != "settings"])
def test_notes_name_options_that_the_table_takes(
        study: tuple[Plan, Store], kind: str, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["table", str(study[1].folder), kind]
    words += ["--against", "s"] if kind == "same-time" else []
    assert cli.run(words) == 0
    named = "--over these" in capsys.readouterr().err
    assert (cli.run([*words, "--over", "these"]) == 0) == named


@pytest.mark.parametrize("metric", ["robot_time_s", "touches"])
def test_a_metric_that_is_a_column_besides(
        study: tuple[Plan, Store], paired: Paired, metric: str) -> None:
    plan, store = study
    made = KINDS["objects"][0](Asked(plan, [store], metric, None, None))
    row = dict(zip(made.header, made.rows[0], strict=True))
    mine = paired.values[metric][0][:, paired.labels.index(row["strategy"])]
    assert float(row[f"{metric}_mean"]) == pytest.approx(mine.mean(), abs=5e-3)


@pytest.mark.parametrize(("arguments", "says"), [
    (["table", "DIR", "pair"], "did you mean pairs?"),
    (["table", "pairs"], "DIR: is missing"),
    (["table", "DIR", "settings"], "this study sweeps nothing"),
    (["table", "DIR", "pairs", "--metric", "chamfer"], "did you mean chamfer_mm?"),
    (["table", "DIR", "pairs", "--against", "nobody"], "--against: no entry 'nobody'"),
    (["table", "DIR/units", "pairs"], "holds no study"),
])
def test_bad_usage(study: tuple[Plan, Store], arguments: Sequence[str], says: str,
                   capsys: pytest.CaptureFixture[str]) -> None:
    given = [a.replace("DIR", str(study[1].folder)) for a in arguments]
    assert cli.run(given) == 2
    assert says in capsys.readouterr().err
