"""How many cores are taken: those that the process may use, not those of the machine."""

import os
from pathlib import Path

import pytest

from warpgrasp.core import cores as module
from warpgrasp.core.cores import THREADS, core_count, thread_count


@pytest.fixture
def quota(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file that says what the container may use, which is not there yet."""
    monkeypatch.setattr(module, "QUOTA", tmp_path / "cpu.max")
    return tmp_path / "cpu.max"


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="of Linux")
def test_a_job_takes_the_cores_that_it_is_bound_to(quota: Path) -> None:
    """On a node of a cluster all its cores were taken, whatever the job had asked for."""
    every = os.sched_getaffinity(0)
    assert core_count() == len(every)
    os.sched_setaffinity(0, {min(every)})
    try:
        assert core_count() == 1
    finally:
        os.sched_setaffinity(0, every)


@pytest.mark.parametrize(("granted", "cores"), [
    ("250000 100000", 3), ("10000 100000", 1), ("max 100000", 8), ("9900000 100000", 8),
    ("", 8), ("of no use", 8)])
def test_a_container_takes_what_it_may_use(
        quota: Path, monkeypatch: pytest.MonkeyPatch, granted: str, cores: int) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(8)), raising=False)
    quota.write_text(f"{granted}\n")
    assert core_count() == cores


def test_other_systems_take_all(quota: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: 6)
    assert core_count() == 6


def test_the_environment_says_how_many_threads(
        quota: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(THREADS, "3")
    assert thread_count() == 3
    monkeypatch.setenv(THREADS, "")
    assert thread_count() == core_count()
    for wrong in ("0", "-1", "two", "1.5", "²"):
        monkeypatch.setenv(THREADS, wrong)
        with pytest.raises(ValueError, match=f"WARPGRASP_THREADS: is '{wrong}'; should be a whole"):
            thread_count()
