"""How many cores this process may use, and how many threads its kernels take."""

import os
from contextlib import suppress
from math import ceil
from pathlib import Path

THREADS = "WARPGRASP_THREADS"
"""The variable of the environment that says how many threads kernels take."""
QUOTA = Path("/sys/fs/cgroup/cpu.max")
"""What a container may use, of Linux's control groups (version 2): microseconds of processor time
in a period, or `max`; and the period."""


def core_count() -> int:
    """Cores that this process may use, at least 1: those that it is bound to, as batch systems of
    clusters bind their jobs, and no more than its container may use."""
    try:
        cores = len(os.sched_getaffinity(0))
    except AttributeError:  # not Linux
        cores = os.cpu_count() or 1
    granted = _granted()
    return cores if granted is None else min(cores, max(1, ceil(granted)))


def _granted() -> float | None:
    """Cores' worth of processor time that the container may use; None where nothing says so."""
    with suppress(OSError, ValueError):  # no such file, or `max`
        time, period = map(int, QUOTA.read_text().split())
        return time / period
    return None


def thread_count() -> int:
    """Threads that kernels take where nothing else is said: WARPGRASP_THREADS, or one a core that
    may be used. Raises ValueError where the variable is no whole number from 1."""
    given = os.environ.get(THREADS, "")
    if not given:
        return core_count()
    if not (given.isascii() and given.isdigit() and int(given) > 0):
        raise ValueError(f"{THREADS}: is {given!r}; should be a whole number from 1")
    return int(given)
