"""`warpgrasp bench`: every row in a process of its own, a JSON line each, and a Markdown table."""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Collection, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from strategies.ready_made import STRATEGIES
from sweeps.bench.bench_table import markdown
from sweeps.bench.whole_study import studies
from sweeps.output import write_atomic
from sweeps.result_file import make_folder
from sweeps.run.environment import describe_environment
from sweeps.run.worker import ENVIRONMENT
from sweeps.spec.errors import StoreError, choose
from warpgrasp.core.cores import core_count

BATCHES = (64, 256, 1024, 4096, 16384)
AT_ONCE = 512
"""Episodes in a call, the most that workers of a sweep run together."""
SLOWEST = {"any-object": 64, "oracle": 64}
"""Of those that take tenths of a second: what a worker has in hand for half a minute."""
OBJECTS = ("block", "small_cylinder", "lightbulb", "mesh")
SHAPES = ("plane", "revolution", "superquadric11", "superquadric13", "superquadric15")
_TIMEOUT_S = 900.0
Row = tuple[str, str, int, int]
"""What, of what, batch, threads (or processes, where a thing runs on one thread)."""
_PROCESSES = ("fits", "free_forms", "episodes", "metrics")  # two workers rather than two threads


def rows(*, quick: bool, peers: bool) -> Iterator[Row]:
    """Every row of the benchmark, in the order it is run."""
    cores = (1, 2)
    objects = OBJECTS[:1] + OBJECTS[-1:] if quick else OBJECTS
    for threads in cores:
        yield from (("closings", of, 4096, threads) for of in objects)
        yield from (("touches", of, 1024, threads) for of in objects[:-1])
    yield from (("metrics", "block", 256, threads) for threads in cores)
    for of in SHAPES[3:4] if quick else SHAPES:
        yield from (("fits", of, 512, threads) for threads in cores)
    for of, at_once in (("fit", 512), ("scores", 64)):
        yield from (("free_forms", of, at_once, threads) for threads in cores)
    for name in ("ring6",) if quick else STRATEGIES:
        at_once = SLOWEST.get(name, AT_ONCE)
        yield from (("episodes", name, at_once, threads) for threads in cores)
    if not quick:
        yield from (("closings", "block", batch, 2) for batch in BATCHES if batch != 4096)
        yield from (("touches", "block", batch, 2) for batch in BATCHES if batch != 1024)
        yield from (("metrics", "block", batch, 1) for batch in BATCHES if batch != 256)
        yield from (("fits", "superquadric13", batch, 1) for batch in BATCHES)
        yield from (("episodes", "ring6", batch, 1) for batch in (16, 64, 256, 1024))
    if peers:
        yield ("same_closing", "-", 1024, 2)
        for step in ("2",) if quick else ("2", "4", "8"):
            yield ("mujoco_rollout", step, 64, 2)
        yield ("numba_closing", "every", 1024, 2)
        yield ("numba_closing", "skip", 1024, 2)
        yield ("jax_closing", "-", 64, 2)
        if not quick:
            yield ("scipy_fits", "superquadric11", 4, 1)
            yield ("scipy_fits", "superquadric13", 4, 1)
            yield ("mujoco_scipy_episode", "ring6", 1, 1)
        yield ("sklearn_free_forms", "known", 64, 1)
        yield ("sklearn_free_forms", "search", 8, 1)
        yield ("trimesh_distances", "ours", 100_000, 1)
        yield ("trimesh_distances", "trimesh", 500, 1)


def device_rows(*, quick: bool) -> Iterator[Row]:
    """What is measured on a device, and beside it on as many cores of its machine: kernels, and
    scores and episodes, whose processes share the device."""
    cores = core_count()
    for batch in (4096,) if quick else (4096, 65536, 262144):
        yield ("closings", "block", batch, cores)
    yield ("touches", "block", 1024 if quick else 16384, cores)
    yield ("metrics", "block", 256, cores)
    if not quick:
        yield from (("closings", of, 65536, cores) for of in ("lightbulb", "mesh"))
        yield from (("episodes", "ring6", AT_ONCE, workers) for workers in sorted({1, cores}))
        yield ("episodes", "even", AT_ONCE, cores)
        yield ("episodes", "coarse-to-fine", AT_ONCE, cores)


def bench(out: Path, *, quick: bool, peers: bool, only: Collection[str] = (),
          device: str = "cpu") -> int:
    """Measure every row, or those of the names `only`; `bench.jsonl` and `bench.md` in `out`.

    On a `device` that is no CPU they are `device_rows`. The lines go to stdout too. Raises
    StoreError for a name that no row has, and for peers on a device.
    """
    if peers and device != "cpu":
        raise StoreError("--peers: run on a CPU; leave --device out")
    every = rows(quick=quick, peers=peers) if device == "cpu" else device_rows(quick=quick)
    others = ("start", "study") if device == "cpu" else ()
    names = dict.fromkeys([*(row[0] for row in every), *others])
    for name in only:
        if name not in names:
            known = {row[0] for row in rows(quick=False, peers=True)}
            raise StoreError(f"--only: no row {name!r}" + (
                "" if name not in known else
                " with --quick or without --peers" if device == "cpu" else f" on {device}")
                + ("" if name in known else f"; {choose(name, names)}"))
    make_folder(out)
    head = {**describe_environment(device), "when": datetime.now(UTC).isoformat(timespec="seconds"),
            "cores": core_count(), "load": [round(v, 1) for v in os.getloadavg()]}
    lines = [{"row": "environment", **head}]
    _say(lines[0])
    for line in (_measured(quick, peers, only) if device == "cpu" else
                 _on_both(quick, only, device)):
        lines.append(line)
        _say(line)
        # After every row: who stops it keeps what was measured.
        write_atomic(out / "bench.jsonl", "".join(json.dumps(v) + "\n" for v in lines).encode())
        write_atomic(out / "bench.md", markdown(lines).encode())
    return 0 if all("failed" not in line for line in lines) else 1


def _measured(quick: bool, peers: bool, only: Collection[str]) -> Iterator[dict[str, Any]]:
    for row in rows(quick=quick, peers=peers):
        if not only or row[0] in only:
            yield _measure(row, quick)
    for name, others in (("start", _starts), ("study", studies)):
        if not only or name in only:
            yield from others(quick=quick)


def _on_both(quick: bool, only: Collection[str], device: str) -> Iterator[dict[str, Any]]:
    for row in device_rows(quick=quick):
        if not only or row[0] in only:
            yield from (_measure(row, quick, where) for where in ("cpu", device))


def _measure(row: Row, quick: bool, device: str = "") -> dict[str, Any]:
    """One row; processes run side by side, their rates added."""
    what, of, batch, threads = row
    split = what in _PROCESSES
    environment = {**os.environ, **ENVIRONMENT,
                   "WARPGRASP_THREADS": str(1 if split else threads)}
    if what == "jax_closing":  # its threads are XLA's
        environment = {**os.environ, "WARPGRASP_THREADS": str(threads),
                       "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=true"}
    command = [sys.executable, "-m", "sweeps.bench.rows", what, of, str(batch)]
    command += [*(["--quick"] if quick else []), *(["--device", device] if device else [])]
    running = [subprocess.Popen(command, env=environment, stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, text=True)
               for _ in range(threads if split else 1)]
    measured: list[dict[str, Any]] = []
    failed = ""
    for process in running:
        try:
            said, errors = process.communicate(timeout=_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            said, errors = "", f"took longer than {_TIMEOUT_S:g} s"
        if process.returncode == 0 and said.strip():
            measured.append(json.loads(said.strip().splitlines()[-1]))
        else:
            failed = (errors.strip().splitlines() or ["failed"])[-1]
    if failed:
        return {"row": what, "of": of, "batch": batch, "threads": threads, "failed": failed,
                **({"device": device} if device else {})}
    line = {**measured[0], "threads": threads}
    for key in ("per_s", "count"):
        line[key] = sum(m[key] for m in measured)
    for key in ("per_s", "per_cpu_s"):
        line[key] = float(f"{line[key]:.4g}")
    return line


def _starts(*, quick: bool) -> Iterator[dict[str, Any]]:
    """Cold and warm start of the command line [s]; cold is with empty caches of programs."""
    command = shutil.which("warpgrasp") or str(Path(sys.executable).parent / "warpgrasp")
    with tempfile.TemporaryDirectory() as folder:
        empty = {"WARP_CACHE_PATH": f"{folder}/warp", "XDG_CACHE_HOME": folder}
        explore = ["explore", "block", "--strategy", "ring6", "-o", f"{folder}/out"]
        yield _start("help", [command, "--help"], {})
        if not quick:
            yield _start("explore cold", [command, *explore], empty)
        yield _start("explore warm", [command, *explore], {} if quick else empty, again=quick)


def _start(name: str, command: list[str], extra: Mapping[str, str], again: bool = False
           ) -> dict[str, Any]:
    environment = {**os.environ, **extra}
    if again:
        subprocess.run(command, env=environment, capture_output=True, check=False)
    begin, before = time.perf_counter(), os.times()
    done = subprocess.run(command, env=environment, capture_output=True, check=False)
    after = os.times()
    line = {"row": "start", "of": name, "s": round(time.perf_counter() - begin, 2),
            "cpu_s": round(after.children_user + after.children_system
                           - before.children_user - before.children_system, 2)}
    return line if done.returncode == 0 else {**line, "failed": done.stderr.decode()[-200:]}


def _say(line: Mapping[str, Any]) -> None:
    print(json.dumps(line), flush=True)
