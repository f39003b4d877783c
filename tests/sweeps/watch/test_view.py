"""What is shown of a sweep and of a race: against leaderboard and race.csv; nothing is written."""

import csv
import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from curved_episodes import wide_study, wide_text
from fake_episodes import cell_by_cell, rows_of, run_episodes
from scipy.stats import t
from studies import fill, plan_of, write_spec

from sweeps.analysis.curves import mean_curve, read_curves
from sweeps.analysis.leaderboard import make_leaderboard
from sweeps.cli import main as cli
from sweeps.run import worker
from sweeps.run.race_record import read_race_note
from sweeps.run.store import Store
from sweeps.run.store import plan_of as stored_plan
from sweeps.run.unit_file import Columns, write_files
from sweeps.run.worker import run_units
from sweeps.spec.cell import Cell
from sweeps.spec.errors import StoreError
from sweeps.watch.any_time import alpha_of, mean_over_objects
from sweeps.watch.mean_error import mean_errors
from sweeps.watch.state import Row, State, faults_of
from sweeps.watch.terminal import _cells, _ends, as_text
from sweeps.watch.view import View

SPEC = """\
schema = 1
seed = 7
episodes_per_cell = 130
objects = ["block", "wedge", "funnel"]
""" + "".join(f"""[[strategy]]
name = "{name}"
waypoints = {{ kind = "ring", count = 6 }}
""" for name in ("ant", "bee", "horse", "elephant"))


def snapshot(folder: Path) -> dict[str, tuple[int, bytes]]:
    """All files below a folder, with their times and bytes; locks come and go."""
    return {str(file): (file.stat().st_mtime_ns, file.read_bytes())
            for file in sorted(folder.rglob("*")) if file.is_file()}


@pytest.mark.parametrize("metric", ["chamfer_mm", "iou"])
def test_a_finished_sweep_is_its_leaderboard(tmp_path: Path, metric: str) -> None:
    plan = plan_of(tmp_path / "spec", SPEC)
    store = fill(tmp_path / "out", plan)
    state = View(tmp_path / "out", metric).state()
    board = [dict(zip(made.header, row, strict=True))
             for made in [make_leaderboard(plan, [store], metric)] for row in made.rows]
    ranked = [row for row in board if row["rank"] != "NA"]
    assert [row.label for row in state.rows] == [row["strategy"] for row in ranked]
    for mine, theirs in zip(state.rows, ranked, strict=True):
        assert mine.mean == pytest.approx(float(theirs[metric]), abs=6e-4)
        assert mine.touches == pytest.approx(float(theirs["touches"]), abs=0.06)
        assert mine.episodes == int(theirs["n_episodes"]) == 390
        assert mine.low is not None
        assert mine.low <= float(theirs[f"{metric}_these_low"])  # valid at every look: wider
    assert [row.verdict for row in state.rows] == ["best", "", "worse", "worse"]
    assert state.done == 1.0
    failed = sum((run_units(run_episodes, [unit], "cpu")[0]["status"] != "ok").sum()
                 for unit in plan.units())
    assert state.failures == (("fit_failed", failed),)


def test_touches_are_means_over_objects_as_in_the_leaderboard(tmp_path: Path) -> None:
    """Where units failed, they were those of the objects of which most episodes were run."""
    plan = plan_of(tmp_path / "spec", SPEC.replace("= 130", "= 70"))
    store = fill(tmp_path / "out", plan)
    for unit in plan.units():
        if unit.cell.object_name == "wedge" and unit.start == 0:
            store.path(unit).unlink()
            store.log(unit).write_text("it failed")
    board = make_leaderboard(plan, [store])
    theirs = {row[1]: float(row[board.header.index("touches")]) for row in board.rows}
    for row in View(tmp_path / "out", "chamfer_mm").state().rows:
        assert row.touches == pytest.approx(theirs[row.label], abs=0.006)


@pytest.mark.parametrize("command", [("sweep",), ("race", "--within", "0.3")])
def test_what_is_wrong_with_a_strategy_is_said(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]) -> None:
    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:faulty_episodes")
    spec, out = write_spec(tmp_path, SPEC.replace("= 130", "= 4")), tmp_path / "out"
    assert cli.run([command[0], str(spec), "-o", str(out), *command[1:]]) == 0
    state = View(out, "chamfer_mm").state()
    assert state.kind == command[0]
    assert state.faults == ("strategy horse failed: no horse knows how",)
    assert state.faults[0] in _ends(state)
    if state.kind == "sweep":
        store = Store(out)
        assert state.faults[0] in make_leaderboard(stored_plan(store), [store]).notes


def test_many_strategies_at_fault_are_counted() -> None:
    told = faults_of({f"s{n}": "no" for n in range(10)})
    assert len(told) == 9
    assert told[-1].startswith("and 2 more, ")


def test_a_single_other_is_no_plural(tmp_path: Path) -> None:
    wide_study(tmp_path, wide_text(2, 1, 4))
    state = View(tmp_path, "chamfer_mm").state()
    near = sum(row.verdict != "worse" for row in state.rows) - 1
    assert state.headline.endswith(f" is first; {near} of 1 other cannot be told from it")


def test_intervals_are_students_at_a_look_of_many(tmp_path: Path) -> None:
    plan = plan_of(tmp_path / "spec", SPEC)
    fill(tmp_path / "out", plan)
    row = View(tmp_path / "out", "touches").state().rows[0]
    cells = [np.concatenate([run_units(run_episodes, [unit], "cpu")[0]["touches"]
                             for unit in plan.units() if unit.cell.strategy.name == row.label
                             and unit.cell.object_name == name]).astype(float)
             for name in ("block", "wedge", "funnel")]
    parts = [cell.var(ddof=1) / 130 / 9 for cell in cells]
    freedom = sum(parts) ** 2 / sum(part**2 / 129 for part in parts)
    half = t.isf(0.05 / 9 / 2, freedom) * np.sqrt(sum(parts))  # 9 units of an entry
    mean = np.mean([cell.mean() for cell in cells])
    assert row.mean == pytest.approx(mean, rel=1e-5)
    assert (row.low, row.high) == pytest.approx((mean - half, mean + half), rel=1e-5)


def test_every_look_of_a_sweep_holds_together() -> None:
    """Ten looks at a growing mean: intervals of each alone fail, these hold."""
    rng = np.random.default_rng(2)
    failed = np.zeros(2)
    for _ in range(600):
        drawn = rng.normal(0.0, 1.0, (2, 320))
        looks = [mean_over_objects([drawn[0, :32 * n], drawn[1, :32 * n]]) for n in range(1, 11)]
        for n, alpha in enumerate((0.05, alpha_of(10))):
            failed[n] += any(abs(mean.value) > mean.half_width(alpha) for mean in looks)
    assert failed[1] / 600 < 0.05 < failed[0] / 600


def test_a_look_while_units_come_reads_only_what_is_new(tmp_path: Path) -> None:
    plan = plan_of(tmp_path / "spec", SPEC)
    out = tmp_path / "out"
    store = Store(out)
    store.open_for(plan, None, "cpu")
    units = list(plan.units())
    view = View(out, "chamfer_mm")
    assert view.state().headline == "no unit is finished yet"
    for unit in units[:14]:
        write_files(store.path(unit), unit.id, run_units(run_episodes, [unit], "cpu")[0])
    view._due = 0.0
    state = view.state()
    assert dict(state.facts)["units"] == f"14 of {len(units)}"
    assert view.sweep is not None
    known = dict(view.sweep.reader.known)
    assert len(known) == 14
    assert any("met different objects" in text for text in state.notes)
    for unit in units[14:]:
        write_files(store.path(unit), unit.id, run_units(run_episodes, [unit], "cpu")[0])
    view._due = 0.0
    assert view.state().done == 1.0
    assert all(view.sweep.reader.known[name] is rows for name, rows in known.items())


def test_nothing_is_written_and_what_is_damaged_is_left(tmp_path: Path) -> None:
    plan = plan_of(tmp_path / "spec", SPEC)
    out = tmp_path / "out"
    store = fill(out, plan)
    units = list(plan.units())
    store.path(units[0]).write_bytes(store.path(units[0]).read_bytes()[:200])
    (store.units / f".{units[1].id}.parquet.0123456789ab.tmp").write_bytes(b"half of it")
    os.replace(store.path(units[1]), store.logs / "aside")
    store.log(units[1]).write_text("strategy ant\n\nTraceback\nValueError: no such luck\n")
    before = snapshot(out)
    state = View(out, "chamfer_mm").state()
    assert snapshot(out) == before
    assert dict(state.facts)["units"] == f"{len(units) - 1} of {len(units)}"
    assert "1 damaged unit left out" in state.notes
    assert state.failed_units == ("strategy ant: ValueError: no such luck",)
    assert dict(state.failures)["unit_failed"] == 64


def test_what_failed_or_was_damaged_is_taken_in_when_it_was_run_again(tmp_path: Path) -> None:
    plan, out = plan_of(tmp_path / "spec", SPEC), tmp_path / "out"
    store = fill(out, plan)
    expected = View(out, "chamfer_mm").state()
    first, second = list(plan.units())[:2]
    good = {unit.id: store.path(unit).read_bytes() for unit in (first, second)}
    store.path(first).unlink()
    store.log(first).write_text("strategy ant\n\nValueError: no such luck\n")
    store.path(second).write_bytes(good[second.id][:200])
    view = View(out, "chamfer_mm")
    assert dict(view.state().failures)["unit_failed"] == 64
    store.log(first).unlink()
    view._due = 0.0
    state = view.state()  # a run tries it again just now
    assert "unit_failed" not in dict(state.failures)
    assert dict(state.facts)["units"] == f"{plan.unit_count - 2} of {plan.unit_count}"
    for unit in (first, second):
        store.path(unit).write_bytes(good[unit.id])
    view._due = 0.0
    state = view.state()
    assert state.notes == ()
    assert state == expected


def test_looks_take_less_than_a_hundredth_of_the_time(tmp_path: Path,
                                                      monkeypatch: pytest.MonkeyPatch) -> None:
    fill(tmp_path / "out", plan_of(tmp_path / "spec", SPEC))
    view = View(tmp_path / "out", "chamfer_mm")
    now, worked = [100.0], [0.0]
    monkeypatch.setattr("sweeps.watch.view.time.monotonic", lambda: now[0])
    monkeypatch.setattr("sweeps.watch.view.time.process_time", lambda: worked[0])
    looked = view._look

    def costly() -> object:
        worked[0] += 0.25
        return looked()

    monkeypatch.setattr(view, "_look", costly)
    for _ in range(3000):
        view.state()
        now[0] += 0.1
    assert worked[0] <= 0.01 * 300 + 0.25
    assert worked[0] > 0.008 * 300


def test_curves_are_those_of_the_report(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 3, 8))
    state = View(tmp_path, "chamfer_mm").state()
    found = read_curves(plan, [store])
    assert len(state.curves) == 2
    for label, points in state.curves:
        entry = found.labels.index(label)
        grid = np.array([at for at, _ in points])
        expected = mean_curve(found, "touches", entry, grid).value
        assert [error for _, error in points] == pytest.approx(expected.tolist(), abs=1e-3)


def test_a_curve_has_every_fit_of_its_episodes_beside_a_longer_one() -> None:
    short = [(np.array([8.0, 16.0, 24.0]), np.array([9.0, 7.0, 5.0])),
             (np.array([8.0, 17.0]), np.array([9.0, 3.0]))]
    at = np.arange(1.0, 601.0)
    one, long = mean_errors([{"block": short}, {"block": [(at, 600.0 / at)]}])
    assert one == [(8.0, 9.0), (16.0, 8.0), (17.0, 5.0), (24.0, 4.0)]
    assert (long[0], long[-1]) == ((1.0, 600.0), (600.0, 1.0))
    assert len(long) == 64


def test_episodes_that_were_fitted_once_have_no_curve() -> None:
    once = (np.array([30.0]), np.array([4.0]))
    assert mean_errors([{"block": [once, once]}, {}]) == [[], []]
    assert mean_errors([]) == []


def test_a_race_of_what_is_to_be_more_is_its_csv(tmp_path: Path,
                                                 monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:run_episodes")
    out = tmp_path / "out"
    assert cli.run(["race", str(write_spec(tmp_path, SPEC)), "-o", str(out), "--within", "0.05",
                    "--metric", "iou"]) == 0
    first, *others = View(out, "iou").state().rows
    best, *rows = csv.DictReader((out / "race.csv").read_text().splitlines())
    assert first.mean == pytest.approx(float(best["iou"]), abs=6e-5)
    assert rows
    for mine, theirs in zip(others, rows, strict=True):
        assert mine.mean == mine.low == pytest.approx(float(theirs["iou"]), abs=6e-5)
        assert mine.high == pytest.approx(
            first.mean - float(theirs["worse_by_at_least"]), abs=2e-4)


def test_a_race_is_its_csv(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                           capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:run_episodes")
    spec, out = write_spec(tmp_path, SPEC), tmp_path / "out"
    assert cli.run(["race", str(spec), "-o", str(out), "--within", "0.3"]) == 0
    before = snapshot(out)
    state = View(out, "iou").state()
    assert snapshot(out) == before
    rows = list(csv.DictReader((out / "race.csv").read_text().splitlines()))
    assert [row.label for row in state.rows] == [row["strategy"] for row in rows]
    assert [row.verdict for row in state.rows] == [row["verdict"] for row in rows]
    for mine, theirs in zip(state.rows, rows, strict=True):
        assert mine.mean == pytest.approx(float(theirs["chamfer_mm"]), abs=6e-4)
        assert mine.behind == pytest.approx(float(theirs["worse_by"]), abs=6e-4)
        assert mine.low == pytest.approx(
            state.rows[0].mean + float(theirs["worse_by_at_least"]), abs=2e-3)
        assert mine.episodes == int(theirs["n_episodes"])
    assert state.rungs[0] == (8, 4)
    assert state.rungs[-1][0] == max(int(row["n_episodes"]) for row in rows) // 3
    note = read_race_note(out / "logs")
    assert note is not None
    assert sum(note["statuses"].values()) == sum(row.episodes for row in state.rows)
    assert json.loads(View(out, "iou").json())["kind"] == "race"
    told = as_text(state) + "".join(str(_cells(row)[5]) for row in state.rows)
    assert "tied" not in told  # such an entry may be far behind
    assert "not better" in told
    capsys.readouterr()
    assert cli.run(["report", str(out), "-o", str(tmp_path / "r.html")]) == 3
    assert "holds a race, whose outcome is in its race.csv" in capsys.readouterr().err


def test_a_mean_is_no_end_of_a_one_sided_bound_as_text() -> None:
    bounded = Row("s", 8.5, 6.0, 8.5, 0.1, "tied", 87, 3, 28.0)
    assert _cells(bounded, True)[1:4] == ("8.500", "6.000", "NA")
    assert _cells(replace(bounded, low=8.5, high=9.0), True)[1:4] == ("8.500", "NA", "9.000")
    assert _cells(replace(bounded, low=8.5), True)[2:4] == ("NA", "NA")  # the first
    assert _cells(replace(bounded, low=8.5), False)[2:4] == ("8.500", "8.500")  # all episodes agree
    race = State("race", "r", False, "", (), 1.0, "chamfer_mm", "", (bounded,), 0)
    assert any("the other side has no bound" in line for line in _ends(race))
    assert not any("no bound" in line for line in _ends(replace(race, kind="sweep")))


@pytest.mark.slow
def test_what_was_worked_on_last_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                          capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:run_episodes")
    text = SPEC.replace("= 130", "= 4")
    spec, out = write_spec(tmp_path, text), tmp_path / "out"

    def status() -> dict[str, object]:
        capsys.readouterr()
        assert cli.run(["status", str(out), "--json"]) == 0
        return json.loads(capsys.readouterr().out)

    race = ["race", str(spec), "-o", str(out), "--within", "0.3"]
    assert cli.run(race) == 0
    view, files = View(out, "chamfer_mm"), len(list((out / "units").iterdir()))
    assert view.state().kind == "race"
    found = status()
    assert found["race"] == "decided"
    assert (found["units"], found["done"], found["left"]) == (None, files, None)
    assert cli.run(["sweep", str(spec), "-o", str(out)]) == 0
    view._due = 0.0
    assert (view.state().kind, view.state().done) == ("sweep", 1.0)
    found = status()
    assert "race" not in found
    assert (found["units"], found["done"], found["other_files"]) == (12, 12, files)
    assert cli.run(race) == 0
    view._due = 0.0
    assert view.state().kind == "race"
    assert cli.run(["sweep", str(spec), "-o", str(out), "--until", "50"]) == 0
    view._due = 0.0
    assert view.state().kind == "sweep"


def test_a_race_before_its_first_rung_is_a_race(tmp_path: Path) -> None:
    plan = plan_of(tmp_path / "spec", SPEC)
    store = Store(tmp_path / "out")
    store.open_for(plan, None, "cpu")
    (store.logs / "race.json").write_text(json.dumps(
        {"metric": "chamfer_mm", "over": "these", "rungs": [], "entries": []}))
    state = View(tmp_path / "out", "chamfer_mm").state()
    assert (state.kind, state.rows) == ("race", ())
    assert dict(state.facts)["state"] == "stopped in rung 1"
    for damaged in ("[]", "{", '{"metric": 1, "over": 2, "rungs": [{}], "entries": [{}]}'):
        (store.logs / "race.json").write_text(damaged)
        assert View(tmp_path / "out", "chamfer_mm").state().kind == "sweep"


def test_a_folder_without_a_study_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="holds no study"):
        View(tmp_path, "chamfer_mm")


def test_equal_entries_have_the_order_of_the_leaderboard(tmp_path: Path) -> None:
    plan = plan_of(tmp_path / "spec", SPEC)

    def alike(cell: object, episodes: np.ndarray, device: str) -> dict[str, np.ndarray]:
        return {"episode": episodes, "status": np.full(len(episodes), "ok", object),
                "chamfer_mm": 4.0 + 0.01 * (episodes % 7), "iou": np.full(len(episodes), 0.5),
                "touches": np.full(len(episodes), 8), "robot_time_s": np.full(len(episodes), 50.0)}

    store = fill(tmp_path / "out", plan, cell_by_cell(alike))
    board = make_leaderboard(plan, [store])
    shown = [row.label for row in View(tmp_path / "out", "chamfer_mm").state().rows]
    assert shown == ["ant", "bee", "elephant", "horse"]
    assert shown == [row[board.header.index("strategy")] for row in board.rows][:4]


def test_worse_takes_a_look_at_an_equal_share_of_all_ordered_pairs(tmp_path: Path) -> None:
    """Differences of 1 mm more or less, whose standard error is known."""
    plan = plan_of(tmp_path / "spec", SPEC.replace("= 130", "= 64"))
    least = t.isf(0.05 / 3 / (4 * 3), 3 * 63) / np.sqrt(3 * 63)  # one-sided, of three looks
    ahead = {"ant": 0.0, "bee": 0.97 * least, "horse": 1.03 * least, "elephant": 4.0}

    def apart(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
        luck = (2.0 * (episodes % 2) - 1.0) * (cell.strategy.name != "ant")
        return rows_of(cell, episodes) | {
            "chamfer_mm": 5.0 + ahead[cell.strategy.name] + luck}

    fill(tmp_path / "out", plan, cell_by_cell(apart))
    rows = View(tmp_path / "out", "chamfer_mm").state().rows
    assert [(row.label, row.verdict) for row in rows] == [
        ("ant", "best"), ("bee", ""), ("horse", "worse"), ("elephant", "worse")]
    assert [row.behind for row in rows] == pytest.approx([*ahead.values()], rel=1e-5)
