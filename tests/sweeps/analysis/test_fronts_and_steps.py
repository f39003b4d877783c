"""Points of curves, intervals that say nothing, and who is on the front."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from curved_episodes import OBJECTS, lists, table_rows, wide_study, wide_text, written

from sweeps.analysis.confusion import read_confusion
from sweeps.analysis.curves import POINTS, curves_table, read_curves
from sweeps.analysis.entries import LeaderboardError
from sweeps.analysis.leaderboard import make_leaderboard
from sweeps.analysis.paired import read_paired
from sweeps.analysis.pareto import _others
from sweeps.analysis.settings import read_settings, settings_table
from sweeps.analysis.tables import KINDS, Asked
from sweeps.figures.heat_maps import draw_confusion
from sweeps.report.page import make_report
from sweeps.run.plan import Unit
from sweeps.run.unit_file import Columns

SWEPT = '[sweep.grid]\n"sensors.tendon_threshold_N" = [3.0, 6.0]\n'


def short_and_long(unit: Unit) -> Columns:
    """One refitted at 2, 4, 6 and 8 touches; one at 150 places that differ between episodes."""
    few = unit.cell.strategy.name == "s"
    at = [[2.0, 4.0, 6.0, 8.0] if few else list(np.arange(7.0 + n, 600.0, 4.0)) for n in range(8)]
    errors = [list(np.linspace(12.0, 4.0, len(each))) for each in at]
    return {"touches": np.array([each[-1] for each in at]), "robot_time_s": np.full(8, 50.0),
            "chamfer_mm": np.full(8, 4.0), "curve_touches": lists(at),
            "curve_time_s": lists([[50.0 * a / each[-1] for a in each] for each in at]),
            "curve_chamfer_mm": lists(errors)}


def test_an_entry_has_points_of_its_own(tmp_path: Path) -> None:
    """One of few touches beside one of many lost its first fits, and went on beyond its end."""
    plan, store = written(tmp_path, 2, short_and_long)
    rows = [row for row in table_rows(curves_table(read_curves(plan, [store])))
            if row["against"] == "touches"]
    few, many = ([row for row in rows if row["strategy"] == name] for name in ("s", "sx"))
    assert [float(row["at"]) for row in few] == [2.0, 4.0, 6.0, 8.0]
    assert [float(row["chamfer_mm"]) for row in few] == pytest.approx(
        np.linspace(12.0, 4.0, 4), abs=1e-3)
    places = [float(row["at"]) for row in many]
    assert len(places) <= POINTS + 2
    assert places[0] == 14.0  # from where all eight have a fit
    assert places[-1] == max(float(np.arange(7.0 + n, 600.0, 4.0)[-1]) for n in range(8))
    assert many[-1]["chamfer_mm"] == "4.000"


def far_apart(unit: Unit) -> Columns:
    """Of two objects whose means differ so much that nothing follows for others like these."""
    far = unit.cell.object_name == "block"
    return {"chamfer_mm": np.linspace(38.0, 42.0, 8) if far else np.linspace(1.0, 2.0, 8),
            "robot_time_s": np.linspace(200.0, 220.0, 8) if far else np.full(8, 2.0)}


def test_intervals_that_say_nothing_are_unknown_in_every_table(tmp_path: Path) -> None:
    """They ended at kilometres and at months."""
    plan, store = written(tmp_path, 2, far_apart, SWEPT)
    for row in table_rows(make_leaderboard(plan, [store]))[:4]:
        assert row["chamfer_mm_ci_high"] == "NA"
    asked = Asked(plan, [store], "chamfer_mm", None, "like-these")
    for kind, ends in (("pareto", ("chamfer_mm_ci", "robot_time_s_ci")), ("curves", ("ci",)),
                       ("settings", ("chamfer_mm_ci",))):
        for row in table_rows(KINDS[kind][0](asked)):
            assert {row[f"{end}_{side}"] for end in ends for side in ("low", "high")} == {"NA"}
            assert row["chamfer_mm"] != "NA"


@pytest.mark.parametrize(("metric", "prior", "score", "better"), [
    ("chamfer_mm", 20.0, 20.0, 5.0), ("chamfer_mm", 20.0, 25.0, 5.0),
    ("iou", 0.4, 0.4, 0.8), ("iou", 0.4, 0.3, 0.8)])
def test_who_is_no_better_than_its_prior_is_not_on_the_front(
        tmp_path: Path, metric: str, prior: float, score: float, better: float) -> None:
    """One that fails before its first move takes no time, and no other was cheaper."""
    def rows(unit: Unit) -> Columns:
        dies = unit.cell.strategy.name == "sx"
        return {"status": np.full(8, "strategy_failed" if dies else "ok", object),
                metric: np.full(8, score if dies else better),
                f"prior_{metric}": np.full(8, prior),
                "robot_time_s": np.full(8, 0.0 if dies else 50.0)}

    plan, store = written(tmp_path, 2, rows)
    asked = Asked(plan, [store], metric, None, None)
    told = {row["strategy"]: (row["dominated_by"], row["p_front"])
            for row in table_rows(KINDS["pareto"][0](asked))}
    assert told == {"sx": ("given-prior", "0.000"), "s": ("", "1.000")}


def pareto_of(folder: Path, objects: int, rows: Callable[[Unit], Columns]
              ) -> tuple[dict[str, dict[str, str]], list[str]]:
    """The rows of the table, by strategy, and its notes."""
    plan, store = written(folder, objects, rows)
    made = KINDS["pareto"][0](Asked(plan, [store], "chamfer_mm", None, None))
    return {row["strategy"]: row for row in table_rows(made)}, list(made.notes)


def test_a_front_of_robot_time_against_itself_is_refused(tmp_path: Path) -> None:
    """Its columns had one name twice, and records of JSON lost one of each."""
    plan, store = written(tmp_path, 1, far_apart)
    with pytest.raises(LeaderboardError, match="--metric: is robot_time_s, which pareto compares"):
        KINDS["pareto"][0](Asked(plan, [store], "robot_time_s", None, None))


def test_where_all_fail_they_would_take_the_time_of_other_objects_or_longer() -> None:
    done, failed = np.zeros(2, bool), np.ones(2, bool)
    times = [(np.array([10.0, 20.0]), done), (np.array([40.0, 60.0]), failed),
             (np.array([1.0, 2.0]), failed), (np.array([30.0, 1.0]), np.array([False, True]))]
    assert _others(times).tolist() == [15.0, 50.0, 22.5, 30.0]
    assert np.isnan(_others(times[1:3])).all()


def test_times_are_of_the_objects_that_errors_are_of(tmp_path: Path) -> None:
    """Where nothing has a distance on an object the time there counted in what was shown, but not
    in who dominates: here "sx" seemed to beat "s" in both, and did not dominate it."""
    def rows(unit: Unit) -> Columns:
        lost, slow = unit.cell.object_name == "block", unit.cell.strategy.name == "sx"
        return {"chamfer_mm": np.full(8, np.nan if lost else 5.0 if slow else 6.0),
                "robot_time_s": np.full(8, (10.0 if lost else 60.0) if slow else 50.0)}

    told, _ = pareto_of(tmp_path, 3, rows)
    assert {name: row["robot_time_s"] for name, row in told.items()} == {"s": "50.00",
                                                                         "sx": "60.00"}
    assert {row["dominated_by"] for row in told.values()} == {""}


def test_the_chance_of_the_front_counts_replicates_no_better_than_the_prior(tmp_path: Path) -> None:
    """Worse on one of three objects, "s" is worse in the mean where it is drawn twice or thrice."""
    worse = dict(zip(OBJECTS, (-2.0, -2.0, 1.0), strict=False))

    def rows(unit: Unit) -> Columns:
        slow = unit.cell.strategy.name == "sx"
        apart = 5.0 if slow else worse[unit.cell.object_name]
        return {"chamfer_mm": np.full(8, 12.0 + apart), "prior_chamfer_mm": np.full(8, 12.0),
                "robot_time_s": np.full(8, 50.0 if slow else 10.0)}

    told, _ = pareto_of(tmp_path, 3, rows)
    assert float(told["s"]["p_front"]) == pytest.approx(20 / 27, abs=0.05)
    assert told["sx"]["p_front"] == "0.000"


def test_replicates_of_a_cost_are_of_the_objects_where_an_entry_has_any(tmp_path: Path) -> None:
    def rows(unit: Unit) -> Columns:
        none = (unit.cell.object_name, unit.cell.strategy.name) == (OBJECTS[0], "sx")
        time = np.nan if none else 10.0 * (1 + OBJECTS.index(unit.cell.object_name))
        return {"chamfer_mm": np.full(8, 5.0), "robot_time_s": np.full(8, time)}

    plan, store = written(tmp_path, 3, rows)
    means = read_paired(plan, [store], ["chamfer_mm", "robot_time_s"]).means["robot_time_s"]
    assert means[0].tolist() == [20.0, 25.0]


@pytest.mark.parametrize("early", [5.0, 100.0])
def test_an_entry_that_is_quick_because_it_fails_early_is_named(tmp_path: Path, early: float
                                                                ) -> None:
    """Half of the episodes of "sx" fail: it is on the front only if they fail early."""
    def rows(unit: Unit) -> Columns:
        failed = (np.arange(8) % 2 == 0) & (unit.cell.strategy.name == "sx")
        time = np.where(failed, early, 100.0 if unit.cell.strategy.name == "sx" else 60.0)
        return {"status": np.where(failed, "strategy_failed", "ok").astype(object),
                "chamfer_mm": np.where(failed, 12.0, 3.0), "prior_chamfer_mm": np.full(8, 12.0),
                "robot_time_s": time}

    told, notes = pareto_of(tmp_path, 3, rows)
    assert told["sx"]["dominated_by"] == ("" if early < 50.0 else "s")
    assert [note for note in notes if "failed" in note] == ([
        "sx takes 52.5 s, but 12 of its episodes failed, after 5.0 s in the mean, where the others "
        "take 100.0 s: had they taken as long, it would take 100.0 s, and s would dominate it"]
        if early < 50.0 else [])
    plan, store = written(tmp_path / "page", 3, rows)
    assert ("and s would dominate it" in make_report(plan, [store], views=False).decode()) == (
        early < 50.0)


@pytest.mark.parametrize(("metric", "worse", "better"), [
    ("chamfer_mm", 8.0, 5.0), ("iou", 0.5, 0.8)])
def test_of_equal_cost_the_better_dominates(tmp_path: Path, metric: str, worse: float,
                                            better: float) -> None:
    def rows(unit: Unit) -> Columns:
        score = worse if unit.cell.strategy.name == "sx" else better
        return {metric: np.full(8, score), "robot_time_s": np.full(8, 50.0)}

    plan, store = written(tmp_path, 2, rows)
    told = {row["strategy"]: row["dominated_by"]
            for row in table_rows(KINDS["pareto"][0](Asked(plan, [store], metric, None, None)))}
    assert told == {"sx": "s", "s": ""}


@pytest.mark.parametrize("value", [3.3, 7.77])
def test_rounding_is_no_share_of_a_factor(tmp_path: Path, value: float) -> None:
    """The mean of equal means is another number in its last digit."""
    plan, store = written(
        tmp_path, 5, lambda unit: {"chamfer_mm": np.full(8, value),
                                   "robot_time_s": np.full(8, 100.0)},
        '[sweep.grid]\n"sensors.tendon_threshold_N" = [3, 6, 9]\n"object.yaw_deg" = [0, 45]\n')
    table = settings_table(plan, read_settings(plan, [store], "chamfer_mm"), "chamfer_mm")
    assert {row["share"] for row in table_rows(table)} == {"NA"}


def test_a_level_of_more_settings_has_more_of_the_share(tmp_path: Path) -> None:
    """Settings of 4, 6 and 10 mm, of which the first two are one level."""
    plan, store = written(
        tmp_path, 2, lambda unit: {"chamfer_mm": np.full(8, {0: 4.0, 45: 6.0, 90: 10.0}[
            unit.cell.setting["object.yaw_deg"]]), "robot_time_s": np.full(8, 100.0)},
        '[sweep.zip]\n"sensors.tendon_threshold_N" = [3, 3, 6]\n"object.yaw_deg" = [0, 45, 90]\n')
    table = settings_table(plan, read_settings(plan, [store], "chamfer_mm"), "chamfer_mm")
    share = np.var([5.0, 5.0, 10.0]) / np.var([4.0, 6.0, 10.0])
    assert {row["share"] for row in table_rows(table) if "tendon" in row["factor"]} == {
        f"{share:.4f}"}


TOGETHER = "vary together: their levels are the same settings"


@pytest.mark.parametrize(("swept", "names"), [
    ('[sweep.zip]\n"sensors.tendon_threshold_N" = [3, 6, 9]\n"object.yaw_deg" = [90, 0, 45]\n',
     "sensors.tendon_threshold_N and object.yaw_deg "),
    ('[sweep.sobol]\nn = 4\n"sensors.tendon_threshold_N" = { low = 3, high = 9 }\n'
     '"object.yaw_deg" = { low = 0, high = 90 }\n',
     "sensors.tendon_threshold_N and object.yaw_deg "),
    ('[sweep.sobol]\nn = 16\n"sensors.tendon_threshold_N" = { low = 3, high = 9 }\n'
     '"object.yaw_deg" = { low = 0, high = 90 }\n', ""),
    ('[sweep.grid]\n"sensors.tendon_threshold_N" = [3, 6]\n"object.yaw_deg" = [0, 45]\n', ""),
])
def test_factors_that_nothing_tells_apart_are_named(tmp_path: Path, swept: str, names: str
                                                     ) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 2, 4, swept))
    notes = settings_table(plan, read_settings(plan, [store], "chamfer_mm"), "chamfer_mm").notes
    told = [note for note in notes if TOGETHER in note]
    assert len(told) == bool(names)
    assert all(note.startswith(names + TOGETHER) for note in told)


def test_a_confusion_of_a_study_without_a_finished_block_says_so(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 2, 4))
    for unit in plan.units():
        if unit.cell.strategy.name == "s":
            store.path(unit).unlink()
    found = read_confusion(plan, [store])
    assert not any("names what it felt" in note for note in found.notes)
    with pytest.raises(LeaderboardError, match="no block of episodes is finished"):
        draw_confusion(found)
