"""Planners that try to spoil the run: the others' rows stay as they are, each has its own line."""

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from studies import contents, plan_of, run_in

from strategies.planners.guarded_call import EndedProcess, guarded_call
from strategies.planners.planner_file import planner_file
from strategies.planners.register import fault_text
from sweeps.episode.episodes import run_cells
from sweeps.run import local_engine as runner
from sweeps.run.local_engine import Options
from sweeps.run.plan import Plan, Unit
from sweeps.run.progress import Progress
from sweeps.run.scheduler import Outcome
from sweeps.run.store import Store
from sweeps.run.unit_file import Columns
from sweeps.run.worker import run_units
from sweeps.spec.cell import ENDED, Cell

HONEST = """\
schema = 1
seed = 7
episodes_per_cell = 64
objects = ["block"]
[[strategy]]
name = "ring6"
"""
ASIDE = {"os.kill(os.getpid(), 11)", "os.kill(os.getpid(), 9)", "time.sleep(600)"}
"""What ends a worker from inside: its units are set aside as failed. All else is a fault."""


def spec(folder: Path, lines: list[str]) -> str:
    """The honest study with a planner of the user's for each line."""
    text = HONEST
    for number, line in enumerate(lines):
        file = (folder / f"p{number}.py").absolute()
        file.write_text("import os, sys, time, subprocess\n\n\ndef choose(belief):\n"
                        f"    {line}\n    return []\n")
        text += f'[[strategy]]\nname = "p{number}"\nstrategy = "{file}:choose"\n'
    return text


def run_with(folder: Path, lines: list[str], **more: Any) -> tuple[Plan, Any]:
    folder.mkdir(exist_ok=True)
    plan = plan_of(folder / "spec", spec(folder, lines))
    return plan, run_in(folder / "out", plan, function="planned_episodes", **more)


def notes(folder: Path, plan: Plan) -> dict[str, str]:
    """By strategy, what its rows say, or its log."""
    store = Store(folder / "out")
    found: dict[str, str] = {}
    for unit in plan.units():
        rows = store.read(unit)
        found[unit.cell.strategy.name] = (
            store.log(unit).read_text() if rows is None else str(rows["note"][0]))
    return found


@pytest.mark.slow
def test_each_has_its_line_and_the_others_their_rows(tmp_path: Path) -> None:
    lines = ["raise KeyboardInterrupt", "sys.exit(0)", "os._exit(0)",
             "os.fork() and time.sleep(0.1)", "os.fork() or os._exit(0)",
             "subprocess.Popen(['sleep', '600'])",
             "os.kill(os.getpid(), 11)", "os.kill(os.getpid(), 9)", "time.sleep(600)",
             "os.environ.clear(); __import__('numpy').seterr(all='raise')", "os.closerange(3, 100)"]
    honest = plan_of(tmp_path / "honest", HONEST)
    run_in(tmp_path / "alone", honest, function="planned_episodes")  # compiles, untimed
    plan, outcome = run_with(tmp_path, lines, workers=2, unit_timeout_s=8.0)
    mine = contents(tmp_path / "out")
    assert {name: mine[name] for name in contents(tmp_path / "alone")} == contents(
        tmp_path / "alone")
    said, names = notes(tmp_path, plan), [f"p{number}" for number in range(len(lines) - 1)]
    assert outcome.lost == 0
    assert outcome.done + outcome.failed == plan.unit_count
    assert ["died" in text or "stopped" in text for text in map(said.get, names)] == [
        line in ASIDE for line in lines[:-1]]  # the last may have been written before it died
    for number, words in ((0, "KeyboardInterrupt"), (1, "SystemExit: 0"), (2, "os._exit(0)")):
        assert said[f"p{number}"] == f"p{number}.py:5: choose: {words}"
    assert [said[f"p{number}"] for number in (3, 4, 5, 9)] == [""] * 4
    assert "the worker died (exit code -11)" in said["p6"]
    assert "the worker died (exit code -9)" in said["p7"]
    assert "stopped: it took longer than 8 s" in said["p8"]
    time.sleep(0.2)
    assert not [process for process in _processes() if "sleep\x00600" in process]


def _processes() -> list[str]:
    found = []
    for folder in Path("/proc").iterdir():
        with contextlib.suppress(OSError):
            found.append((folder / "cmdline").read_text())
    return found


def test_a_printing_planner_leaves_a_short_log(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "LOG_BYTES", 1 << 20)
    _plan, outcome = run_with(tmp_path, ["print('x' * (8 << 20), flush=True)"])
    assert outcome.failed == 0
    assert sum(file.stat().st_size for file in (tmp_path / "out/logs").iterdir()) < 2 << 20


def test_what_each_planner_prints_is_kept(tmp_path: Path) -> None:
    """Each has a process of its own; each used to begin the one log anew."""
    file = tmp_path / "out/logs/worker-1-shard-1-of-1.log"
    file.parent.mkdir(parents=True)
    file.write_text("of an earlier run")
    run_with(tmp_path, ["print('hello', flush=True)", "pass", "print('bye', flush=True)"])
    said = file.read_text()
    assert said.index("strategy p0:") < said.index("hello") < said.index("strategy p2:")
    assert "bye" in said[said.index("strategy p2:"):]
    assert "earlier" not in said


def test_deaths_at_the_start_are_counted_in_a_row(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Three in a long run used to end it; here every other start is one."""
    starts = tmp_path / "starts"
    starts.mkdir()
    monkeypatch.setenv("FAKE_STARTS", str(starts))
    plan = plan_of(tmp_path / "spec", spec(tmp_path, ["pass"] * 5))
    store = Store(tmp_path / "out")
    store.open_for(plan, None, "cpu")
    options = Options(1, (1, 1), "cpu", "fake_starts:run_episodes")
    with store.lock((1, 1)), Progress(plan.unit_count, quiet=True) as progress:
        outcome = runner.run(plan, store, options, progress)
    assert outcome == Outcome(kept=0, done=plan.unit_count, failed=0, lost=0)
    assert len(list(starts.iterdir())) >= 8  # four and more died


@pytest.mark.parametrize(("line", "aside"), [
    ("os.chdir('/')", False),
    ("__import__('resource').setrlimit(__import__('resource').RLIMIT_FSIZE, (99, 99))", True)])
def test_who_keeps_its_process_from_writing_ends_no_run(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, line: str, aside: bool) -> None:
    """Every resumed run used to end at the same unit, and later strategies never had rows."""
    monkeypatch.chdir(tmp_path)
    plan, outcome = run_with(Path(), [line, "pass"])
    assert (outcome.done, outcome.failed, outcome.lost) == (3 - aside, int(aside), 0)
    said = notes(tmp_path, plan)
    assert ("cannot be written: File too large" in said["p0"]) == aside
    assert said["p1"] == said["ring6"] == ""
    assert not list((tmp_path / "out/units").glob(".*"))


def test_a_reconstruct_function_shares_its_process_with_no_other_strategy(tmp_path: Path) -> None:
    """A setting of numpy that one changed made another strategy's units fail, with one worker."""
    net = tmp_path / "net.py"
    net.write_text("def bodies(touches):\n    return [None] * touches.worlds\n")
    text = HONEST.replace("= 64", "= 200") + (
        '[[strategy]]\nname = "rim6-ring12"\n[[strategy]]\nname = "ring18"\n')
    for name, more in (("plain", ""), ("own", f'[fit]\nreconstruct = "{net}:bodies"\n')):
        plan = plan_of(tmp_path / f"spec-{name}", text + more)
        run_in(tmp_path / name, plan, function="told_processes")
        store = Store(tmp_path / name)
        ran = {(unit.cell.strategy.name, *str(rows["note"][0]).split())
               for unit in plan.units() if (rows := store.read(unit))}
        assert len({process for _, process, _ in ran}) == (3 if more else 1)
        if more:  # it need not keep worlds apart, so a call is for one unit
            assert {units for _, _, units in ran} == {"1"}
            assert len({(strategy, process) for strategy, process, _ in ran}) == 3


def test_folder_and_numpy_are_as_before_after_a_call(tmp_path: Path) -> None:
    before = Path.cwd(), np.geterr()

    def choose() -> None:
        os.chdir(tmp_path)
        np.seterr(all="raise")
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError), guarded_call():
        choose()
    assert (Path.cwd(), np.geterr()) == before


def test_a_variable_that_a_file_sets_is_not_for_the_workers_of_others(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Flags of XLA that one set changed the rows of other strategies."""
    for name, value in (("FAKE_KEPT", "a"), ("FAKE_TAKEN", "b"), ("FAKE_NEW", "c")):
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("FAKE_NEW")
    file = tmp_path / "p.py"
    file.write_text("import os\nos.environ.update(FAKE_KEPT='x', FAKE_NEW='y')\n"
                    "os.environ.pop('FAKE_TAKEN', None)\n")
    planner_file(file)
    file.write_text(file.read_text() + "os.environ['FAKE_KEPT'] = 'z'\n")
    planner_file(file)

    def seen() -> list[str | None]:
        return [os.environ.get(f"FAKE_{name}") for name in ("KEPT", "TAKEN", "NEW")]

    with runner.as_a_worker():
        assert seen() == ["a", "b", None]
    assert seen() == ["z", None, "y"]


def test_two_crashes_throw_compiled_programs_away(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, dropped_kernels: list[str]) -> None:
    monkeypatch.setenv("WARPGRASP_CACHE", str(tmp_path / "cache"))
    program = tmp_path / "cache" / "programs" / "0123" / "bad.xla"
    program.parent.mkdir(parents=True)
    program.write_bytes(b"a program that crashes")
    plan = plan_of(tmp_path / "spec", HONEST)
    outcome = run_in(tmp_path / "out", plan, function="crashing_while_cached")
    assert (outcome.done, outcome.failed) == (1, 0)
    assert not program.exists()
    assert dropped_kernels == ["warpgrasp", "strategies", "sweeps"]


def test_a_forked_copy_does_not_come_back() -> None:
    code = ("import os\nfrom strategies.planners.guarded_call import guarded_call\n"
            "with guarded_call():\n    child = os.fork()\nprint('back', flush=True)\n"
            "os.waitpid(child, 0)")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "back\n"


def test_the_line_of_an_end_is_told() -> None:
    def choose(belief: object) -> list[object]:
        os._exit(3)

    with pytest.raises(EndedProcess) as caught, guarded_call():
        choose(None)
    assert fault_text(choose, caught.value).endswith("choose: os._exit(3)")


@pytest.mark.parametrize("bad", [set(), {5}, {0, 1}, {3, 40, 63}, set(range(0, 16, 2))])
def test_an_error_ends_the_episodes_that_it_is_about(tmp_path: Path, bad: set[int]) -> None:
    """It used to end all episodes of the unit that went on."""
    unit = next(plan_of(tmp_path, HONEST).units())
    rows, ran = told_apart(unit, bad)
    assert rows["note"].tolist() == [f"1 together, at {n}" if n in bad else "" for n in range(64)]
    assert rows["status"].tolist() == [
        "strategy_failed" if n in bad else "a longer word" for n in range(64)]
    assert rows["episode"].tolist() == list(range(64))
    assert ENDED not in rows
    assert ran <= 64 + 2 * 6 * 64


def test_a_planner_that_always_fails_costs_little(tmp_path: Path) -> None:
    rows, ran = told_apart(next(plan_of(tmp_path, HONEST).units()), set(range(64)))
    assert (rows["status"] == "strategy_failed").all()
    assert ran <= 4 * 64
    # Those that were not told apart say of how many together the error was.
    assert rows["note"].tolist()[7:9] == ["1 together, at 7", "8 together, at 8"]


def told_apart(unit: Unit, bad: set[int]) -> tuple[Columns, int]:
    """The rows of a unit whose planner fails where a bad episode is among those it is asked of, and
    how many episodes were run."""
    ran = 0

    def run_cells(parts: Sequence[tuple[Cell, np.ndarray]], device: str) -> list[Columns]:
        nonlocal ran
        (_, episodes), = parts
        ran += len(episodes)
        found = sorted(bad & set(episodes.tolist()))
        ended = np.full(len(episodes), bool(found))
        note = f"{len(episodes)} together, at {found[0]}" if found else ""
        status = "strategy_failed" if found else "a longer word"
        rows = {"status": np.full(len(episodes), status),
                "note": np.full(len(episodes), note, object)}
        return [rows | ({ENDED: ended} if found else {})]

    rows, = run_units(run_cells, [unit], "cpu")
    return rows, ran


def test_the_others_rows_are_those_of_their_episodes_alone(tmp_path: Path) -> None:
    file = tmp_path / "p.py"
    file.write_text(
        "from strategies.planners.probes import Grasp\n"
        "from strategies.poses.hand_poses import waypoint_poses\n"
        "from strategies.poses.waypoints import Ring\n\n\n"
        "def choose(belief):\n"
        "    if belief.step == 2:\n"
        "        return []\n"
        "    if belief.step == 1 and (belief.prior.x_m[belief.active] > 0.45).any():\n"
        "        raise ValueError('too far away')\n"
        "    poses = waypoint_poses((Ring(count=6),), belief.prior, belief.hand, belief.seed)\n"
        "    return [Grasp(poses[:, 3 * belief.step:3 * belief.step + 3])]\n")
    text = HONEST.replace("per_cell = 64", "per_cell = 6") + (
        f'[[strategy]]\nname = "mine"\nstrategy = "{file}:choose"\n')
    unit = next(u for u in plan_of(tmp_path, text).units() if u.cell.strategy.name == "mine")
    rows, = run_units(run_cells, [unit], "cpu")
    failed = rows["status"] == "strategy_failed"
    assert 0 < failed.sum() < 6
    for n in range(6):
        alone, = run_cells([(unit.cell, np.arange(n, n + 1))], "cpu")
        alone.pop(ENDED, None)
        for name, values in alone.items():
            assert np.array_equal(np.asarray(values[0]), np.asarray(rows[name][n]),
                                  equal_nan=values.dtype.kind == "f"), name
