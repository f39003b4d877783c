"""The tables beside the leaderboard, against scipy, definitions and cases worked by hand."""

import csv
import io
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from curved_episodes import SWEPT, lists, wide_study, wide_text
from fake_episodes import cell_by_cell
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from sweeps.analysis.confusion import confusion_table, read_confusion
from sweeps.analysis.curves import (
    curves_table,
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
from sweeps.analysis.objects import ALSO, median_interval, object_rows, objects_table
from sweeps.analysis.paired import Paired, read_paired
from sweeps.analysis.pairs import (
    compare_pairs,
    episodes_test,
    holm,
    objects_test,
    pairs_table,
    variance_ratio,
)
from sweeps.analysis.pareto import dominating, pareto_table
from sweeps.analysis.settings import effects, read_settings, settings_table
from sweeps.analysis.tables import KINDS
from sweeps.cli import main as cli
from sweeps.run.plan import Plan
from sweeps.run.store import Store
from sweeps.text_table import TextTable


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Store]:
    return wide_study(tmp_path_factory.mktemp("wide"))


@pytest.fixture(scope="module")
def paired(study: tuple[Plan, Store]) -> Paired:
    plan, store = study
    return read_paired(plan, [store], ["chamfer_mm", *ALSO])


def rows_of(table: TextTable) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(table.csv().decode())))


@settings(max_examples=100, deadline=None)
@given(st.lists(st.floats(0, 1), min_size=1, max_size=6))
def test_holm_is_the_closed_test_of_bonferroni(p: list[float]) -> None:
    """A hypothesis is rejected when every intersection that holds it is: Holm's own proof."""
    def by_definition(n: int) -> float:
        subsets = [s for size in range(1, len(p) + 1) for s in combinations(range(len(p)), size)
                   if n in s]
        return min(1.0, max(len(s) * min(p[k] for k in s) for s in subsets))

    assert np.allclose(holm(np.array(p)), [by_definition(n) for n in range(len(p))])


def test_holm_passes_over_what_has_no_p() -> None:
    found = holm(np.array([0.01, np.nan, 0.04]))
    assert found[[0, 2]].tolist() == [0.02, 0.04]
    assert np.isnan(found[1])


def test_tests_on_one_object_are_those_of_scipy() -> None:
    generator = np.random.default_rng(1)
    first, second = generator.normal(0, 1, (2, 30))
    assert episodes_test([first - second]) == pytest.approx(
        stats.ttest_rel(first, second).pvalue, rel=1e-9)
    differences = generator.normal(0.4, 1, 9)
    ranks = stats.rankdata(np.abs(differences))
    observed = min(ranks[differences > 0].sum(), ranks[differences < 0].sum())
    every = np.array([sum(r for r, up in zip(ranks, f"{n:09b}", strict=True) if up == "1")
                      for n in range(2**9)])  # all signs, equally likely
    assert objects_test(differences) == pytest.approx(min(1.0, 2 * (every <= observed).mean()))


def test_the_stratified_test_holds_its_level() -> None:
    """Objects of very different spread and a true difference of zero: p below 5 % is rare."""
    generator = np.random.default_rng(2)
    found = np.array([episodes_test([generator.normal(0, spread, 12) for spread in (1, 5, 20)])
                      for _ in range(2000)])
    assert (found < 0.05).mean() == pytest.approx(0.05, abs=0.015)
    assert np.isnan(episodes_test([np.array([1.0])]))
    assert episodes_test([np.full(4, 2.0)]) == 0.0
    assert objects_test(np.zeros(4)) == 1.0


def test_pairs_agree_with_the_values_themselves(paired: Paired) -> None:
    pairs = compare_pairs(paired, "chamfer_mm")
    assert [(p.first, p.second) for p in pairs] == [("s", "sx"), ("s", "sxx"), ("sx", "sxx")]
    by_hand = np.mean([v[:, 0].mean() - v[:, 1].mean() for v in paired.values["chamfer_mm"]])
    assert pairs[0].difference == pytest.approx(by_hand)
    assert pairs[0].like_these[0] < pairs[0].difference < pairs[0].like_these[1] < 0
    assert pairs[0].wins == 6
    assert pairs[0].p_objects == 2 * 0.5**6
    table = pairs_table(paired, "chamfer_mm")
    assert "cannot fall below 0.094: a claim about other objects needs 7" in table.notes[-1]
    against = compare_pairs(paired, "chamfer_mm", "best")
    assert [(p.first, p.second) for p in against] == [("sx", "s"), ("sxx", "s")]
    with pytest.raises(LeaderboardError, match="did you mean sxx"):
        compare_pairs(paired, "chamfer_mm", "sxxx")


def test_an_identical_copy_is_never_told_apart(paired: Paired) -> None:
    twin = Paired(paired.entries[:2], paired.objects,
                  {"iou": tuple(v[:, [0, 0]] for v in paired.values["chamfer_mm"])},
                  {"iou": paired.means["chamfer_mm"][:, [0, 0]]}, ())
    (pair,) = compare_pairs(twin, "iou")
    assert (pair.difference, pair.wins) == (0.0, 0)
    assert pair.like_these == pair.these == (0.0, 0.0)
    assert (pair.p_objects, pair.p_episodes) == (1.0, 1.0)


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
    grid = grid_of(once, "touches")
    ends = [mean_curve(curves, "touches", 0, grid) for curves in (once, often)]
    assert np.ptp([end.value[-1] for end in ends]) < 1e-9
    first, second = (end.high[-1] - end.low[-1] for end in ends)
    assert first == pytest.approx(second, rel=0.15)


def unfinished(folder: Path, objects: int, there: int, episodes: int = 16) -> tuple[Plan, Store]:
    """A study of which the units of the first objects alone are there."""
    plan, store = wide_study(folder, wide_text(2, objects, episodes))
    names = [body.name for body in plan.study.objects[there:]]
    for unit in plan.units():
        if unit.cell.object_name in names:
            store.path(unit).unlink()
    return plan, store


@pytest.mark.parametrize("there", [1, 2])
def test_unfinished_studies_have_the_intervals_of_what_is_there(
        there: int, tmp_path: Path) -> None:
    """Neither points nor nothing, and no replicate that drew only what is missing."""
    plan, store = unfinished(tmp_path, 3, there)
    curves = read_curves(plan, [store])
    first_fits = [at[0] for found in curves.steps["time_s"] for at, _ in found[0]]
    end = mean_curve(curves, "touches", 0, grid_of(curves, "touches"))
    assert end.low[-1] < end.value[-1] < end.high[-1]
    (row,) = rows_of(same_time_table(curves, "s"))
    assert float(row["ci_low"]) < float(row["chamfer_mm_difference"]) < float(row["ci_high"])
    assert reach(curves, "time_s", 0, 20.0).low > min(first_fits)
    first, *_ = rows_of(pareto_table(
        read_paired(plan, [store], ["chamfer_mm", "robot_time_s"]), "chamfer_mm"))
    assert float(first["chamfer_mm_ci_low"]) < float(first["chamfer_mm_ci_high"])


def test_a_replicate_that_drew_nothing_leaves_the_others(tmp_path: Path) -> None:
    """Of four episodes one replicate in fifty draws none."""
    plan, store = wide_study(tmp_path, wide_text(2, 1, 4))
    curves = read_curves(plan, [store])
    assert (curves.weights[0].sum(axis=1) == 0).any()
    end = mean_curve(curves, "time_s", 0, grid_of(curves, "time_s"))
    assert end.low[-1] < end.value[-1] < end.high[-1]
    (row,) = rows_of(same_time_table(curves, "s"))
    assert float(row["ci_low"]) <= float(row["chamfer_mm_difference"]) <= float(row["ci_high"])


def test_one_episode_has_no_intervals(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 1, 1))
    curves = read_curves(plan, [store])
    paired = read_paired(plan, [store], ["chamfer_mm", "robot_time_s"])
    for table in (curves_table(curves), same_time_table(curves, "s"), reach_table(curves),
                  pairs_table(paired, "chamfer_mm"), pareto_table(paired, "chamfer_mm")):
        for row in rows_of(table):
            bounds = [value for key, value in row.items() if "ci_" in key or key == "p_front"]
            assert set(bounds) == {"NA"}


def test_confusion_counts_every_episode(study: tuple[Plan, Store]) -> None:
    plan, store = study
    found = read_confusion(plan, [store])
    told = {(unit.cell.strategy.name, unit.cell.object_name): store.read(unit)
            for unit in plan.units()}
    for row in rows_of(confusion_table(found)):
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


def test_same_time_without_a_finished_block_is_told(tmp_path: Path) -> None:
    plan, store = unfinished(tmp_path, 1, 0)
    with pytest.raises(LeaderboardError, match="no block of episodes is finished"):
        same_time_table(read_curves(plan, [store]), "s")


def test_same_time_passes_over_an_object_that_all_fail_on(tmp_path: Path) -> None:
    """It says nothing of who was ahead; the others still do."""
    plan, store = wide_study(tmp_path, wide_text(2, 3, 8))
    for unit in plan.units():
        if unit.cell.object_name == "block":
            store.path(unit).unlink()
            store.log(unit).write_text("it broke")
    (row,) = rows_of(same_time_table(read_curves(plan, [store]), "s"))
    assert row["wins"].endswith("/2")
    assert float(row["ci_low"]) <= float(row["chamfer_mm_difference"]) <= float(row["ci_high"])


def test_levels_of_a_factor_keep_to_the_scores_range(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, SWEPT)
    paired = read_settings(plan, [store], "iou")
    wild = np.random.default_rng(1).normal(0.5, 5.0, paired.means["iou"].shape)
    effect = next(effects(plan, replace(paired, means={"iou": wild}), "iou"))
    assert np.ptp([effect.low, effect.high], axis=0).min() > 0.9
    assert 0 <= min(effect.low) < max(*effect.high, effect.spread[2]) <= 1


def test_levels_that_differ_by_luck_alone_have_a_spread_that_may_be_none(tmp_path: Path) -> None:
    """The interval is of a difference, not of the largest of some differences."""
    plan, store = wide_study(tmp_path, SWEPT)
    paired = read_settings(plan, [store], "chamfer_mm")
    luck = np.random.default_rng(2).normal(5.0, 1.0, paired.means["chamfer_mm"].shape)
    found = list(effects(plan, replace(paired, means={"chamfer_mm": luck}), "chamfer_mm"))
    for effect in found:
        assert effect.spread[1] < 0.0 < effect.spread[0] < effect.spread[2]


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
    assert {row["within_mm"] for row in rows_of(reach_table(curves))} == {"5", "3"}


def test_errors_at_the_same_time_are_those_when_the_other_ended(
    study: tuple[Plan, Store]
) -> None:
    plan, store = study
    curves = read_curves(plan, [store])
    label = curves.labels[0]
    rows = rows_of(same_time_table(curves, label))
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


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=1, max_size=8))
def test_dominance_by_definition(points: list[tuple[int, int]]) -> None:
    by = dominating(*np.array(points, float).T)
    for n, (e, c) in enumerate(points):
        for k, (error, cost) in enumerate(points):
            assert by[n, k] == (error <= e and cost <= c and (error, cost) != (e, c))


def test_pareto_of_equal_cost_is_the_best(paired: Paired) -> None:
    first, *rest = rows_of(pareto_table(paired, "chamfer_mm"))
    assert (first["dominated_by"], first["p_front"]) == ("", "1.000")
    assert {row["dominated_by"] for row in rest} == {"s"}


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


def test_few_objects_are_told(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 2, 4))
    paired = read_paired(plan, [store], ["chamfer_mm", *ALSO])
    for table in (pairs_table(paired, "chamfer_mm"), objects_table(paired, "chamfer_mm"),
                  curves_table(read_curves(plan, [store])),
                  confusion_table(read_confusion(plan, [store]))):
        assert "2 objects: below 6 nothing can be claimed" in " ".join(table.notes)


def test_the_worth_of_common_random_numbers_is_their_covariance() -> None:
    draw = np.random.default_rng(3)
    shared, own, other = draw.normal(size=(3, 4000))
    first, second = shared + own, shared + other  # Var(a-b) = 2, Var(a) + Var(b) = 4
    assert variance_ratio([first], [second]) == pytest.approx(0.5, abs=0.02)
    assert variance_ratio([own], [other]) == pytest.approx(1.0, abs=0.05)
    assert variance_ratio([first], [-first]) == pytest.approx(2.0)
    assert variance_ratio([first], [first]) == 0.0
    assert np.isnan(variance_ratio([np.ones(5)], [np.ones(5)]))
