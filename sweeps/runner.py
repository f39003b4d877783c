"""Running the units of a study that are not there yet, in worker processes.

The parent hands out one unit at a time and never imports the simulator. A unit whose worker dies
or raises is tried once more; the second time it is set aside as failed, with its log, and the
rest goes on. Until the first unit is finished only one worker works: it fills the kernel and
XLA caches that the others then load, instead of all compiling the same.
"""

import os
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

from sweeps.atomic import write_atomic
from sweeps.plan import Plan, Unit
from sweeps.progress import Progress
from sweeps.store import Store, StoreError
from sweeps.worker import ENVIRONMENT, EPISODES, Report, work

ATTEMPTS = 2
LOG_TAIL = 20_000  # characters of a worker's output kept with a failed unit


@dataclass(frozen=True)
class Options:
    """How a study is run; none of it changes a result."""

    workers: int = 1
    shard: tuple[int, int] = (1, 1)
    device: str = "cpu"
    function: str = EPISODES


@dataclass
class Outcome:
    """What a run did, in units."""

    kept: int = 0  # were there already
    done: int = 0
    failed: int = 0


@dataclass
class _Slot:
    """One worker process and the unit it holds."""

    process: BaseProcess
    pipe: Connection
    log: Path
    unit: Unit | None = None
    ready: bool = False


@dataclass
class _Run:
    plan: Plan
    store: Store
    options: Options
    progress: Progress
    outcome: Outcome = field(default_factory=Outcome)
    slots: list[_Slot] = field(default_factory=list)
    again: deque[Unit] = field(default_factory=deque)
    attempts: dict[str, int] = field(default_factory=dict)
    early_deaths: int = 0
    exhausted: bool = False

    def __post_init__(self) -> None:
        self.fresh = self.plan.units(self.options.shard)

    def next_unit(self) -> Unit | None:
        """What to do next, retries first; units that are there are counted and passed over."""
        if self.again:
            return self.again.popleft()
        for unit in self.fresh:
            held = any(slot.unit and slot.unit.id == unit.id for slot in self.slots)
            tried = self.attempts.get(unit.id, 0) > 0
            if not (held or tried or self.store.read(unit) is not None):
                return unit
            self.outcome.kept += 1
            self.progress.kept()
        self.exhausted = True
        return None

    def start_worker(self) -> _Slot:
        context = get_context("spawn")
        mine, theirs = context.Pipe()
        index, count = self.options.shard
        number = len(self.slots) + 1
        log = self.store.logs / f"worker-{number}-shard-{index}-of-{count}.log"
        process = context.Process(
            target=work, args=(theirs, self.options.function, self.options.device, log),
            name=f"warpgrasp worker {number}", daemon=True)
        with _environment():
            process.start()
        theirs.close()
        return _Slot(process, mine, log)

    def go(self) -> None:
        first = [unit for _ in range(self.options.workers) if (unit := self.next_unit())]
        self.again.extend(first)
        for _ in first:
            self.slots.append(self.start_worker())
        while not self.exhausted or self.again or self._busy():
            self._hand_out()
            ready = wait([slot.pipe for slot in self.slots], timeout=1.0)
            for slot in [slot for slot in self.slots if slot.pipe in ready]:
                self._hear(slot)
            self.progress.tick(self._busy())

    def _busy(self) -> int:
        return sum(slot.unit is not None for slot in self.slots)

    def _hand_out(self) -> None:
        warm = self.outcome.done > 0 or bool(self.attempts)
        for slot in self.slots if warm else self.slots[:1]:
            if slot.ready and slot.unit is None and (unit := self.next_unit()):
                self.store.sweep_out(unit)
                slot.unit = unit
                with suppress(OSError):  # it has died: its pipe says so in a moment
                    slot.pipe.send((unit, self.store.path(unit)))

    def _hear(self, slot: _Slot) -> None:
        try:
            report: Report = slot.pipe.recv()
        except (EOFError, OSError):
            self._bury(slot)
            return
        unit, slot.unit = slot.unit, None
        if report.kind == "ready":
            slot.ready = True
        elif report.kind == "broken":
            raise StoreError(f"a worker cannot start:\n{report.text.rstrip()}", 1)
        elif report.kind == "disk":
            raise StoreError(f"{self.store.folder}: cannot be written: {report.text}; finished "
                             "units are kept, the same command goes on from there", 1)
        elif unit is not None and report.kind == "done":
            self.outcome.done += 1
            self.store.log(unit).unlink(missing_ok=True)
            self.progress.done(unit.stop - unit.start)
        elif unit is not None:
            self._tried(unit, report.text)

    def _bury(self, slot: _Slot) -> None:
        """A worker died: its unit is tried again, a new worker takes its place."""
        slot.process.join()
        slot.pipe.close()
        code = slot.process.exitcode
        if slot.unit is not None:
            self._tried(slot.unit, f"the worker died (exit code {code})\n{_tail(slot.log)}")
        elif not slot.ready:
            self.early_deaths += 1
            if self.early_deaths > ATTEMPTS:
                raise StoreError(f"workers die at their start (exit code {code}); "
                                 f"see {slot.log}", 1)
        place = self.slots.index(slot)
        self.slots.remove(slot)
        self.slots.insert(place, self.start_worker())

    def _tried(self, unit: Unit, text: str) -> None:
        self.attempts[unit.id] = self.attempts.get(unit.id, 0) + 1
        if self.attempts[unit.id] < ATTEMPTS:
            self.again.append(unit)
            return
        self.outcome.failed += 1
        about = (f"strategy {unit.cell.strategy.name}, object {unit.cell.object_name}, setting "
                 f"{dict(unit.cell.setting)}, episodes {unit.start} to {unit.stop - 1}")
        write_atomic(self.store.log(unit), f"{about}\n\n{text}\n".encode())
        reason = text.rstrip().rpartition("\n")[2]
        self.progress.failed(f"unit set aside as failed: {about}: {reason[:200]}")

    def stop(self) -> None:
        for slot in self.slots:
            with suppress(OSError):
                slot.pipe.close()  # an idle worker ends by itself
            if slot.unit is not None:
                slot.process.kill()
        for slot in self.slots:
            slot.process.join(5)
            if slot.process.is_alive():
                slot.process.kill()
                slot.process.join()
            if slot.unit is not None:
                self.store.sweep_out(slot.unit)


def run(plan: Plan, store: Store, options: Options, progress: Progress) -> Outcome:
    """Runs what is left of a study's shard; the caller holds the shard's lock."""
    current = _Run(plan, store, options, progress)
    try:
        current.go()
    finally:
        current.stop()
    return current.outcome


def _tail(log: Path) -> str:
    try:
        return log.read_text(errors="replace")[-LOG_TAIL:]
    except OSError:
        return ""


@contextmanager
def _environment() -> Iterator[None]:
    """The environment that a worker must find before it imports anything."""
    before = dict(os.environ)
    os.environ.update(ENVIRONMENT)
    if "XLA_FLAGS" in before:
        os.environ["XLA_FLAGS"] = f"{before['XLA_FLAGS']} {ENVIRONMENT['XLA_FLAGS']}"
    cache = Path(before.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "warpgrasp" / "jax"
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(cache))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0.3")
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
