"""How a benchmark row is measured: the first call apart, then the median of some more.

A row is measured in a process of its own, so that its peak memory and its first call (compiled
programs from the caches) are its own. Rates are given by the clock and by processor time: on a
machine that is busy with other things the second says more.
"""

import resource
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

_RUNS = 3
_LEAST_S = 1.0
_LONG_S = 25.0
"""Of a call that takes longer, one more is measured, not three: adaptive planners took an hour."""


@dataclass(frozen=True)
class Work:
    """What a row measures: a call that says how many things it did."""

    unit: str
    call: Callable[[], int]
    extra: dict[str, Any] = field(default_factory=dict)


def measure(work: Work, *, quick: bool = False) -> dict[str, Any]:
    """Rates of `work`: `first_s` of the first call, `per_s` and `per_cpu_s` of the median one."""
    begin = time.perf_counter()
    work.call()
    first = time.perf_counter() - begin
    clock, cpu, count = [], [], 0
    runs = 1 if quick or first > _LONG_S else _RUNS
    while len(clock) < runs or (sum(clock) < _LEAST_S and not quick):
        begin, cpu_begin = time.perf_counter(), time.process_time()
        count = work.call()
        clock.append(time.perf_counter() - begin)
        cpu.append(time.process_time() - cpu_begin)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"unit": work.unit, "count": count, "first_s": round(first, 3),
            "per_s": count / statistics.median(clock),
            "per_cpu_s": count / max(statistics.median(cpu), 1e-9), "peak_MiB": round(peak),
            **work.extra}
