"""Whole studies, from the shell to the leaderboard: what an episode costs in small and large ones.

A study of one episode an object measures what starting and ending take; it is reported apart.
"""

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from os import times
from pathlib import Path
from typing import Any

WORKERS = 2
OBJECTS = {"ring6": ("block", "large_cylinder"), "coarse-to-fine": ("block", "wine_bottle")}
LEAST = 2
"""Episodes of the study that shows starting and ending: one an object."""
SIZES = {"ring6": (LEAST, 1024, 10_240, 102_400), "coarse-to-fine": (LEAST, 1024, 4096)}
_SPEC = """\
schema = 1
seed = 3
episodes_per_cell = {each}
objects = ["{objects}"]
[[strategy]]
name = "{strategy}"
"""


def studies(*, quick: bool) -> Iterator[dict[str, Any]]:
    """A line for each study, in the order they are run."""
    subprocess.run([_command(), "warmup"], capture_output=True, check=False)
    for strategy, sizes in SIZES.items():
        if quick and strategy != "ring6":
            continue
        _study(strategy, LEAST)  # reads files that later ones find in memory
        least: dict[str, Any] = {}
        for episodes in sizes[:2] if quick else sizes:
            line = _study(strategy, episodes)
            if episodes == LEAST:
                least = line
            elif "failed" not in line and "failed" not in least:
                line |= marginal(line, least)
            yield line


def marginal(line: Mapping[str, Any], least: Mapping[str, Any]) -> dict[str, float]:
    """Milliseconds of an episode, by the clock and of the cores, without start and end."""
    more = line["batch"] - least["batch"]
    return {f"{key}_ms_each": round(1e3 * (line[key] - least[key]) / more, 3)
            for key in ("s", "cpu_s")}


def _command() -> str:
    return shutil.which("warpgrasp") or str(Path(sys.executable).parent / "warpgrasp")


def _study(strategy: str, episodes: int) -> dict[str, Any]:
    objects = OBJECTS[strategy]
    with tempfile.TemporaryDirectory() as folder:
        spec = Path(folder) / "study.toml"
        spec.write_text(_SPEC.format(each=episodes // len(objects), strategy=strategy,
                                     objects='", "'.join(objects)))
        begin, before = time.perf_counter(), times()
        done = subprocess.run(
            [_command(), "sweep", str(spec), "-o", f"{folder}/out", "--workers", str(WORKERS)],
            capture_output=True, check=False)
        clock, after = time.perf_counter() - begin, times()
    cpu = (after.children_user + after.children_system
           - before.children_user - before.children_system)
    line = {"row": "study", "of": strategy, "batch": episodes, "threads": WORKERS,
            "unit": "episodes", "s": round(clock, 2), "cpu_s": round(cpu, 2),
            "per_s": float(f"{episodes / clock:.4g}"),
            "per_cpu_s": float(f"{episodes / max(cpu, 1e-9):.4g}")}
    return line if done.returncode == 0 else {**line, "failed": done.stderr.decode()[-200:]}
