"""A worker process: takes batches of units from a pipe, runs each in one call on one thread, and
writes the units' files.

Nothing heavy is imported at the top: the parent sets the environment that keeps JAX and Warp to
one thread, and only the worker itself imports them.
"""

import ctypes
import faulthandler
import gc
import importlib
import os
import resource
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from strategies.planners.guarded_call import told_apart
from sweeps.run.changed_files import ChangedFilesError, check_files
from sweeps.run.plan import Unit
from sweeps.run.unit_file import Columns, write_files
from sweeps.spec.cell import ENDED, Cell, own_code

RunCells = Callable[[Sequence[tuple[Cell, np.ndarray]], str], list[Columns]]
"""Rows of each of some cells, of the episodes named with it; on a device."""
SAY_WHERE = signal.SIGUSR1  # a worker answers with where each of its threads is, in its log
EPISODES = "sweeps.episode.episodes:run_cells"
NAMED = ("episode", "strategy", "object", "seed")  # columns that a unit gives its rows
# One thread each: two workers on two cores must not fight, and sums must not depend on threads.
# What fits are compiled with is `fit.optimize.xla_flags`' and the same in all processes.
ENVIRONMENT = {
    "NPROC": "1",
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "WARPGRASP_THREADS": "1",
    "PYTHONHASHSEED": "0",
    # Fits are computed on a CPU; a JAX that finds a GPU would take most of its memory for nothing.
    "JAX_PLATFORMS": os.environ.get("JAX_PLATFORMS", "cpu"),
}


@dataclass(frozen=True)
class Report:
    """A worker's message: `ready` (`warm` if all is compiled), `done` (the next unit of its batch,
    by its id, and the seconds it took), `error` (of the rest of it), `changed` (files that it was
    to read), `disk`, or `broken` (at start)."""

    kind: str
    text: str = ""
    unit: str = ""


def work(pipe: Connection, function: str, device: str, log: Path, first: bool) -> None:
    """The life of a worker: report ready, then a batch at a time until the pipe closes.

    Only the `first` of its number in a run begins its log anew: a worker that takes the place of
    another keeps what that one's planners printed.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C means
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})  # held at its start
    os.setpgrp()  # so that what a planner starts can be ended with its worker
    os.register_at_fork(after_in_child=lambda: _leave_to(pipe))
    _redirect_output(log, first)
    if device == "cpu":
        _limit_memory()
    threading.Thread(target=_die_with_parent, daemon=True).start()
    gc.disable()  # imports make many objects and no garbage
    try:
        run_cells = find_function(function)
    except Exception:
        pipe.send(Report("broken", traceback.format_exc()))
        return
    gc.freeze()
    gc.enable()
    programs = sys.modules.get("fit.optimize.program_cache")  # only where the episodes need it
    pipe.send(Report("ready", "warm" if programs and programs.has_cached_programs() else ""))
    said = ""  # the strategy that the log names last
    while True:
        try:
            task = pipe.recv()
        except EOFError:
            return
        if task is None:
            return
        units, paths = task
        if own_code(units[0].cell) and units[0].cell.strategy.name != said:
            said = units[0].cell.strategy.name
            print(f"strategy {said}:")
        for report in _run_batch(run_cells, units, paths, device):
            pipe.send(report)


def find_function(name: str) -> RunCells:
    """The function of an importable name `module:function`."""
    module, _, attribute = name.partition(":")
    return getattr(importlib.import_module(module), attribute)


def run_units(run_cells: RunCells, units: Sequence[Unit], device: str) -> list[Columns]:
    """The rows of each of some units, from one call; their cells have one `batch_key`.

    They are the rows of a call for each, bit for bit. What names them comes from the units. Where
    a strategy failed the units are run alone, since its message may tell how many episodes ran
    together. Raises ChangedFilesError where files that the cells name are not what they were when
    the units were planned.
    """
    check_files(units)
    parts = [list(same) for _, same in groupby(units, key=lambda unit: unit.cell_hash)]
    asked = [(same[0].cell, np.concatenate(
        [np.arange(u.start, u.stop, dtype=np.int64) for u in same])) for same in parts]
    found = run_cells(asked, device)
    if len(units) > 1 and any("strategy_failed" in rows.get("status", ()) for rows in found):
        return [run_units(run_cells, [unit], device)[0] for unit in units]
    found = [_told_apart(run_cells, *part, rows, device)
             for part, rows in zip(asked, found, strict=True)]
    check_files(units)
    return [rows for same, (cell, episodes), columns in zip(parts, asked, found, strict=True)
            for rows in _rows_of_units(same, cell, episodes, columns)]


def _told_apart(run_cells: RunCells, cell: Cell, episodes: np.ndarray, rows: Columns, device: str
                ) -> Columns:
    """The rows of a cell, those of episodes run again that one error of the strategy ended."""
    def again(some: np.ndarray) -> np.ndarray:
        nonlocal rows
        found, = run_cells([(cell, episodes[some])], device)
        ended = found.pop(ENDED, np.zeros(len(some), bool))
        source = np.arange(len(episodes))
        source[some] = len(episodes) + np.arange(len(some))
        rows = {name: np.concatenate([values, found[name]])[source]
                for name, values in rows.items()}
        return some[ended]

    told_apart(np.flatnonzero(rows.pop(ENDED, np.zeros(len(episodes), bool))), again)
    return rows


def _rows_of_units(
    units: Sequence[Unit], cell: Cell, episodes: np.ndarray, rows: Columns
) -> list[Columns]:
    """Each unit's share of the rows of its cell."""
    count = len(episodes)
    short = {name: len(values) for name, values in rows.items() if len(values) != count}
    if short:
        raise ValueError(f"{count} episodes were asked for; columns hold {short}")
    rows = {"episode": episodes, "strategy": np.full(count, cell.strategy.name, object),
            "object": np.full(count, cell.object_name, object),
            "seed": np.full(count, cell.seed, np.int64)} | {
        name: values for name, values in rows.items() if name not in NAMED}
    ends = np.cumsum([unit.stop - unit.start for unit in units])
    return [{name: values[end - (unit.stop - unit.start):end] for name, values in rows.items()}
            for unit, end in zip(units, ends, strict=True)]


def _run_batch(run_cells: RunCells, units: Sequence[Unit], paths: Sequence[Path],
               device: str) -> Iterator[Report]:
    """Writes the units' files in turn, with a report on each."""
    began = time.monotonic()
    try:
        found = run_units(run_cells, units, device)
        for unit, path, rows in zip(units, paths, found, strict=True):
            try:
                write_files(path, unit.id, rows)
            except OSError as error:
                yield Report("disk", f"{path}: cannot be written: {error.strerror or error}")
                return
            yield Report("done", f"{(time.monotonic() - began) / len(units):.6f}", unit.id)
    except ChangedFilesError as error:
        yield Report("changed", str(error))
    except Exception:
        yield Report("error", traceback.format_exc())


def _redirect_output(log: Path, first: bool) -> None:
    """Sends what libraries print to the worker's log; results on stdout stay clean."""
    try:
        anew = os.O_TRUNC if first else 0
        descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | anew | os.O_APPEND, 0o644)
    except OSError:
        descriptor = os.open(os.devnull, os.O_WRONLY)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    os.close(descriptor)
    sys.stdout = os.fdopen(1, "w", buffering=1, closefd=False)
    sys.stderr = os.fdopen(2, "w", buffering=1, closefd=False)
    faulthandler.enable(sys.stderr)
    faulthandler.register(SAY_WHERE, sys.stderr)


_PR_SET_PDEATHSIG = 1  # of Linux's prctl


def _leave_to(pipe: Connection) -> None:
    """In a process that a planner forked: it does not report, and ends with the worker."""
    with suppress(OSError):
        pipe.close()
    with suppress(OSError, AttributeError):  # not Linux
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


def _limit_memory() -> None:
    """An allocation beyond the machine's memory fails in its worker, as MemoryError."""
    limit = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    with suppress(OSError, ValueError):  # no such file, or "max"
        limit = min(limit, int(Path("/sys/fs/cgroup/memory.max").read_text()))
    with suppress(OSError, ValueError):
        resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))


def _die_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os.killpg(0, signal.SIGKILL)
