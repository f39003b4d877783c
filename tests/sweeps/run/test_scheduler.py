"""Units of one cell that are run in one call: the same files, and no one suffers for another."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import fake_episodes
import numpy as np
import pytest
from studies import SMALL, contents, plan_of, run_in

from sweeps.run.local_engine import Options, run
from sweeps.run.plan import Plan, Unit
from sweeps.run.progress import Progress
from sweeps.run.scheduler import IN_HAND_S, MOST_EPISODES, Outcome, UnitQueue
from sweeps.run.store import Store
from sweeps.run.unit_file import Columns, encode_unit, write_unit
from sweeps.run.worker import run_units
from sweeps.spec.cell import Cell

TEXT = SMALL.replace("= 70\no", "= 1024\no").partition('[[strategy]]\nname = "mine"')[0]
UNITS = 16  # of each of two cells
MOST_UNITS = MOST_EPISODES // 64
FEW = """\
schema = 1
seed = 7
episodes_per_cell = 50
objects = ["block", "wedge", "lightbulb", "funnel", "wine_bottle", "coke_bottle"]
[[strategy]]
name = "ring6"
[[strategy]]
name = "random6"
[sweep.grid]
"sensors.tendon_threshold_N" = [3.0, 6.0]
"""
BAD = fake_episodes.BAD // 64


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    return plan_of(tmp_path_factory.mktemp("batches"), TEXT)


@pytest.fixture(scope="module")
def right(plan: Plan) -> dict[str, bytes]:
    """Files of units run one by one."""
    return {f"{unit.id}.parquet": encode_unit(unit.id, rows) for unit in plan.units()
            for rows in run_units(fake_episodes.run_episodes, [unit], "cpu")}


@pytest.fixture
def calls(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("FAKE_LOG", str(tmp_path / "calls"))
    return tmp_path / "calls"


def sizes(calls: Path, name: str) -> list[int]:
    lines = [line.split() for line in calls.read_text().splitlines()]
    return [int(units) for of, units in lines if of == name]


@pytest.mark.parametrize("workers", [1, 2])
def test_batches_give_the_files_of_units_run_one_by_one(
        tmp_path: Path, plan: Plan, right: dict[str, bytes], calls: Path, workers: int) -> None:
    assert run_in(tmp_path, plan, "batched_episodes", workers) == Outcome(done=2 * UNITS)
    assert contents(tmp_path) == right
    assert [sum(sizes(calls, name)) for name in ("block", "wedge")] == [UNITS, UNITS]
    assert max(sizes(calls, "block")) >= 4 / workers


@pytest.mark.parametrize(("how", "timeout", "told"), [
    ("raise", 60.0, "this episode is bad"),
    ("die", 60.0, "the worker died (exit code -9)"),
    pytest.param("hang", 3.5, "stopped: it took longer than 3.5 s (--unit-timeout-s)",
                 marks=pytest.mark.slow)])
def test_a_bad_unit_spoils_none_of_its_batch(
        tmp_path: Path, plan: Plan, right: dict[str, bytes], calls: Path,
        monkeypatch: pytest.MonkeyPatch, how: str, timeout: float, told: str) -> None:
    monkeypatch.setenv("FAKE_HOW", how)
    outcome = run_in(tmp_path, plan, "bad_episode", unit_timeout_s=timeout)
    assert outcome == Outcome(done=2 * UNITS - 1, failed=1)
    bad = next(unit for unit in plan.units() if unit.start == 64 * BAD)
    assert contents(tmp_path) == {
        name: content for name, content in right.items() if bad.id not in name}
    log, = (tmp_path / "logs").glob("*.failed.log")
    assert log.stem.startswith(bad.id)
    assert told in log.read_text()
    *_, spoiled = [size for size in sizes(calls, "block") if size > 1]
    tries = 1 if how == "hang" else 2
    assert sum(sizes(calls, "block")) == UNITS + spoiled + tries - 1
    assert max(sizes(calls, "wedge")) > 1  # the next cell comes in batches again


def test_batches_are_shares_of_what_is_left_and_keep_to_one_cell(
        tmp_path: Path, plan: Plan) -> None:
    work = work_of(plan, tmp_path)
    batches = []
    while batch := work.take(3):
        batches.append(batch)
        assert len({unit.cell_hash for unit in batch}) == 1
    # Thirds of what is left, of which the others are told to have nothing; eight at most, and
    # eight of each cell before the next ones of any.
    assert [len(batch) for batch in batches] == [8, 8, 5, 3, 3, 2, 1, 1, 1]
    assert [unit.id for batch in batches for unit in batch] == [unit.id for unit in plan.units()]


@pytest.mark.parametrize(("elsewhere", "most"), [(0.0, 4), (2.0, 5), (7.6, 8), (20.0, 8)])
def test_who_comes_while_others_are_busy_is_given_a_whole_share(
        tmp_path: Path, plan: Plan, elsewhere: float, most: int) -> None:
    work = work_of(plan, tmp_path)
    for _ in range(3):
        work.take()
    assert len(work.take(2, elsewhere)) == most  # of eight


def finish(work: UnitQueue, unit: Unit, seconds: float) -> None:
    """A worker has written a unit."""
    write_unit(work.store.path(unit), unit.id,
               run_units(fake_episodes.run_episodes, [unit], "cpu")[0])
    work.done(unit, seconds)


def test_a_unit_that_is_reported_without_its_file_is_not_done(tmp_path: Path, plan: Plan) -> None:
    work = work_of(plan, tmp_path)
    unit, = work.take(cold=True)
    work.done(unit, 0.1)
    assert work.outcome.done == 0
    assert work.take() == [unit]  # once more
    work.done(unit, 0.1)
    assert work.outcome.failed == 1
    finish(work, work.take(cold=True)[0], 0.1)
    work.count_files()
    assert (work.outcome.done, work.outcome.lost) == (1, plan.unit_count - 2)


def test_where_all_is_compiled_a_unit_goes_ahead_and_tells_nothing(
        tmp_path: Path, plan: Plan) -> None:
    work = work_of(plan, tmp_path)
    first = work.take(2, cold=True)
    assert len(first) == 1
    finish(work, first[0], 1000.0)
    assert len(work.take(2)) == MOST_UNITS - 1  # the rest of the cell's turn


def test_units_are_looked_for_and_not_lost(tmp_path: Path, plan: Plan) -> None:
    work = work_of(plan, tmp_path)
    assert work.at_least(3) == 3
    assert (work.running, work.over) == (0, False)
    taken = [unit.id for _ in range(5) for unit in work.take(2)]
    assert taken == [unit.id for unit in plan.units()][:len(taken)]
    assert work.running == len(taken)
    assert work_of(plan, tmp_path).at_least(100) == plan.unit_count


def test_objects_of_few_episodes_are_run_together(tmp_path: Path) -> None:
    plan = plan_of(tmp_path / "spec", FEW)
    work = work_of(plan, tmp_path)
    batches = []
    while batch := work.take():
        batches.append(batch)
        assert len({unit.cell.strategy.name for unit in batch}) == 1
        assert len({str(unit.cell.setting) for unit in batch}) == 1
    assert [len(batch) for batch in batches] == [3] * 8  # of six, five of which would do
    assert [unit for batch in batches for unit in batch] == list(plan.units())


def test_an_object_that_fails_is_run_by_itself_from_then_on(tmp_path: Path) -> None:
    work = work_of(plan_of(tmp_path / "spec", FEW), tmp_path)
    work.failed(work.take(), "no telling which")
    for unit in [unit for _ in range(3) for unit in work.take()]:
        if unit.cell.object_name == "wedge":
            work.failed([unit], "this one")
        else:
            finish(work, unit, 0.1)
    assert [unit.cell.object_name for unit in work.take()] == ["wedge"]  # its second time
    batches = [[unit.cell.object_name for unit in work.take()] for _ in range(3)]
    assert batches == [["block"], ["wedge"], ["lightbulb"]]


@pytest.mark.parametrize(("seconds", "most"), [
    (1e-9, MOST_UNITS), (IN_HAND_S / 2.5, 2), (2 * IN_HAND_S, 1)])
def test_a_batch_holds_seconds_of_work_at_most(
        tmp_path: Path, seconds: float, most: int) -> None:
    work = work_of(plan_of(tmp_path / "spec", TEXT.replace("1000", "10000")), tmp_path)
    finish(work, work.take()[0], seconds)
    assert len(work.take()) == most


def test_planners_of_ones_own_are_called_for_a_unit_at_a_time(tmp_path: Path) -> None:
    own = TEXT.replace("ring6", "any-object")
    work = work_of(plan_of(tmp_path / "spec", own), tmp_path)
    finish(work, work.take()[0], 0.001)
    assert len(work.take()) == 1


def test_planners_of_the_package_are_called_for_many_units_of_many_objects(tmp_path: Path) -> None:
    small = TEXT.replace("ring6", "random").replace("1024", "32")
    work = work_of(plan_of(tmp_path / "spec", small), tmp_path)
    assert len({unit.cell.object_name for unit in work.take()}) == 2


def test_where_a_strategy_fails_units_are_run_alone(plan: Plan) -> None:
    """The fault names a world of its batch, which must not depend on how units were handed out."""
    @fake_episodes.cell_by_cell
    def failing(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
        asked.append(len(episodes))
        bad = episodes == fake_episodes.BAD
        note = f"world {np.argmax(bad)}" if bad.any() else ""
        return {"status": np.where(bad, "strategy_failed", "ok"),
                "note": np.where(bad, note, "")}

    asked: list[int] = []
    units = list(plan.units())[BAD - 1:BAD + 2]
    together = run_units(failing, units, "cpu")
    assert asked == [192, 64, 64, 64]
    for unit, rows in zip(units, together, strict=True):
        alone, = run_units(failing, [unit], "cpu")
        assert encode_unit("a", rows) == encode_unit("a", alone)


def work_of(plan: Plan, folder: Path) -> UnitQueue:
    store = Store(folder)
    store.open_for(plan, None, "cpu")
    return UnitQueue(plan, store, (1, 1), Progress(plan.unit_count, quiet=True))


def test_folders_are_not_listed_for_each_unit(
        tmp_path: Path, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """A study of many units would spend the parent's time on it."""
    store = Store(tmp_path)
    store.open_for(plan, None, "cpu")
    left = next(plan.units())
    (store.units / f".{left.id}.parquet.0123.tmp").write_bytes(b"of a run that was killed")
    swept: list[str] = []
    monkeypatch.setattr(Store, "sweep_out", lambda self, unit: swept.append(unit.id))
    work = UnitQueue(plan, store, (1, 1), Progress(plan.unit_count, quiet=True))
    while work.take():
        pass
    assert work.exhausted
    assert swept == [left.id]


def run_steps(folder: Path, plan: Plan, function: str, workers: int,
              further: Callable[[], Sequence[Unit]]) -> Outcome:
    """Runs what is asked for in steps, and nothing else."""
    store = Store(folder)
    store.open_for(plan, None, "cpu")
    options = Options(workers, (1, 1), "cpu", f"fake_episodes:{function}")
    empty = replace(plan, study=replace(plan.study, objects=()))
    with store.lock((1, 1)), Progress(0, quiet=True) as progress:
        return run(empty, store, options, progress, further)


@pytest.mark.usefixtures("calls")
def test_a_run_in_steps_goes_on_when_all_of_a_step_is_back(tmp_path: Path, plan: Plan,
                                                           right: dict[str, bytes]) -> None:
    """Each step is asked for when the files of the last one are there; an empty one ends it."""
    units = list(plan.units())
    steps = [units[:5], units[5:6], units[6:]]
    given: list[int] = []

    def further() -> list[Unit]:
        there = Store(tmp_path).unit_ids()
        assert all(unit.id in there for step in steps[:len(given)] for unit in step)
        given.append(len(there))
        return steps[len(given) - 1] if len(given) <= len(steps) else []

    outcome = run_steps(tmp_path, plan, "batched_episodes", 2, further)
    assert outcome == Outcome(done=2 * UNITS)
    assert contents(tmp_path) == right
    assert given == [0, 5, 6, 2 * UNITS]


@pytest.mark.usefixtures("calls")
def test_a_step_whose_last_unit_fails_is_followed_by_the_next(
        tmp_path: Path, plan: Plan, monkeypatch: pytest.MonkeyPatch) -> None:
    """The worker dies of it, so that none is ready when the step is over."""
    monkeypatch.setenv("FAKE_HOW", "die")
    units = list(plan.units())
    bad = next(unit for unit in units if unit.start == 64 * BAD)
    steps = [[bad], [unit for unit in units if unit is not bad][:3], []]
    outcome = run_steps(tmp_path, plan, "bad_episode", 1, lambda: steps.pop(0))
    assert (outcome.done, outcome.failed) == (3, 1)
