"""Races in shards: the same bytes, whoever starts, ends or dies when."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from places import ROOT
from studies import write_spec

from sweeps.cli import main as cli
from sweeps.race.shards import SharedRungs
from sweeps.run import worker

SPEC = """\
schema = 1
seed = 9
objects = ["block", "wedge", "funnel"]
""" + "".join(f"""[[strategy]]
name = "{name}"
waypoints = {{ kind = "ring", count = 6 }}
""" for name in ("ant", "bee", "cow", "horse", "elephant"))
RUN = ("import sys; from sweeps.run import worker; from sweeps.cli import main as cli; "
       "worker.EPISODES = 'fake_episodes:slow_episodes'; sys.exit(cli.run(sys.argv[1:]))")


@pytest.fixture(autouse=True)
def _fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "EPISODES", "fake_episodes:run_episodes")


def contents(folder: Path) -> dict[str, bytes]:
    files = [*folder.glob("units/*.parquet"), folder / "race.csv", folder / "race.svg"]
    return {str(file.relative_to(folder)): file.read_bytes() for file in files}


def start(spec: Path, out: Path, shard: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-c", RUN, "race", str(spec), "-o", str(out), "--within", "0.3",
         "--shard", shard], cwd=ROOT, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
        env={**os.environ, "FAKE_SECONDS": "0.05",
             "PYTHONPATH": f"{ROOT}:{ROOT / 'tests/helpers'}"})


@pytest.mark.slow
def test_three_shards_of_which_one_is_killed_leave_the_same_bytes(tmp_path: Path) -> None:
    spec = write_spec(tmp_path, SPEC)
    assert cli.run(["race", str(spec), "-o", str(tmp_path / "whole"), "--within", "0.3"]) == 0
    out = tmp_path / "shards"
    shards = [start(spec, out, f"{n}/3") for n in (1, 2, 3)]
    for _ in range(600):
        if len(list(out.glob("units/*.parquet"))) > 8:
            break
        time.sleep(0.05)
    shards[0].send_signal(signal.SIGKILL)
    assert [shard.wait(timeout=120) for shard in shards] == [-signal.SIGKILL, 0, 0]
    assert contents(out) == contents(tmp_path / "whole")


def test_a_shard_that_is_alone_ends_the_race(tmp_path: Path) -> None:
    spec = write_spec(tmp_path, SPEC)
    whole, alone = tmp_path / "whole", tmp_path / "alone"
    words = ["--within", "0.3"]
    assert cli.run(["race", str(spec), "-o", str(whole), *words]) == 0
    assert cli.run(["race", str(spec), "-o", str(alone), *words, "--shard", "2/3"]) == 0
    assert contents(alone) == contents(whole)


class Directory:
    """A store of which only what shards ask is there."""

    def __init__(self) -> None:
        self.there: set[str] = set()
        self.held: set[str] = set()

    def unit_ids(self) -> set[str]:
        return self.there

    def holders(self) -> set[str]:
        return self.held

    def log(self, unit: Any) -> Path:
        return Path("/nowhere") / unit.id


def ids(units: Sequence[Any] | None) -> list[str] | None:
    return None if units is None else [unit.id for unit in units]


def test_who_runs_what(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sweeps.race.shards.POLL_S", 0.0)
    rung = [SimpleNamespace(id=name) for name in "abcdef"]
    again = [SimpleNamespace(id="a")]
    rungs = iter([rung, again, []])
    store = Directory()
    first = SharedRungs(lambda: next(rungs), store, (1, 3))  # type: ignore[arg-type]
    assert ids(first.further()) == ["a", "d"]
    store.there |= {"a", "d", "b"}
    store.held = {"1-of-3", "2-of-3", "3-of-3"}
    assert first.further() is None  # the others run theirs
    store.held = {"1-of-3", "2-of-3"}
    assert ids(first.further()) == ["c", "f"]  # the third is gone, and this is the first
    store.held = {"1-of-3", "2-of-3", "3-of-3"}
    store.there |= {"c", "f", "e"}
    assert ids(first.further()) == ["a"]  # found damaged by this shard
    store.there |= {"a"}
    assert ids(first.further()) == []
    second = SharedRungs(iter([rung]).__next__, Directory(), (2, 3))  # type: ignore[arg-type]
    assert ids(second.further()) == ["b", "e"]
    second.store.held = {"1-of-3", "2-of-3"}  # type: ignore[attr-defined]
    second.store.there = {"a", "b", "d", "e"}  # type: ignore[attr-defined]
    assert second.further() is None  # what the third left is the first one's
