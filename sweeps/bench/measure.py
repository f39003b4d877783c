"""How a benchmark row is measured: the first call apart, then the median of some more.

A row is measured in a process of its own, so that its peak memory and its first call (compiled
programs from the caches) are its own. Rates are given by the clock and by processor time: on a
machine that is busy with other things the second is the more reliable.
"""

import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

_RUNS = 3
_LEAST_S = 1.0
_LONG_S = 25.0
"""Of a call that takes longer, one more is measured, not three: adaptive planners took an hour."""

SEED = 7
_POINTS = 60
_BODIES = 256
"""Made at a time: more would take memory that would be counted as the row's."""


@dataclass(frozen=True)
class Workload:
    """What a row measures: a call that returns how many items it processed."""

    unit: str
    call: Callable[[], int]
    extra: dict[str, Any] = field(default_factory=dict)


def measure(work: Workload, *, quick: bool = False) -> dict[str, Any]:
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
    kept = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    peak = kept / (2**20 if sys.platform == "darwin" else 2**10)
    return {"unit": work.unit, "count": count, "first_s": round(first, 3),
            "per_s": count / statistics.median(clock),
            "per_cpu_s": count / max(statistics.median(cpu), 1e-9), "peak_MiB": round(peak),
            **work.extra}


def mesh_body():
    """A baked mesh: an ellipsoid of 5,120 faces, 60 x 80 x 120 mm."""
    import trimesh

    from warpgrasp.objects.mesh_import import body_from_mesh

    mesh = trimesh.creation.icosphere(subdivisions=4)
    mesh.apply_scale([0.030, 0.040, 0.060])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ellipsoid.ply"
        mesh.export(path)
        return body_from_mesh(path, units="m")


def bodies_touched(n: int):
    """Random upright superquadrics, and 60 touches with 1 mm noise on each, (n, 60, 3) [m]."""
    from fit.arrays import rows_of
    from fit.superquadric.geometry import superquadric, superquadric_areas

    rng = np.random.default_rng(SEED)
    size, yaw = rng.uniform(0.02, 0.06, (n, 3)), rng.uniform(-np.pi, np.pi, n)
    place = np.stack([np.full(n, 0.45), np.zeros(n), size[:, 2]], 1)
    turn = np.stack([0 * yaw, 0 * yaw, np.sin(yaw / 2), np.cos(yaw / 2)], 1)
    body = superquadric(size, rng.uniform(0.1, 1.0, (n, 2)), place, turn, np.zeros((n, 2)),
                        np.zeros((n, 2)))
    chosen = []
    for first in range(0, n, _BODIES):
        surface, area = superquadric_areas(rows_of(body, slice(first, first + _BODIES)), 1500)
        weight = area * (surface[..., 2] > 0.2 * size[first:first + _BODIES, None, 2])
        chosen += [p[rng.choice(len(p), _POINTS, p=w / w.sum())]
                   for p, w in zip(surface, weight, strict=True)]
    chosen = np.stack(chosen)
    return body, chosen + 1e-3 * rng.standard_normal(chosen.shape)
