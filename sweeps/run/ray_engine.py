"""The same units on a Ray cluster: tasks compute batches of them, this process writes the files.

Rows travel back as the bytes of the units' files, so nodes need no common folder for results; they
need this package, and meshes and pose files at the paths where the spec found them.
"""

import os
import time
import traceback
from collections.abc import Callable, Sequence
from typing import Any

from sweeps.output import extra_hint, write_atomic
from sweeps.run.changed_files import ChangedFilesError
from sweeps.run.local_engine import (
    Options,
    as_a_worker,
    disk_error,
    terminated_as_interrupted,
)
from sweeps.run.plan import Plan, Unit
from sweeps.run.progress import Progress
from sweeps.run.scheduler import Outcome, UnitQueue
from sweeps.run.store import Store
from sweeps.run.unit_file import encode_files
from sweeps.run.worker import ENVIRONMENT, find_function, run_units
from sweeps.spec.cell import own_code
from sweeps.spec.errors import StoreError, short
from warpgrasp.core.plain_text import on_one_line

LOST_TASK_RETRIES = 4  # a node that goes away is no fault of the unit
AHEAD = 2  # tasks in hand for each core


def compute_units(
    units: list[Unit], function: str, device: str
) -> tuple[list[dict[str, bytes]], float] | ChangedFilesError | str:
    """Each unit's files by their folder and the seconds a unit took, or what was raised."""
    began = time.monotonic()
    try:
        found = run_units(find_function(function), units, device)
        files = [encode_files(unit.id, rows) for unit, rows in zip(units, found, strict=True)]
    except ChangedFilesError as error:
        return error
    except Exception:
        return traceback.format_exc()
    return files, (time.monotonic() - began) / len(units)


def run_on_ray(plan: Plan, store: Store, options: Options, progress: Progress,
               address: str | None,
               further: Callable[[], Sequence[Unit] | None] | None = None) -> Outcome:
    """Runs what is left of a study's shard on a cluster (`address`), or on this machine's cores.

    The caller holds the shard's lock. `further` is that of the local engine.
    """
    ray = _ray()
    _connect(ray, address, options.workers)
    try:
        work = UnitQueue(plan, store, options.shard, progress, options.verify,
                         options.unit_timeout_s, further)
        with terminated_as_interrupted():  # Ray has put a handler of its own in the place of ours
            _go(ray, work, options)
        work.count_files()
        return work.outcome
    finally:
        ray.shutdown()


def _connect(ray: Any, address: str | None, workers: int) -> None:
    """Joins the cluster at an address; without one, starts one here, whatever others run here.

    Raises StoreError where there is none at the address, or its form is none.
    """
    try:
        with as_a_worker():  # the nodes that it starts here, and their workers, inherit it
            ray.init(address=address or "local", num_cpus=None if address else workers,
                     include_dashboard=False, configure_logging=False, log_to_driver=False,
                     runtime_env={"env_vars": ENVIRONMENT})
    except (ConnectionError, ValueError) as error:
        if address is None:
            raise
        raise StoreError(f"--address: is {short(address)}; should be that of a running cluster, as "
                         "`ray start --head` prints it, or auto on a machine of it: "
                         f"{on_one_line(str(error))}") from None


def _go(ray: Any, work: UnitQueue, options: Options) -> None:
    gpus = float(options.device.startswith("cuda"))
    about = {"num_cpus": 1, "num_gpus": gpus, "max_retries": LOST_TASK_RETRIES}
    task = ray.remote(**about)(compute_units)
    # code of the user's leaves its process to no other units
    once = ray.remote(**about, max_calls=1)(compute_units)
    running: dict[Any, tuple[list[Unit], float]] = {}
    limit = AHEAD * options.unit_timeout_s  # it may wait for another before it begins
    while not work.over:
        room = AHEAD * max(1, int(ray.cluster_resources().get("CPU", 1)))
        while len(running) < room and (units := work.take(room)):
            of_kind = once if own_code(units[0].cell) else task
            reference = of_kind.remote(units, options.function, options.device)
            running[reference] = units, time.monotonic()
        ready, _ = ray.wait(list(running), num_returns=1, timeout=1.0) if running else ([], [])
        for reference in ready:
            _finish(ray, work, running.pop(reference)[0], reference)
        for reference in [r for r, (_, began) in running.items()
                          if time.monotonic() - began > limit]:
            ray.cancel(reference, force=True)
            work.failed(running.pop(reference)[0], "stopped: it took longer than "
                        f"{options.unit_timeout_s:g} s (--unit-timeout-s)", final=True)
        work.progress.tick(work.running)


def _finish(ray: Any, work: UnitQueue, units: list[Unit], reference: Any) -> None:
    try:
        result = ray.get(reference)
    except ray.exceptions.RayError as error:  # its process died, again and again
        result = f"the task was lost: {error}"
    if isinstance(result, ChangedFilesError):
        work.changed(units, str(result))
        return
    if isinstance(result, str):
        work.failed(units, result)
        return
    files, seconds = result
    for unit, contents in zip(units, files, strict=True):
        try:
            for folder, content in contents.items():
                write_atomic(work.store.folder / folder / work.store.path(unit).name, content)
        except OSError as error:
            raise disk_error(f"{work.store.path(unit)}: cannot be written: "
                             f"{error.strerror or error}") from None
        work.done(unit, seconds)


def _ray() -> Any:
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # it reports usage by default
    try:
        import ray  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise StoreError(f"--engine ray: Ray is not installed: {extra_hint('ray')}") from None
    return ray
