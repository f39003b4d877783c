import csv
import io
import os
import shutil
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import connection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fake_episodes
import numpy as np
import pytest
from studies import SMALL, board, contents, plan_of, run_in

from sweeps.analysis.leaderboard import make_leaderboard
from sweeps.run import local_engine as runner
from sweeps.run import store as store_module
from sweeps.run.grown_units import _joined, reuse_units
from sweeps.run.local_engine import Options
from sweeps.run.plan import Plan
from sweeps.run.scheduler import Outcome
from sweeps.run.store import Store, damaged_notes
from sweeps.run.worker import run_units
from sweeps.spec.errors import Held, OtherStudy, StoreError


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Path]:
    folder = tmp_path_factory.mktemp("whole")
    plan = plan_of(folder / "spec")
    assert run_in(folder, plan) == Outcome(kept=0, done=8, failed=0)
    return plan, folder


def test_contacts_of_which_one_part_has_none_are_joined() -> None:
    """Of a hand with six joints to a finger, whose columns contacts without a row do not have."""
    some = {"episode": np.arange(2), "q5_rad": np.ones(2, np.float32)}
    for parts in ((some, {"episode": np.arange(0)}), ({"episode": np.arange(0)}, some)):
        found = _joined(*parts)
        assert {name: values.tolist() for name, values in found.items()} == {
            "episode": [0, 1], "q5_rad": [1.0, 1.0]}


@pytest.fixture
def plan_of_copy(whole: tuple[Plan, Path], tmp_path: Path) -> Plan:
    """The plan of a finished study, of which a copy lies in `tmp_path`."""
    shutil.copytree(whole[1], tmp_path, dirs_exist_ok=True)
    return whole[0]


def test_two_workers_give_the_same_bytes(whole: tuple[Plan, Path], tmp_path: Path) -> None:
    plan, folder = whole
    run_in(tmp_path, plan, workers=2)
    assert contents(tmp_path) == contents(folder)
    assert board(plan, tmp_path) == board(plan, folder)


def test_a_run_ends_with_its_last_unit(
    whole: tuple[Plan, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lone worker that had all that was left was waited for once more, for a second."""
    heard: list[int] = []

    def wait(pipes: list[Any], timeout: float) -> list[Any]:
        ready = connection.wait(pipes, timeout)
        heard.append(len(ready))
        return ready

    monkeypatch.setattr(runner, "wait", wait)
    run_in(tmp_path, whole[0])
    assert heard[-1] == 1


def test_shards_merge_to_the_same_bytes(whole: tuple[Plan, Path], tmp_path: Path) -> None:
    plan, folder = whole
    shards = [tmp_path / str(n) for n in range(3)]
    for n, shard in enumerate(shards):
        run_in(shard, plan, shard=(n + 1, 3))
    merged: dict[str, bytes] = {}
    for shard in shards:
        assert not merged.keys() & contents(shard).keys()
        merged |= contents(shard)
    assert merged == contents(folder)
    assert board(plan, *shards) == board(plan, *reversed(shards)) == board(plan, folder)


def test_a_finished_study_runs_nothing(whole: tuple[Plan, Path]) -> None:
    plan, folder = whole
    before = contents(folder)
    assert run_in(folder, plan, "no_such_function") == Outcome(kept=8)
    assert contents(folder) == before


def test_damaged_and_missing_units_are_done_again(
        whole: tuple[Plan, Path], plan_of_copy: Plan, tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch) -> None:
    plan, folder = plan_of_copy, whole[1]
    first, second, third = sorted((tmp_path / "units").iterdir())[:3]
    first.write_bytes(first.read_bytes()[:-50])
    second.write_bytes(b"")
    third.unlink()
    (tmp_path / "units" / f".{third.name}.123.tmp").write_bytes(b"left by a kill")
    (tmp_path / "units" / "0123.parquet").write_bytes(b"of an older schema")
    monkeypatch.setenv("FAKE_LOG", str(tmp_path / "ran"))
    assert run_in(tmp_path, plan, "counted_episodes") == Outcome(kept=5, done=3)
    assert len((tmp_path / "ran").read_text().splitlines()) == 3
    (tmp_path / "units" / "0123.parquet").unlink()
    assert contents(tmp_path) == contents(folder)
    assert len(list((tmp_path / "logs").glob("*.damaged"))) == 2


def test_a_grown_study_runs_only_what_is_new(
        plan_of_copy: Plan, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    grown = plan_of(tmp_path / "spec", SMALL.replace('"wedge"', '"wedge", "funnel"'))
    monkeypatch.setenv("FAKE_LOG", str(tmp_path / "ran"))
    assert run_in(tmp_path, grown, "counted_episodes") == Outcome(kept=8, done=4)
    assert all("funnel" in line for line in (tmp_path / "ran").read_text().splitlines())
    with pytest.raises(OtherStudy, match=r"objects\.funnel"):
        run_in(tmp_path, plan_of_copy)


@pytest.mark.parametrize("keep", [
    pytest.param("", marks=pytest.mark.slow), 'keep = "contacts"\n'])
def test_more_episodes_run_only_the_rest_of_each_unit(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keep: str) -> None:
    """From 32 to 48 nearly all was run again. The files are those of a run from scratch."""
    def plan(folder: str, count: int) -> Plan:
        return plan_of(tmp_path / folder, keep + SMALL.replace("cell = 70", f"cell = {count}"))

    whole = plan("spec", 100)
    monkeypatch.setenv("FAKE_LOG", str(tmp_path / "log"))
    run_in(tmp_path / "whole", whole, "measured_episodes")
    for count, kept, episodes in ((32, 0, 32), (48, 0, 16), (100, 0, 16 + 36), (100, 8, 0)):
        log = tmp_path / f"ran{count}{kept}"
        monkeypatch.setenv("FAKE_LOG", str(log))
        outcome = run_in(tmp_path / "grown", plan("other", count), "measured_episodes")
        assert (outcome.kept, outcome.failed, outcome.lost) == (kept, 0, 0)
        ran = [int(line) for line in log.read_text().splitlines()] if log.exists() else []
        assert sum(ran) == 4 * episodes
    for folder in ("units", *(["contacts"] if keep else [])):
        files = {file.name: file.read_bytes()
                 for file in (tmp_path / "whole" / folder).iterdir()}
        assert files == {file.name: file.read_bytes()
                         for file in (tmp_path / "grown" / folder).iterdir()}


def test_a_study_that_is_growing_has_the_leaderboard_of_before(tmp_path: Path) -> None:
    """An entry without more episodes yet used to leave nothing of the others' either."""
    def plan(count: int) -> Plan:
        return plan_of(tmp_path / f"spec{count}", SMALL.replace("cell = 70", f"cell = {count}"))

    def means(of: Plan) -> list[dict[str, str]]:
        rows = csv.DictReader(io.StringIO(board(of, tmp_path / "out").decode()))
        return [{key: row[key] for key in ("strategy", "chamfer_mm", "n_episodes")} for row in rows]

    old, grown = plan(40), plan(60)
    run_in(tmp_path / "out", old)
    before = means(old)
    run_in(tmp_path / "whole", grown)
    store = Store(tmp_path / "out")
    store.open_for(grown, None, "cpu")
    unit, part = next(iter(grown.units())), next(iter(old.units()))
    shutil.copy(Store(tmp_path / "whole").path(unit), store.path(unit))
    store.path(part).unlink()  # as a run that was stopped leaves them
    assert means(grown) == before
    make_leaderboard(grown, [store])
    assert "not every entry has more episodes yet" in damaged_notes([store])[0]


def test_another_spec_is_refused_and_changes_nothing(whole: tuple[Plan, Path]) -> None:
    _, folder = whole
    before = (folder / "resolved.json").read_bytes()
    other = plan_of(folder / "other", SMALL.replace("seed = 7", "seed = 8"))
    with pytest.raises(OtherStudy, match="seed: 7 -> 8"):
        run_in(folder, other)
    assert (folder / "resolved.json").read_bytes() == before


def test_deadly_units_are_set_aside_and_the_rest_goes_on(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, dropped_kernels: list[str]) -> None:
    monkeypatch.setenv("FAKE_LOG", str(tmp_path / "killed once"))
    text = SMALL.replace('"block", "wedge"', '"funnel", "wedge", "lightbulb", "block"').replace(
        "= 70\no", "= 3\no").partition('[[strategy]]\nname = "mine"')[0]
    plan = plan_of(tmp_path / "spec", text)
    outcome = run_in(tmp_path, plan, "deadly_episodes", workers=2)
    assert outcome == Outcome(kept=0, done=2, failed=2)
    assert dropped_kernels  # here only noted
    assert (tmp_path / "killed once").exists()
    logs = "\n".join(file.read_text() for file in (tmp_path / "logs").glob("*.failed.log"))
    assert "this bulb always breaks" in logs
    assert "the worker died (exit code -11)" in logs
    assert "strategy ring6, object funnel" in logs
    board = make_leaderboard(plan, [Store(tmp_path)])
    failed = board.header.index("failure_rate")
    assert [row[failed] for row in board.rows] == ["0.5000"]  # failed units count as failures
    assert run_in(tmp_path, plan).failed == 0  # the next run tries them again
    assert not list((tmp_path / "logs").glob("*.failed.log"))


def test_a_unit_that_hangs_is_set_aside_and_the_rest_goes_on(tmp_path: Path) -> None:
    text = SMALL.replace("= 70\no", "= 3\no").partition('[[strategy]]\nname = "mine"')[0]
    plan = plan_of(tmp_path / "spec", text)
    outcome = run_in(tmp_path, plan, "hanging_episodes", unit_timeout_s=1.5)
    assert outcome == Outcome(kept=0, done=1, failed=1)
    log, = (file.read_text() for file in (tmp_path / "logs").glob("*.failed.log"))
    assert "strategy ring6, object wedge" in log
    assert "in hanging_episodes" in log  # where it hung
    assert log.endswith("stopped: it took longer than 1.5 s (--unit-timeout-s)\n")
    assert run_in(tmp_path, plan) == Outcome(kept=1, done=1)


def test_ctrl_c_does_not_reach_a_worker_that_is_starting(tmp_path: Path) -> None:
    """The terminal sends it to all processes; tracebacks of starting ones hid the message."""
    work: Any = SimpleNamespace(store=SimpleNamespace(logs=tmp_path))
    current = runner._Run(work, Options(function="fake_episodes:run_episodes"))
    slot = current._start_worker(1, first=True)
    try:
        for _ in range(20):
            os.kill(slot.process.pid or 0, signal.SIGINT)
            time.sleep(0.01)
        assert slot.pipe.poll(60.0)
        assert slot.pipe.recv().kind == "ready"
    finally:
        current._end(slot)


def test_time_in_which_the_run_was_suspended_does_not_count(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asleep, real = 0.0, runner.wait

    def suspended_once(pipes: list[Any], timeout: float) -> list[Any]:
        nonlocal asleep
        if asleep or not list((tmp_path / "units").glob("*.parquet")):
            return real(pipes, timeout=timeout)
        asleep = 4000.0
        return []

    monkeypatch.setattr(runner, "wait", suspended_once)
    monkeypatch.setattr(runner, "time", SimpleNamespace(
        monotonic=lambda: time.monotonic() + asleep))
    monkeypatch.setattr(runner._Run, "_replace", lambda *given, **named: pytest.fail("replaced"))
    assert run_in(tmp_path, plan_of(tmp_path / "spec"), "slow_episodes") == Outcome(done=8)
    assert asleep


def test_units_that_are_links_are_taken_over_as_files(
        whole: tuple[Plan, Path], tmp_path: Path) -> None:
    """Links to them broke as the other study was moved, or stood in another folder."""
    plan, folder = whole
    shutil.copytree(folder, tmp_path / "old")
    shutil.copytree(folder, tmp_path / "links")
    for file in (tmp_path / "links/units").iterdir():
        file.unlink()
        file.symlink_to(Path("../../old/units") / file.name)
    store = Store(tmp_path / "some/where")
    store.open_for(plan, None, "cpu")
    assert reuse_units(plan, store, [Store(tmp_path / "links")]) == 8
    shutil.rmtree(tmp_path / "old")
    assert contents(store.folder) == contents(folder)


def test_a_flipped_bit_is_found_when_asked_for_and_by_every_ranking(
        whole: tuple[Plan, Path], plan_of_copy: Plan, tmp_path: Path) -> None:
    plan, folder = plan_of_copy, whole[1]
    unit = min((tmp_path / "units").iterdir())
    content = bytearray(unit.read_bytes())
    content[len(content) // 3] ^= 0xFF  # of values: some bytes of headers tell nothing
    unit.write_bytes(content)
    assert run_in(tmp_path, plan) == Outcome(kept=8)  # a look at its end does not tell
    assert run_in(tmp_path, plan, verify=True) == Outcome(kept=7, done=1)
    assert contents(tmp_path) == contents(folder)


def test_a_full_disk_ends_the_run_and_loses_nothing(tmp_path: Path) -> None:
    plan = plan_of(tmp_path / "spec")
    with pytest.raises(StoreError, match="No space left on device; finished units are kept"):
        run_in(tmp_path, plan, "broken_disk")
    assert len(contents(tmp_path)) == 1
    assert run_in(tmp_path, plan) == Outcome(kept=1, done=7)


def test_a_worker_that_cannot_start_is_told(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no_such_function"):
        run_in(tmp_path, plan_of(tmp_path / "spec"), "no_such_function")


def test_the_second_of_two_runs_is_told_who_holds_the_directory(
        whole: tuple[Plan, Path]) -> None:
    plan, folder = whole
    store = Store(folder)
    assert store.holders() == {}
    with store.lock((1, 1)):
        assert store.holders() == {"1-of-1": f"process {os.getpid()} on {os.uname().nodename}"}
        with pytest.raises(Held, match=f"process {os.getpid()} on "):
            run_in(folder, plan)
    run_in(folder, plan)


def test_shards_that_overlap_are_refused(whole: tuple[Plan, Path]) -> None:
    """1/1 has the units of 1/2, and each removed what the other was writing."""
    _, folder = whole
    store = Store(folder)
    with store.lock((2, 3)), store.lock((1, 3)):
        for shard in ((1, 1), (1, 2), (2, 4)):
            with pytest.raises(Held, match=f"shard 1/3 is being worked on by process {os.getpid()}"
                               f" on .*, and has units of shard {shard[0]}/{shard[1]}; "
                               ), store.lock(shard):
                pass
    with store.lock((1, 2)):
        pass


def test_a_sweep_and_a_race_do_not_work_beside_each_other(tmp_path: Path) -> None:
    """A sweep's shard removed the note of the race whose shards went on."""
    race, sweep = Store(tmp_path / "out"), Store(tmp_path / "out")
    with race.lock((1, 2), "race"):
        race.open_for(plan_of(tmp_path / "spec"), None, "cpu")
        with pytest.raises(Held, match=r"shard 1/2 is being worked on by process .* for a "
                           "race; wait for it, or choose another directory"
                           ), sweep.lock((2, 2)):
            pass
        with Store(tmp_path / "out").lock((2, 2), "race"):
            pass
    with sweep.lock((1, 2)), pytest.raises(Held, match="for a sweep"), race.lock((2, 2), "race"):
        pass  # whatever an earlier run wrote into these locks


def test_of_two_specs_that_begin_at_once_one_is_refused(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Both found an empty directory, and the units of one belonged to nobody."""
    real = store_module.write_atomic

    def late(path: Path, content: bytes) -> None:
        time.sleep(0.2 * (path.name == "resolved.json"))
        real(path, content)

    monkeypatch.setattr(store_module, "write_atomic", late)
    plans = [plan_of(tmp_path / str(seed), SMALL.replace("seed = 7", f"seed = {seed}"))
             for seed in (7, 8)]

    def begin(shard: int) -> str:
        store = Store(tmp_path / "out")
        with store.lock((shard, 2)):
            try:
                store.open_for(plans[shard - 1], None, "cpu")
            except OtherStudy:
                return ""
            return plans[shard - 1].hash

    with ThreadPoolExecutor() as pool:
        begun = set(pool.map(begin, (1, 2)))
    assert begun == {"", Store(tmp_path / "out").resolved()["hash"]}


def test_a_study_does_not_grow_beside_a_shard_of_what_it_was(tmp_path: Path) -> None:
    """It joined a unit that the other shard had run, which then counted it as lost."""
    old, grown = (plan_of(tmp_path / name, SMALL.replace("= 70\no", f"= {count}\no"))
                  for name, count in (("old", 70), ("grown", 100)))
    first, second = Store(tmp_path / "out"), Store(tmp_path / "out")
    with first.lock((1, 2)), second.lock((2, 2)):
        first.open_for(old, None, "cpu")
        with pytest.raises(StoreError, match=r"process .* works on shard 1-of-2, of the study "
                                             "before it grew; wait for it") as error:
            second.open_for(grown, None, "cpu")
        assert error.value.exit_code == 3
    with first.lock((1, 2)), second.lock((2, 2)):  # both begin with what it has grown to
        first.open_for(grown, None, "cpu")
        second.open_for(grown, None, "cpu")
    with first.lock((1, 1)):  # grows as it goes
        first.open_for(grown, None, "cpu")
        more = plan_of(tmp_path / "more", SMALL.replace("= 70\no", "= 128\no"))
        first.open_for(more, None, "cpu")


def test_a_run_that_begins_beside_is_no_other_file(tmp_path: Path) -> None:
    """Of shards that began at once one was told of `logs` and `units` and no study, which the other
    was just making."""
    (tmp_path / "units").mkdir()
    with ThreadPoolExecutor() as pool:
        pool.submit(lambda: (time.sleep(0.05), (tmp_path / "logs").mkdir()))
        Store(tmp_path).refuse_other_files()
    (tmp_path / "logs").rmdir()
    with pytest.raises(StoreError, match="holds 'units', and no study"):
        Store(tmp_path).refuse_other_files()


def test_rows_are_named_by_their_unit_and_must_be_whole(whole: tuple[Plan, Path]) -> None:
    plan, _ = whole
    unit = next(plan.units())
    rows, = run_units(fake_episodes.run_episodes, [unit], "cpu")
    assert list(rows)[:4] == ["episode", "strategy", "object", "seed"]
    assert rows["episode"].tolist() == list(range(64))
    with pytest.raises(ValueError, match="64 episodes were asked for"):
        run_units(lambda parts, device: [{"iou": np.zeros(3)}], [unit], "cpu")
