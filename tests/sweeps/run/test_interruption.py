"""What stops a run at the worst moment: kills and failing writes."""

import io
import os
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from kill_study import command, environment, kill_and_resume, study
from studies import SMALL, contents, fill, plan_of

import sweeps.output
from sweeps.analysis.leaderboard import make_leaderboard
from sweeps.output import write_atomic
from sweeps.run.store import Store
from sweeps.run.unit_file import read_unit, write_unit
from sweeps.spec.errors import StoreError


def test_a_study_survives_kills(tmp_path: Path) -> None:
    wrong, _ = kill_and_resume(tmp_path, units=6, kills=1, seconds=0.3, seed=3)
    assert not wrong


@pytest.mark.slow
def test_a_study_survives_fifty_kills(tmp_path: Path) -> None:
    wrong, _ = kill_and_resume(tmp_path, units=60, kills=50, seconds=1.0, seed=1)
    assert not wrong


@pytest.fixture
def running(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A study in `tmp_path / "out"`, of which two units are there and others are being run."""
    spec, out = study(tmp_path, 60), tmp_path / "out"
    (tmp_path / "log").mkdir()
    kept = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # also where `nohup` runs the tests
    process = subprocess.Popen(command(spec, out), stderr=subprocess.PIPE, text=True,
                               stdout=subprocess.DEVNULL, env=environment(0.1, tmp_path / "log"))
    signal.signal(signal.SIGHUP, kept)
    while not (process.poll() is not None or len(list(out.glob("units/*.parquet"))) > 1):
        time.sleep(0.02)
    yield process
    process.kill()
    process.communicate()


def go_on(folder: Path, out: Path) -> None:
    """Continues a study; its units must be those of a run that nothing happened to, and those that
    were there stay as they are."""
    before = {file: file.stat().st_mtime_ns for file in out.glob("units/*.parquet")}
    assert 2 <= len(before) < 60
    (folder / "again").mkdir()
    for there in (out, folder / "whole"):
        subprocess.run(command(folder / "spec.toml", there), check=True, capture_output=True,
                       env=environment(0.0, folder / "again"))
    assert before.items() <= {file: file.stat().st_mtime_ns
                              for file in out.glob("units/*.parquet")}.items()
    assert contents(out) == contents(folder / "whole")
    assert len(contents(out)) == 60


def test_a_closed_terminal_loses_nothing(
        tmp_path: Path, running: subprocess.Popen[str]) -> None:
    running.send_signal(signal.SIGHUP)
    assert running.wait(60) == -signal.SIGHUP
    go_on(tmp_path, tmp_path / "out")


def test_a_directory_that_is_moved_is_told_and_goes_on(
        tmp_path: Path, running: subprocess.Popen[str]) -> None:
    """The message was of a unit for which there is no folder, and that the same command goes on."""
    (tmp_path / "out").rename(tmp_path / "moved")
    said = running.communicate(timeout=60)[1]
    assert running.returncode == 1
    assert "out: was moved or removed while it was worked on; if it was moved, finished" in said
    go_on(tmp_path, tmp_path / "moved")


def test_temporaries_of_a_run_that_begins_meanwhile_stay(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = fill(tmp_path, plan_of(tmp_path))
    left, written = (store.folder / f".spec.toml.{digit * 12}.tmp" for digit in "ab")
    left.touch()
    real = Store.holders

    def begun_meanwhile(store: Store, unknown: bool = False) -> dict[str, str]:
        found = real(store, unknown)
        if unknown:  # asked once what killed runs left has been listed
            written.touch()
        return found

    monkeypatch.setattr(Store, "holders", begun_meanwhile)
    with store.lock((1, 2)):
        assert (left.exists(), written.exists()) == (False, True)


class Faults:
    """Makes the n-th operation of a write fail: open, write (after half), fsync, replace."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, at: int) -> None:
        self.left = at
        self.names: list[str] = []
        for name in ("fsync", "replace", "open"):
            monkeypatch.setattr(sweeps.output.os, name, self.failing(name, getattr(os, name)))
        monkeypatch.setattr(Path, "open", self.opening(Path.open))

    def count(self, name: str) -> None:
        self.names.append(name)
        self.left -= 1
        if self.left == -1:
            raise OSError(28, "No space left on device")

    def failing(self, name: str, real: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **options: Any) -> Any:
            self.count(name)
            return real(*arguments, **options)
        return call

    def opening(self, real: Callable[..., Any]) -> Callable[..., Any]:
        def call(path: Path, mode: str = "r", **options: Any) -> Any:
            if "w" not in mode:
                return real(path, mode, **options)
            self.count("create")
            return Stream(real(path, mode, **options), self)
        return call


class Stream(io.RawIOBase):
    def __init__(self, inner: Any, faults: Faults) -> None:
        self.inner, self.faults = inner, faults

    def write(self, data: Any) -> int:
        self.inner.write(bytes(data)[:len(data) // 2])
        self.faults.count("write")
        return self.inner.write(bytes(data)[len(data) // 2:])

    def flush(self) -> None:
        if not self.inner.closed:
            self.inner.flush()

    def fileno(self) -> int:
        return self.inner.fileno()

    def close(self) -> None:
        self.inner.close()


OPERATIONS = ["create", "write", "fsync", "replace", "open", "fsync"]


@pytest.mark.parametrize("at", range(len(OPERATIONS) + 1))
@pytest.mark.parametrize("before", [None, b"older"])
def test_a_failing_write_leaves_old_or_new_never_half(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: int, before: bytes | None) -> None:
    file = tmp_path / "x"
    if before is not None:
        file.write_bytes(before)
    with monkeypatch.context() as patched:
        faults = Faults(patched, at)
        try:
            write_atomic(file, b"newer" * 1000)
            failed = False
        except OSError:
            failed = True
    assert failed == (at < len(OPERATIONS))
    assert faults.names == OPERATIONS[:at + 1]
    renamed = at > OPERATIONS.index("replace")
    assert (file.read_bytes() if file.exists() else None) == (
        b"newer" * 1000 if renamed else before)
    assert [f for f in os.listdir(tmp_path) if f != "x"] == []


def test_a_failing_write_of_a_unit_is_retried_to_the_same_bytes(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = {"episode": np.arange(4), "status": np.array(["ok"] * 4)}
    write_unit(tmp_path / "right", "a", rows)
    for at in range(len(OPERATIONS)):
        file = tmp_path / f"{at}.parquet"
        with monkeypatch.context() as patched:
            Faults(patched, at)
            with pytest.raises(OSError, match="No space left"):
                write_unit(file, "a", rows)
        if file.exists():
            read_unit(file, "a", 4)
        write_unit(file, "a", rows)
        assert file.read_bytes() == (tmp_path / "right").read_bytes()


def test_a_directory_that_fails_at_its_birth_can_be_used_later(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan = plan_of(tmp_path / "spec")
    for at in range(40):
        store = Store(tmp_path / str(at))
        with monkeypatch.context() as patched:
            Faults(patched, at)
            try:
                store.open_for(plan, b"spec", "cpu")
                failed = False
            except StoreError as error:
                assert "No space left on device" in str(error)  # noqa: PT017
                failed = True
        store.open_for(plan, b"spec", "cpu")
        assert store.resolved()["hash"] == plan.hash
        if not failed:
            assert at == 1 + 3 * len(OPERATIONS)  # whose turn it is; resolved, spec, environment
            return
    pytest.fail("never succeeded")


def test_a_damaged_unit_is_never_ranked(tmp_path: Path) -> None:
    plan = plan_of(tmp_path, SMALL)
    store = fill(tmp_path, plan)
    whole = make_leaderboard(plan, [store]).csv()
    unit = next(plan.units())
    content = bytearray(store.path(unit).read_bytes())
    content[len(content) // 3] ^= 0xFF
    store.path(unit).write_bytes(content)
    board = make_leaderboard(plan, [store])
    assert board.csv() != whole
    assert "1 of 8 units are missing" in board.notes[0]
    fill(tmp_path, plan)
    assert make_leaderboard(plan, [store]).csv() == whole
