"""What files of planners do to the process that runs them, asked of a process of their own."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT

SPEC = """\
schema = 1
episodes_per_cell = 2
objects = ["block"]
[[strategy]]
name = "mine"
strategy = "mine.py:choose"
"""
PLANNER = "import ctypes, os, signal, sys\n{}\n\n\ndef choose(belief):\n    return []\n"


def check(folder: Path, line: str, *more: str) -> subprocess.CompletedProcess[str]:
    """`warpgrasp check` of a study with a planner whose file begins with a line."""
    (folder / "mine.py").write_text(PLANNER.format(line))
    (folder / "study.toml").write_text(SPEC)
    return subprocess.run([sys.executable, "-m", "sweeps", "check", "study.toml", *more],
                          cwd=folder, capture_output=True, text=True, check=False,
                          env={**os.environ, "PYTHONPATH": str(ROOT)})


@pytest.mark.parametrize("line", [
    "sys.stdout.close(); sys.stderr.close()", "os.close(1); os.close(2)",
    "sys.stdout = sys.stderr = None", "os.dup2(os.open(os.devnull, 1), 1); os.dup2(1, 2)",
    "print('of the planner'); sys.stdout.close()"])
def test_a_file_that_closes_the_output_silences_nobody(tmp_path: Path, line: str) -> None:
    """The command ended with code 1 or 2 and without a word."""
    done = check(tmp_path, line, "--json")
    assert done.returncode == 0
    assert json.loads(done.stdout)["cells"] == "1"  # and nothing that the file printed


@pytest.mark.parametrize(("line", "words"), [
    ("os.kill(os.getpid(), signal.SIGKILL)", ": ended the process by SIGKILL"),
    ("os.kill(os.getpid(), signal.SIGHUP)", ": ended the process by SIGHUP"),
    ("os.abort()", ": ended the process by SIGABRT"),
    ("ctypes.CDLL(None)._exit(0)", ": ended the process with exit code 0"),
    ("sys.stdout.close(); sys.stderr.close(); sys.exit(3)", "SystemExit: 3"),
    ("os.closerange(0, 100)", ": closes files of the process that are not its own")])
def test_a_file_that_kills_the_process_is_named(tmp_path: Path, line: str, words: str) -> None:
    done = check(tmp_path, line)
    assert (done.returncode, done.stdout) == (2, "")
    assert "study.toml:6: strategy[0].strategy: " in done.stderr
    assert words in done.stderr


def test_a_sweep_with_such_a_file_keeps_what_is_finished(tmp_path: Path) -> None:
    """Arrow, which sweeps load first, has a thread of its own: nothing was tried there."""
    sweep = [sys.executable, "-m", "sweeps", "sweep", "study.toml", "-o", "out"]
    about = {"cwd": tmp_path, "env": {**os.environ, "PYTHONPATH": str(ROOT)},
             "capture_output": True, "text": True, "check": False}
    (tmp_path / "mine.py").write_text(PLANNER.format(""))
    (tmp_path / "study.toml").write_text(SPEC)
    assert subprocess.run(sweep, **about).returncode == 0  # type: ignore[call-overload]
    before = {file: file.read_bytes() for file in (tmp_path / "out").rglob("*") if file.is_file()}
    (tmp_path / "mine.py").write_text(PLANNER.format("os.kill(os.getpid(), signal.SIGSEGV)"))
    done = subprocess.run(sweep, **about)  # type: ignore[call-overload]
    assert done.returncode == 2
    assert "mine.py: ended the process by SIGSEGV" in done.stderr
    assert before == {file: file.read_bytes() for file in (tmp_path / "out").rglob("*")
                      if file.is_file()}
