"""A worker process: takes units from a pipe, runs them on one thread, writes their files.

Nothing heavy is imported at the top: the parent sets the environment that keeps JAX and Warp to
one thread, and only the worker itself imports them.
"""

import faulthandler
import importlib
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from sweeps.cell import Cell
from sweeps.plan import Unit
from sweeps.unit_file import Columns, write_unit

RunEpisodes = Callable[[Cell, np.ndarray, str], Columns]
SAY_WHERE = signal.SIGUSR1  # a worker answers with where each of its threads is, in its log
EPISODES = "sweeps.episodes:run_episodes"

# One thread each: two workers on two cores must not fight, and sums must not depend on threads.
ENVIRONMENT = {
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    "NPROC": "1",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "WARPGRASP_THREADS": "1",
    "PYTHONHASHSEED": "0",
}


def worker_environment(outer: Mapping[str, str]) -> dict[str, str]:
    """What a worker's environment adds to the one the command was started in."""
    found = dict(ENVIRONMENT)
    if outer.get("XLA_FLAGS"):
        found["XLA_FLAGS"] = f"{outer['XLA_FLAGS']} {found['XLA_FLAGS']}"
    return found


@dataclass(frozen=True)
class Report:
    """What a worker says: `ready` (`warm` if all is compiled), `done`, `error` (of a unit), `disk`,
    or `broken` (at start)."""

    kind: str
    text: str = ""


def work(pipe: Connection, function: str, device: str, log: Path) -> None:
    """The life of a worker: report ready, then a unit at a time until the pipe closes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C means
    _redirect_output(log)
    threading.Thread(target=_die_with_parent, daemon=True).start()
    try:
        run_episodes = find_function(function)
    except Exception:
        pipe.send(Report("broken", traceback.format_exc()))
        return
    programs = sys.modules.get("fit.program_cache")  # only where the episodes need it
    pipe.send(Report("ready", "warm" if programs and programs.any_kept() else ""))
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        if task is None:
            return
        unit, path = task
        pipe.send(_run_unit(run_episodes, unit, path, device))


def find_function(name: str) -> RunEpisodes:
    """The function of an importable name `module:function`."""
    module, _, attribute = name.partition(":")
    return getattr(importlib.import_module(module), attribute)


def run_unit(run_episodes: RunEpisodes, unit: Unit, device: str) -> Columns:
    """The rows of a unit; what names them comes from the unit itself."""
    episodes = np.arange(unit.start, unit.stop, dtype=np.int64)
    rows = run_episodes(unit.cell, episodes, device)
    count = len(episodes)
    named = {
        "episode": episodes,
        "strategy": np.full(count, unit.cell.strategy.name, object),
        "object": np.full(count, unit.cell.object_name, object),
        "seed": np.full(count, unit.cell.seed, np.int64),
    }
    short = {name: len(values) for name, values in rows.items() if len(values) != count}
    if short:
        raise ValueError(f"{count} episodes were asked for; columns hold {short}")
    return {**named, **{name: values for name, values in rows.items() if name not in named}}


def _run_unit(run_episodes: RunEpisodes, unit: Unit, path: Path, device: str) -> Report:
    began = time.monotonic()
    try:
        rows = run_unit(run_episodes, unit, device)
    except Exception:
        return Report("error", traceback.format_exc())
    try:
        write_unit(path, unit.id, rows)
    except OSError as error:
        return Report("disk", error.strerror or str(error))
    except Exception:
        return Report("error", traceback.format_exc())
    return Report("done", f"{time.monotonic() - began:.3f}")


def _redirect_output(log: Path) -> None:
    """Sends what libraries print to the worker's log; results on stdout stay clean."""
    try:
        descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
    except OSError:
        descriptor = os.open(os.devnull, os.O_WRONLY)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    os.close(descriptor)
    sys.stdout = os.fdopen(1, "w", buffering=1, closefd=False)
    sys.stderr = os.fdopen(2, "w", buffering=1, closefd=False)
    faulthandler.enable(sys.stderr)
    faulthandler.register(SAY_WHERE, sys.stderr)


def _die_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
