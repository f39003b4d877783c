import csv
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import fake_episodes
import numpy as np
import pytest
from studies import SMALL, fill, plan_of

from sweeps.analysis import leaderboard
from sweeps.analysis.confusion import read_confusion
from sweeps.analysis.entries import LeaderboardError
from sweeps.analysis.leaderboard import Leaderboard, make_leaderboard
from sweeps.analysis.paired import read_paired
from sweeps.analysis.pairs import pairs_table
from sweeps.run.plan import Plan
from sweeps.run.store import Store
from sweeps.spec.cell import Cell
from warpgrasp.objects.catalogue_names import NO_ANSWER
from warpgrasp.parameters import RecognitionTable, SensorTable

COLUMNS = ("rank,strategy,chamfer_mm,chamfer_mm_ci_low,chamfer_mm_ci_high,delta_to_best_mm,"
           "delta_ci_low,delta_ci_high,p_best,iou,iou_ci_low,iou_ci_high,recognized,touches,"
           "robot_time_s,failure_rate,contacts,n_objects,n_episodes,chamfer_mm_these_low,"
           "chamfer_mm_these_high,delta_these_low,delta_these_high,worse_than_prior")
SWEPT = SMALL + """
[sweep.grid]
"sensors.tendon_threshold_N" = [3, 6.0]
[sweep.sobol]
n = 3
"object.yaw_deg" = { low = -180, high = 180 }
"""


def rows_of(board: Leaderboard) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(board.csv().decode())))


def test_columns_and_values(tmp_path: Path) -> None:
    plan = plan_of(tmp_path)
    store = fill(tmp_path, plan)
    board = make_leaderboard(plan, [store])
    assert board.csv().decode().splitlines()[0] == COLUMNS
    first, second = rows_of(board)
    assert (first["rank"], first["strategy"], second["strategy"]) == ("1", "mine", "ring6")
    assert (first["n_objects"], first["n_episodes"]) == ("2", "140")
    assert (first["delta_to_best_mm"], first["delta_ci_low"]) == ("0.000", "0.000")
    assert 0 < float(second["delta_these_low"]) <= float(second["delta_to_best_mm"])
    assert float(second["delta_ci_low"]) <= float(second["delta_to_best_mm"])
    assert make_leaderboard(plan, [store]).csv() == board.csv()
    assert "hardly known below 6" in board.notes[0]
    # by hand: failures at the object's worst, recognized and failures over all episodes
    seen = {(u.cell.object_name, u.cell.strategy.name): [] for u in plan.units()}
    for unit in plan.units():
        seen[unit.cell.object_name, unit.cell.strategy.name].append(store.read(unit))
    chamfer, known, failed = [], [], []
    for body in ("block", "wedge"):
        worst = max(np.nanmax(rows["chamfer_mm"]) for name in ("mine", "ring6")
                    for rows in seen[body, name])
        rows = {key: np.concatenate([part[key] for part in seen[body, "mine"]])
                for key in seen[body, "mine"][0]}
        chamfer.append(np.nan_to_num(rows["chamfer_mm"], nan=worst).mean())
        known.append((rows["recognized_as"] == body).mean())
        failed.append((rows["status"] != "ok").mean())
    assert first["chamfer_mm"] == f"{np.mean(chamfer):.3f}"
    assert first["recognized"] == f"{np.mean(known):.4f}"
    assert first["failure_rate"] == f"{np.mean(failed):.4f}"


def test_grid_tells_entries_apart_and_samples_are_averaged(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, SWEPT)
    store = fill(tmp_path, plan)
    rows = rows_of(make_leaderboard(plan, [store]))
    assert {row["strategy"] for row in rows} == {
        f"{name} [sensors.tendon_threshold_N={value}]"
        for name in ("ring6", "mine") for value in ("3", "6")}
    assert {row["n_episodes"] for row in rows} == {"420"}
    pooled = rows_of(make_leaderboard(plan, [store], by=["strategy"]))
    assert [row["strategy"] for row in pooled] == ["mine", "ring6"]
    assert {row["n_episodes"] for row in pooled} == {"840"}
    assert len(make_leaderboard(plan, [store], by=["object.yaw_deg"]).rows) == 6


def test_ranking_each_object_by_itself(tmp_path: Path) -> None:
    plan = plan_of(tmp_path)
    rows = rows_of(make_leaderboard(plan, [fill(tmp_path, plan)], by=["strategy", "object"]))
    assert [(row["rank"], row["strategy"]) for row in rows] == [
        ("1", "mine [object=block]"), ("2", "ring6 [object=block]"),
        ("1", "mine [object=wedge]"), ("2", "ring6 [object=wedge]")]
    assert {row["n_objects"] for row in rows} == {"1"}


def test_other_metrics_rank_the_right_way_round(tmp_path: Path) -> None:
    plan = plan_of(tmp_path)
    store = fill(tmp_path, plan)
    board = make_leaderboard(plan, [store], metric="iou")
    assert board.header[2:6] == ("iou", "iou_ci_low", "iou_ci_high", "delta_to_best")
    values = [float(row["iou"]) for row in rows_of(board)]
    assert values == sorted(values, reverse=True)
    for metric in ("recognized", "touches"):
        assert make_leaderboard(plan, [store], metric=metric).header.count(metric) == 1


def test_what_cannot_be_made_is_told(tmp_path: Path) -> None:
    plan = plan_of(tmp_path)
    with pytest.raises(LeaderboardError, match=r"did you mean chamfer_mm\?"):
        make_leaderboard(plan, [Store(tmp_path)], metric="chamfer")
    with pytest.raises(LeaderboardError, match=r"did you mean object\?"):
        make_leaderboard(plan, [Store(tmp_path)], by=["objects"])


def test_missing_units_leave_out_the_block_for_all(tmp_path: Path) -> None:
    plan = plan_of(tmp_path)
    store = fill(tmp_path, plan)
    store.path(next(plan.units())).unlink()
    board = make_leaderboard(plan, [store])
    assert {row["n_episodes"] for row in rows_of(board)} == {"76"}
    assert "1 of 8 units are missing" in board.notes[0]
    for file in store.units.iterdir():
        file.unlink()
    empty = rows_of(make_leaderboard(plan, [store]))
    assert {row["chamfer_mm"] for row in empty} == {"NA"}
    assert {row["rank"] for row in empty} == {""}


def failed_on(plan: Plan, store: Store, body: str, strategies: Sequence[str]) -> None:
    """Sets the units of some strategies on an object aside as failed."""
    store.logs.mkdir(exist_ok=True)
    for unit in plan.units():
        if unit.cell.object_name == body and unit.cell.strategy.name in strategies:
            store.path(unit).unlink()
            store.log(unit).write_text("hung")


def test_an_object_on_which_every_entry_failed_is_left_out_and_told(tmp_path: Path) -> None:
    plan = plan_of(tmp_path)
    store = fill(tmp_path, plan)
    alone = rows_of(make_leaderboard(plan, [store], by=["strategy", "object"]))[2:]
    failed_on(plan, store, "block", ("mine", "ring6"))
    board = make_leaderboard(plan, [store])
    told = "no entry has any chamfer_mm on block, where all of them failed"
    assert any(told in line for line in board.notes)
    for row, other in zip(rows_of(board), alone, strict=True):
        assert (row["n_objects"], row["n_episodes"]) == ("1", "70")
        for column in ("chamfer_mm", "chamfer_mm_these_low", "touches"):
            assert row[column] == other[column]
        rate = (1.0 + float(other["failure_rate"])) / 2
        assert float(row["failure_rate"]) == pytest.approx(rate, abs=1e-4)
    paired = read_paired(plan, [store], ["chamfer_mm"])
    assert paired.objects == ("block", "wedge")
    assert paired.over == "these"
    assert pairs_table(paired, "chamfer_mm").rows[0][7] in ("0/1", "1/1")
    assert any(told in line for line in paired.notes)
    # of a share a failure is 0, on whatever object
    by_iou = rows_of(make_leaderboard(plan, [store], metric="iou"))
    for row, other in zip(by_iou, alone, strict=True):
        assert row["n_objects"] == "2"
        assert float(row["iou"]) == pytest.approx(float(other["iou"]) / 2, abs=1e-4)
    assert [row["iou"] for row in rows_of(board)] == [row["iou"] for row in by_iou]


def test_an_entry_that_always_failed_on_an_object_is_told(tmp_path: Path) -> None:
    """All of its episodes count as the same worst: the interval there has no width."""
    plan = plan_of(tmp_path)
    store = fill(tmp_path, plan)
    assert not any("takes for certain" in line for line in make_leaderboard(plan, [store]).notes)
    failed_on(plan, store, "wedge", ("mine",))
    for metric in ("chamfer_mm", "iou"):
        notes = make_leaderboard(plan, [store], metric=metric).notes
        assert [line for line in notes if "takes for certain" in line] == [
            f"mine: all episodes on wedge count as the same worst {metric}, which its interval of "
            "these objects takes for certain"]
    made = make_leaderboard(plan, [store], by=["strategy", "object"])
    row = next(row for row in rows_of(made) if row["strategy"] == "mine [object=wedge]")
    assert row["chamfer_mm_these_low"] == row["chamfer_mm_these_high"]
    by_answer = make_leaderboard(plan, [store], metric="recognized")  # Wilson's has a width
    assert not any("takes for certain" in line for line in by_answer.notes)


def test_what_is_not_offered_is_na(tmp_path: Path) -> None:
    @fake_episodes.cell_by_cell
    def few(cell: Cell, episodes: np.ndarray, device: str) -> dict[str, np.ndarray]:
        return {"status": np.full(len(episodes), "ok"),
                "chamfer_mm": np.full(len(episodes), 2.0)}

    plan = plan_of(tmp_path)
    for row in rows_of(make_leaderboard(plan, [fill(tmp_path, plan, few)])):
        assert row["recognized"] == row["touches"] == "NA"
        assert row["chamfer_mm"] == row["chamfer_mm_ci_low"] == "2.000"
        assert row["iou"] == "NA"
        assert row["p_best"] == "0.500"


def test_failing_is_neither_cheap_nor_left_out(tmp_path: Path) -> None:
    """A strategy at fault from the start costs as much as any, and has named no object rightly."""
    @fake_episodes.cell_by_cell
    def some(cell: Cell, episodes: np.ndarray, device: str) -> dict[str, np.ndarray]:
        fails = cell.strategy.name == "mine"
        return {"status": np.full(len(episodes), "strategy_failed" if fails else "ok"),
                "robot_time_s": np.full(len(episodes), 0.0 if fails else 20.0),
                "recognized_as": np.full(len(episodes), "" if fails else cell.object_name),
                "recognized": np.full(len(episodes), not fails)}

    plan = plan_of(tmp_path)
    store = fill(tmp_path, plan, some)
    found = {row["strategy"]: row for row in rows_of(
        make_leaderboard(plan, [store], metric="robot_time_s"))}
    assert found["mine"]["robot_time_s"] == found["ring6"]["robot_time_s"] == "20.000"
    assert found["mine"]["recognized"] == "0.0000"
    assert found["ring6"]["recognized"] == "1.0000"
    told = read_confusion(plan, [store])
    assert told.counts["mine", "block"] == {NO_ANSWER: told.counts["ring6", "block"]["block"]}


def test_a_setting_that_changes_nothing_leaves_the_intervals(tmp_path: Path) -> None:
    """An episode averaged over settings is one episode, not one for each setting."""
    text = SMALL.replace('"block", "wedge"', '"block"') + """
[sweep.grid]
"object.yaw_deg" = [0, 10, 20, 30]
"""
    plan = plan_of(tmp_path, text)  # the stand-in does not care for the yaw
    store = fill(tmp_path, plan)
    apart = rows_of(make_leaderboard(plan, [store]))
    (mine, ring6) = rows_of(make_leaderboard(plan, [store], by=["strategy"]))
    for averaged in (mine, ring6):
        for alone in apart:
            if alone["strategy"].startswith(averaged["strategy"]):
                same = ("chamfer_mm", "chamfer_mm_these_low", "chamfer_mm_these_high",
                        "iou_ci_low", "iou_ci_high")
                assert [alone[key] for key in same] == [averaged[key] for key in same]
    assert float(mine["chamfer_mm_these_high"]) - float(mine["chamfer_mm_these_low"]) > 0.3


def test_few_episodes_are_few_however_many_points_they_are_averaged_over(tmp_path: Path) -> None:
    text = SWEPT.replace('"block", "wedge"', '"block"').replace("cell = 70", "cell = 12")
    plan = plan_of(tmp_path, text)
    board = make_leaderboard(plan, [fill(tmp_path, plan)])
    assert {row["n_episodes"] for row in rows_of(board)} == {"36"}
    assert any(line.startswith("one object, 12 episodes in all: below 48") for line in board.notes)


@pytest.mark.parametrize(("episodes", "told"), [(1, False), (8, True), (23, True), (24, False)])
def test_few_episodes_of_several_objects_are_told(tmp_path: Path, episodes: int,
                                                  told: bool) -> None:
    """Of three objects with eight episodes, a few of them bad, intervals held in 76 %."""
    plan = plan_of(tmp_path, SMALL.replace("cell = 70", f"cell = {episodes}"))
    store = fill(tmp_path, plan)
    for notes in (make_leaderboard(plan, [store]).notes,
                  read_paired(plan, [store], ["chamfer_mm"]).notes):
        assert told == any(f"2 objects, {2 * episodes} episodes in all: below 48" in line
                           for line in notes)


def test_one_object_finished_of_two_has_the_interval_of_its_episodes(tmp_path: Path) -> None:
    plan = plan_of(tmp_path)
    store = fill(tmp_path, plan)
    whole = rows_of(make_leaderboard(plan, [store], by=["strategy", "object"]))
    for unit in plan.units():
        if unit.cell.object_name == "wedge":
            store.path(unit).unlink()
    board = make_leaderboard(plan, [store])
    for row, alone in zip(rows_of(board), whole, strict=False):
        for key in ("chamfer_mm_these_low", "chamfer_mm_these_high", "delta_these_low"):
            assert row[key] == alone[key]
        assert float(row["chamfer_mm_these_low"]) < float(row["chamfer_mm_these_high"])
        assert row["chamfer_mm_ci_low"] == row["iou_ci_high"] == "NA"  # one object of many
    assert "the ranking is of one object" in board.notes[1]


def test_a_study_of_which_no_object_is_finished_says_that_nothing_can_be_compared(
        tmp_path: Path) -> None:
    plan = plan_of(tmp_path)
    store = fill(tmp_path, plan)
    for unit in plan.units():
        if unit.cell.strategy.name == "mine":
            store.path(unit).unlink()
    for notes in (make_leaderboard(plan, [store]).notes,
                  read_paired(plan, [store], ["chamfer_mm"]).notes):
        assert "no object has a value of every entry: nothing can be compared" in notes
        assert not any("0 objects" in line for line in notes)


def test_notes_say_of_how_many_episodes_they_are() -> None:
    faults = leaderboard._Faults()
    faults(SimpleNamespace(label="ring6"), {  # pyright: ignore
        "status": np.array(["ok", "ok", "strategy_failed", "ok"]),
        "note": np.array(["", "4 of 5 stops", "no such path", "3 of 3 stops"]),
        "contacts": np.array([3, 4, 0, 5]), "object": np.array(["block"] * 4)})
    assert faults.notes() == ["strategy ring6 failed: no such path", "strategy ring6: 2 of 4 "
                              "episodes have a note; the first: 4 of 5 stops"]


def test_one_body_under_two_names_is_told(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, SMALL.replace('"wedge"', '{ object = "block", name = "again" }'))
    note = ("block and again are the same body, so that their episodes are the same; intervals "
            "take them for two objects")
    assert note in make_leaderboard(plan, [fill(tmp_path, plan)]).notes


def test_entries_that_did_the_same_are_told(tmp_path: Path) -> None:
    """As where hands are compared, and a swept threshold is one of another hand."""
    @fake_episodes.cell_by_cell
    def one_does_not_read_it(cell: Cell, episodes: np.ndarray, device: str
                             ) -> dict[str, np.ndarray]:
        read = cell if cell.strategy.name == "mine" else replace(cell, sensors=SensorTable())
        rows = fake_episodes.rows_of(read, episodes)
        return {**rows, "touches": rows["touches"] + round(read.sensors.tendon_threshold_N)}

    plan = plan_of(tmp_path, SMALL + '[sweep.grid]\n"sensors.tendon_threshold_N" = [3, 5, 7]\n')
    board = make_leaderboard(plan, [fill(tmp_path, plan, one_does_not_read_it)])
    notes = board.notes
    assert [(row["rank"], row["strategy"].partition(" ")[0]) for row in rows_of(board)] == [
        ("1", "mine"), ("2", "mine"), ("3", "mine"), ("4", "ring6"), ("4", "ring6"), ("4", "ring6")]
    assert [note for note in notes if "did the same" in note] == [
        f"ring6 [sensors.tendon_threshold_N={n}] did the same as ring6 "
        "[sensors.tendon_threshold_N=3] in every episode: what differs between them changes "
        "nothing here" for n in (5, 7)]


def test_entries_that_recognize_otherwise_did_not_do_the_same(tmp_path: Path) -> None:
    @fake_episodes.cell_by_cell
    def by_way(cell: Cell, episodes: np.ndarray, device: str) -> dict[str, np.ndarray]:
        rows = fake_episodes.rows_of(replace(cell, recognition=RecognitionTable()), episodes)
        return {**rows, "recognized": np.full(len(episodes), cell.recognition.way == "as_felt")}

    plan = plan_of(tmp_path, SMALL + '[sweep.grid]\n"recognition.way" = '
                   '["as_felt", "profile", "parameters"]\n')
    notes = make_leaderboard(plan, [fill(tmp_path, plan, by_way)]).notes
    assert {note.partition(" in every")[0] for note in notes if "did the same" in note} == {
        f"{name} [recognition.way=parameters] did the same as {name} [recognition.way=profile]"
        for name in ("mine", "ring6")}
