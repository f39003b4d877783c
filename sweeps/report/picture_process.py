"""Figures drawn by a process of their own, beside the one that runs the episode.

matplotlib takes as long to import as a figure to draw. The process imports it while the episode
runs on another core, and then draws as many figures at once as it is given.

The two exchange pickles over pipes: functions of ours that draw, what they show as arrays, and PNG
files. Nothing but the files depends on the process: where it cannot be started or ends early, all
is drawn here.
"""

import importlib
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from types import TracebackType
from typing import Any, BinaryIO, Self

from warpgrasp.core.cores import core_count

Job = tuple[Callable[[Any], bytes], Any]
"""A function that draws, and what it shows; both can be pickled."""
Drawn = bytes | Exception
"""A file, or why there is none."""
IMPORTED = ("matplotlib.backends.backend_agg", "matplotlib.figure", "mpl_toolkits.mplot3d",
            "matplotlib.colorbar", "PIL.ImageDraw", "PIL.PngImagePlugin", "scipy.ndimage",
            "sweeps.figures.contacts", "sweeps.figures.faces", "sweeps.report.surfaces",
            "sweeps.figures.taxels")


class PictureProcess:
    """Use it as a context: what it was not asked to draw when that ends is not drawn."""

    def __init__(self) -> None:
        self._jobs: Sequence[Job] = ()
        self._process: subprocess.Popen[bytes] | None = None
        if core_count() < 2:
            return
        # Modules are found where they are here, and the folder the user is in is none of them.
        there = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
                 "OPENBLAS_NUM_THREADS": "1"}  # a process with one thread may fork
        with suppress(OSError):
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", f"from {__name__} import serve; serve()"], env=there,
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)

    def begin(self, jobs: Sequence[Job]) -> None:
        """Ask for figures, once."""
        self._jobs = jobs
        if self._process is not None and self._process.stdin is not None:
            with suppress(OSError), self._process.stdin as pipe:
                pickle.dump(list(jobs), pipe)

    def finish(self) -> list[Drawn]:
        """The figures that were asked for."""
        if self._process is not None and self._process.stdout is not None:
            with suppress(OSError, EOFError, pickle.UnpicklingError):
                drawn = pickle.load(self._process.stdout)
                if len(drawn) == len(self._jobs):
                    return drawn
        return [attempt(*job) for job in self._jobs]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        if self._process is not None:
            with suppress(OSError), self._process:  # which closes its pipes
                self._process.kill()


def attempt(draw: Callable[..., bytes], *shown: Any) -> Drawn:
    """A figure, or the error that there was."""
    try:
        return draw(*shown)
    except Exception as error:
        return error


def serve() -> None:
    """The process's side: reads what to draw, draws it, writes the files, and ends."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the user's interrupt ends the other process
    with suppress(ImportError):
        for name in IMPORTED:
            importlib.import_module(name)
    try:
        jobs: list[Job] = pickle.load(sys.stdin.buffer)
    except EOFError:
        return
    pickle.dump(_draw(jobs), sys.stdout.buffer)


def _draw(jobs: Sequence[Job]) -> list[Drawn]:
    """All figures at once where a process can be forked, the first one here."""
    if not hasattr(os, "fork"):
        return [attempt(*job) for job in jobs]
    others = [_forked(job) for job in jobs[1:]]
    drawn = [attempt(*job) for job in jobs[:1]]
    for job, pipe in zip(jobs[1:], others, strict=True):
        with pipe:
            try:
                drawn.append(pickle.load(pipe))
            except (OSError, EOFError, pickle.UnpicklingError):
                drawn.append(attempt(*job))
    return drawn


def _forked(job: Job) -> BinaryIO:
    """What a fork of this process writes: the file that it draws."""
    there, here = os.pipe()
    if os.fork():
        os.close(here)
        return os.fdopen(there, "rb")
    os.close(there)
    with suppress(BaseException), os.fdopen(here, "wb") as pipe:
        pickle.dump(attempt(*job), pipe)
    os._exit(0)
