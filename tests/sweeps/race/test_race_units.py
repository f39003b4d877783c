"""The scores that a race reads from its units."""

from pathlib import Path
from typing import Any

import fake_episodes
import numpy as np
import pytest
from studies import SMALL, plan_of

from sweeps.analysis.entries import LeaderboardError
from sweeps.race.course import Course, afforded, rules_of
from sweeps.race.elimination import Look, Race, Rules
from sweeps.race.race_units import RaceUnits
from sweeps.run.store import Store
from sweeps.run.unit_file import write_files
from sweeps.run.worker import run_units


def test_a_unit_that_failed_counts_as_the_worst_that_any_entry_had_or_was_given(
        tmp_path: Path) -> None:
    plan, store = plan_of(tmp_path, SMALL), Store(tmp_path)
    store.open_for(plan, None, "cpu")
    units = RaceUnits(plan, store, "chamfer_mm", "these")
    asked = [(0, 0, 8), (1, 0, 8)]
    worst: dict[str, float] = {}
    for unit in units.units(asked):
        if unit.cell.strategy.name == "mine":
            store.log(unit).write_text("hung")
            continue
        rows = run_units(fake_episodes.given_episodes, [unit], "cpu")[0]
        rows["prior_chamfer_mm"] += 20.0
        rows["touches"] = np.array([40.0, np.nan] * 4)
        worst[unit.cell.object_name] = rows["prior_chamfer_mm"].max()
        write_files(store.path(unit), unit.id, rows)
    found, unknown = units.scores(asked)  # (object, episode)
    counted = found[1] + unknown.shares[1] * unknown.costs
    assert np.array_equal(counted, np.tile([[worst["block"]], [worst["wedge"]]], 8))
    assert np.array_equal(units.worst, [worst["block"], worst["wedge"]])
    assert np.array_equal(units.touches, [40.0, np.nan], equal_nan=True)  # of those known


def test_what_is_asked_for_again_is_counted_once(tmp_path: Path) -> None:
    plan, store = plan_of(tmp_path, SMALL), Store(tmp_path)
    store.open_for(plan, None, "cpu")
    units = RaceUnits(plan, store, "chamfer_mm", "these")
    lost, *others = units.units([(0, 0, 8)])
    for there in (others, [lost]):
        for unit in there:
            write_files(store.path(unit), unit.id,
                        run_units(fake_episodes.run_episodes, [unit], "cpu")[0])
        units.scores([(0, 0, 8)])
        assert units.missing == ([lost] if there is others else [])
    assert sum(units.statuses.values()) == 16


@pytest.mark.parametrize(("metric", "cap", "bounds"), [
    ("chamfer_mm", None, None), ("chamfer_mm", 20.0, (0.0, 20.0)), ("iou", 0.5, (-0.5, 0.0)),
    ("recognized", None, (-1.0, 0.0))])
def test_bounds_are_of_scores_of_which_less_is_better(
        metric: str, cap: float | None, bounds: tuple[float, float] | None) -> None:
    assert rules_of(0.1, 95.0, 8, cap, metric).bounds == bounds


@pytest.mark.parametrize(("metric", "cap", "message"), [
    ("iou", 3.0, "--cap: is 3; should be at most 1, the largest iou"),
    ("recognized", 0.5, "--cap: is 0.5; should be left out: recognized always has")])
def test_a_cap_above_all_scores_or_in_vain_is_refused(metric: str, cap: float, message: str
                                                      ) -> None:
    """With it a margin of 2 was accepted for a share, and one of `recognized` was ignored."""
    with pytest.raises(LeaderboardError, match=message):
        rules_of(2.0, 95.0, 8, cap, metric)


def test_a_budget_of_episodes_is_one_of_whole_replicates(tmp_path: Path) -> None:
    """Of four cases on two objects each."""
    text = SMALL + '[sweep.sobol]\nn = 4\n"object.yaw_deg" = { low = 0, high = 90 }\n'
    units = RaceUnits(plan_of(tmp_path, text), Store(tmp_path), "iou", "these")
    assert afforded(Rules(0.1), units, 103).budget == 12


def test_a_replicate_is_the_mean_of_its_cases(tmp_path: Path) -> None:
    text = SMALL + '[sweep.sobol]\nn = 4\n"object.yaw_deg" = { low = 0, high = 90 }\n'
    plan, store = plan_of(tmp_path, text), Store(tmp_path)
    store.open_for(plan, None, "cpu")
    units, drawn = RaceUnits(plan, store, "iou", "these"), np.random.default_rng(1)
    scores: dict[str, list[np.ndarray]] = {}
    for unit in units.units([(0, 0, 8)]):
        rows = run_units(fake_episodes.run_episodes, [unit], "cpu")[0] | {"iou": drawn.random(8)}
        scores.setdefault(unit.cell.object_name, []).append(rows["iou"])
        write_files(store.path(unit), unit.id, rows)
    found, _ = units.scores([(0, 0, 8)])
    assert len(scores["block"]) == 4
    assert found[0] == pytest.approx(-np.array([*scores.values()]).mean(axis=1))


def test_an_object_without_any_score_ends_a_race(tmp_path: Path) -> None:
    """All counted as 0 mm there: the best of nothing was known at once, within half the margin."""
    plan, store = plan_of(tmp_path, SMALL), Store(tmp_path)
    store.open_for(plan, None, "cpu")
    course = Course(Race(2, Rules(5.0)), RaceUnits(plan, store, "chamfer_mm", "these"))
    for unit in course.further():
        rows = run_units(fake_episodes.run_episodes, [unit], "cpu")[0]
        if unit.cell.object_name == "wedge":
            rows["chamfer_mm"][:] = np.nan
        write_files(store.path(unit), unit.id, rows)
    with pytest.raises(LeaderboardError, match="no entry has any chamfer_mm on wedge, where all"):
        course.further()


class Told(Race):
    """Keeps what it was told of how bad a replicate may be."""

    worst: Any = None

    def take(self, asked: Any, found: Any, worst: Any = None, unknown: Any = None) -> Look:
        """Takes note."""
        self.worst = worst
        return super().take(asked, found, worst, unknown)


def test_a_race_knows_after_its_first_rung_what_a_failure_would_cost(tmp_path: Path) -> None:
    plan, store = plan_of(tmp_path, SMALL), Store(tmp_path)
    store.open_for(plan, None, "cpu")
    course = Course(Told(2, Rules(5.0)), RaceUnits(plan, store, "chamfer_mm", "these"))
    for unit in course.further():
        rows = run_units(fake_episodes.given_episodes, [unit], "cpu")[0]
        rows["prior_chamfer_mm"] += 1000.0
        write_files(store.path(unit), unit.id, rows)
    course.further()
    assert isinstance(course.race, Told)
    assert course.race.worst.shape == (2,)
    assert (course.race.worst > 1000.0).all()


def test_of_objects_like_these_a_whole_object_may_be_lost(tmp_path: Path) -> None:
    """What a replicate may score is known to a race from the priors of its first rung."""
    plan, store = plan_of(tmp_path, SMALL), Store(tmp_path)
    store.open_for(plan, None, "cpu")
    units, most = RaceUnits(plan, store, "chamfer_mm", "like-these"), 0.0
    for unit in units.units([(0, 0, 2)]):
        rows = run_units(fake_episodes.given_episodes, [unit], "cpu")[0]
        rows["prior_chamfer_mm"] += 20.0
        most = max(most, float(rows["prior_chamfer_mm"].max()))
        write_files(store.path(unit), unit.id, rows)
    units.scores([(0, 0, 2)])
    assert np.array_equal(units.worst, [most])
    assert np.array_equal(RaceUnits(plan, store, "iou", "like-these").worst, [0.0])


@pytest.mark.parametrize(("over", "cap"), [("these", None), ("like-these", None), ("these", 40.0)])
def test_failures_of_all_rungs_count_as_the_worst_that_is_known_by_now(
        tmp_path: Path, over: str, cap: float | None) -> None:
    """A failure kept what it counted as in its own rung: two of the same entry counted 9 and
    60 mm, and early ones were cheap."""
    text = SMALL.replace("= 70", "= 4").replace(
        '"block", "wedge"', ", ".join(f'"{name}"' for name in OBJECTS))
    plan, store = plan_of(tmp_path, text), Store(tmp_path)
    store.open_for(plan, None, "cpu")
    rules = Rules(1e-6, start=4, everyone=True, bounds=None if cap is None else (0.0, cap))
    course = Course(Race(2, rules), RaceUnits(plan, store, "chamfer_mm", over))
    scores: dict[str, dict[str, list[float]]] = {"ring6": {}, "mine": {}}
    units = course.further()
    for rung in range(2):
        assert units
        for unit in units:
            rows = run_units(fake_episodes.given_episodes, [unit], "cpu")[0]
            count = len(rows["status"])
            errors = np.random.default_rng(int(unit.id[:8], 16)).gamma(2.0, 5.0, count)
            if unit.cell.strategy.name == "mine":
                errors[::2] = np.nan
            elif rung == 1:
                errors[-1] = 60.0
            rows |= {"chamfer_mm": errors, "status": np.full(count, "ok", object)}
            write_files(store.path(unit), unit.id, rows)
            own = scores[unit.cell.strategy.name].setdefault(unit.cell.object_name, [])
            own += [*errors, *rows["prior_chamfer_mm"] * 1j]  # of priors the worst counts alone
        units = course.further()
    expected = []
    for of_objects in scores.values():
        means = []
        for name in scores["ring6"]:
            every = np.array([*scores["ring6"][name], *scores["mine"][name]])
            worst = np.nanmax([np.nanmax(every.real), every.imag.max()])
            own = np.array([v.real for v in of_objects[name] if not v.imag])
            means.append(np.minimum(np.where(np.isnan(own), worst, own), cap or np.inf).mean())
        expected.append(np.mean(means))
    assert course.race.means == pytest.approx(expected)


OBJECTS = ("block", "wedge", "funnel", "lightbulb", "wine_bottle", "beer_bottle", "coke_bottle",
           "orangina_bottle", "large_cylinder", "small_cylinder")
