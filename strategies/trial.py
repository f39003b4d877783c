"""A user's file is run in a copy of this process first: what kills the copy becomes a message.

Python cannot catch the signals of a crash in native code, or of a system that is short of memory.
"""

import os
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from strategies.planners.planner_file import PlannerError

TRIED = 77
"""Exit code of a copy that came to the end, whether or not an error was raised on the way."""
CLOSED = 78
"""Of one whose output was closed so that it cannot be opened again."""
THREADS = Path("/proc/self/task")
OF_JEMALLOC = "jemalloc_bg_thd"
"""The thread of Arrow's allocator, which the allocator itself prepares for a copy of the process
(`pthread_atfork`)."""


def tried(call: str, run: Callable[[], object]) -> None:
    """Runs what `call` (`file.py:name`) names in a copy. Raises PlannerError if that ended it.

    What it raises is not told: it is raised again when it is run here. A process of several threads
    cannot be copied safely, so nothing is tried there; nor where the system does not list threads.
    """
    file, colon, _ = call.rpartition(":")
    if not (colon and file.endswith(".py")) or _threads() != 1:
        return
    copy = os.fork()
    if copy == 0:
        _run_and_end(run)
    try:
        code = os.waitstatus_to_exitcode(os.waitpid(copy, 0)[1])
    except BaseException:  # Ctrl-C
        with suppress(OSError):
            os.kill(copy, signal.SIGKILL)
        raise
    if code == CLOSED:
        raise PlannerError(f"{file}: closes files of the process that are not its own, such as by "
                           "os.closerange(3, 100), and its output with them")
    if code != TRIED:
        how = f"by {_signal_name(-code)}" if code < 0 else f"with exit code {code}"
        raise PlannerError(f"{file}: ended the process {how} when it was run; its top, and what "
                           "makes its planner, must come to an end as any program does")


def _run_and_end(run: Callable[[], object]) -> None:
    """The life of the copy: what it prints is printed when the file is run here."""
    leave = os._exit
    try:
        null = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(null, stream)
        run()
    finally:
        leave(TRIED if all(map(_is_open, (1, 2))) else CLOSED)


def _is_open(descriptor: int) -> bool:
    try:
        os.fstat(descriptor)
    except OSError:
        return False
    return True


def _threads() -> int:
    """How many threads this process has, without those that are made ready for a copy; 0 where the
    system does not tell."""
    try:
        names = [(thread / "comm").read_text().strip() for thread in THREADS.iterdir()]
    except OSError:
        return 0
    return len(names) - names.count(OF_JEMALLOC)


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
