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
PLANNER = "import os, sys\n{}\n\n\ndef choose(belief):\n    return []\n"


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
    assert json.loads(done.stdout)["cells"] == 1  # and nothing that the file printed


def test_a_file_that_closes_the_output_and_leaves_is_named(tmp_path: Path) -> None:
    done = check(tmp_path, "sys.stdout.close(); sys.stderr.close(); sys.exit(3)")
    assert (done.returncode, done.stdout) == (2, "")
    assert "study.toml:6: strategy[0].strategy: " in done.stderr
    assert "SystemExit: 3" in done.stderr
