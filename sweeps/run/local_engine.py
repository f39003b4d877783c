"""Running the units of a study that are not there yet, in worker processes.

The parent hands out batches of units (`scheduler`) and runs none itself. Where nothing was
compiled before, only one worker works until the first unit has come back: it fills the caches of
kernels and fits that the others then load, instead of all compiling the same.
"""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

from sweeps.run.plan import Plan, Unit
from sweeps.run.progress import Progress
from sweeps.run.scheduler import Outcome, UnitQueue
from sweeps.run.store import Store
from sweeps.run.worker import ENVIRONMENT, EPISODES, SAY_WHERE, Report, work
from sweeps.spec.errors import StoreError

EARLY_DEATHS = 2  # workers that may die before they are ready
UNIT_TIMEOUT_S = 3600.0  # a unit takes seconds; what takes this long hangs
SAY_WHERE_S = 0.5  # for a hanging worker to do so
LOG_TAIL = 20_000  # characters of a worker's output kept with a failed unit


@dataclass(frozen=True)
class Options:
    """How a study is run; none of it changes a result."""

    workers: int = 1
    shard: tuple[int, int] = (1, 1)
    device: str = "cpu"
    function: str = EPISODES
    unit_timeout_s: float = UNIT_TIMEOUT_S
    verify: bool = False


@dataclass
class _Slot:
    """One worker process and the units it holds."""

    process: BaseProcess
    pipe: Connection
    log: Path
    units: list[Unit] = field(default_factory=list)
    ready: bool = False
    warm: bool = False  # nothing is left to compile
    since: float = field(default_factory=time.monotonic)  # when it was started, or got its units


@dataclass
class _Run:
    work: UnitQueue
    options: Options
    slots: list[_Slot] = field(default_factory=list)
    early_deaths: int = 0

    def go(self) -> None:
        for number in range(1, self.work.at_least(self.options.workers) + 1):
            self.slots.append(self._start_worker(number))
        while True:
            self._hand_out()  # which may find that nothing was left
            if self.work.over:
                return
            ready = wait([slot.pipe for slot in self.slots], timeout=1.0)
            for number, slot in enumerate(self.slots):
                if slot.pipe in ready:
                    self.slots[number] = self._hear(slot, number + 1)
                elif self._hangs(slot):
                    self.slots[number] = self._replace(slot, number + 1, timed_out=True)
            self.work.progress.tick(self.work.running)

    def _start_worker(self, number: int) -> _Slot:
        context = get_context("spawn")
        mine, theirs = context.Pipe()
        index, count = self.options.shard
        log = self.work.store.logs / f"worker-{number}-shard-{index}-of-{count}.log"
        process = context.Process(
            target=work, args=(theirs, self.options.function, self.options.device, log),
            name=f"warpgrasp worker {number}", daemon=True)
        with as_a_worker():
            process.start()
        theirs.close()
        return _Slot(process, mine, log)

    def _hand_out(self) -> None:
        for slot in self.slots:
            may = self.work.tried_any or slot.warm or slot is self.slots[0]
            if not (may and slot.ready) or slot.units:
                continue
            cold = not (self.work.tried_any or slot.warm)
            slot.units = self.work.take(len(self.slots), self._in_hand(), cold=cold)
            slot.since = time.monotonic()
            if slot.units:
                paths = [self.work.store.path(unit) for unit in slot.units]
                with suppress(OSError):  # it has died, which its pipe will report
                    slot.pipe.send((slot.units, paths))

    def _in_hand(self) -> float:
        """About how many units the workers still have before them."""
        now = time.monotonic()
        return sum(max(0.0, len(slot.units) - (now - slot.since) / self.work.unit_s(slot.units[0]))
                   for slot in self.slots if slot.units)

    def _hear(self, slot: _Slot, number: int) -> _Slot:
        """Takes a worker's report; the slot to go on with comes back."""
        try:
            report: Report = slot.pipe.recv()
        except (EOFError, OSError):
            return self._replace(slot, number)
        if report.kind == "ready":
            slot.ready, slot.warm = True, report.text == "warm"
        elif report.kind == "broken":
            raise StoreError(f"a worker cannot start:\n{report.text.rstrip()}", 1)
        elif report.kind == "disk":
            raise disk_error(self.work.store, report.text)
        elif report.kind == "done":
            self.work.done(slot.units.pop(0), float(report.text))
        else:
            units, slot.units = slot.units, []
            self.work.failed(units, report.text)
        return slot

    def _hangs(self, slot: _Slot) -> bool:
        busy = bool(slot.units) or not slot.ready
        return busy and time.monotonic() - slot.since > self.options.unit_timeout_s

    def _replace(self, slot: _Slot, number: int, timed_out: bool = False) -> _Slot:
        """A worker died or hangs: its units have failed, a new worker takes its place."""
        if timed_out:
            _kill(slot)
        slot.process.join()
        slot.pipe.close()
        code = slot.process.exitcode
        if slot.units and timed_out:
            self.work.failed(slot.units, f"{_tail(slot.log)}\nstopped: it took longer than "
                             f"{self.options.unit_timeout_s:g} s (--unit-timeout-s)", final=True)
        elif slot.units:
            self.work.failed(slot.units, f"{_tail(slot.log)}\nthe worker died (exit code {code})")
        elif not slot.ready:
            self.early_deaths += 1
            if self.early_deaths > EARLY_DEATHS:
                raise StoreError(f"workers die at their start (exit code {code}); "
                                 f"see {slot.log}", 1)
        return self._start_worker(number)

    def stop(self) -> None:
        for slot in self.slots:
            with suppress(OSError):
                slot.pipe.close()  # an idle worker ends by itself
            if slot.units:
                slot.process.kill()
        for slot in self.slots:
            slot.process.join(5)
            if slot.process.is_alive():
                slot.process.kill()
                slot.process.join()
            for unit in slot.units:
                self.work.store.sweep_out(unit)


def run(plan: Plan, store: Store, options: Options, progress: Progress) -> Outcome:
    """Runs what is left of a study's shard; the caller holds the shard's lock."""
    current = _Run(UnitQueue(plan, store, options.shard, progress, options.verify,
                        options.unit_timeout_s), options)
    try:
        current.go()
    finally:
        current.stop()
    return current.work.outcome


def disk_error(store: Store, reason: str) -> StoreError:
    """A unit that could not be written ends the run: the next would meet the same."""
    return StoreError(f"{store.folder}: cannot be written: {reason}; finished units are kept, "
                      "the same command goes on from there", 1)


def _kill(slot: _Slot) -> None:
    """Ends a worker that hangs, after writing its stack to its log."""
    if slot.ready and slot.process.pid is not None:
        os.kill(slot.process.pid, SAY_WHERE)
        slot.process.join(SAY_WHERE_S)
    slot.process.kill()


def _tail(log: Path) -> str:
    try:
        return log.read_text(errors="replace")[-LOG_TAIL:]
    except OSError:
        return ""


@contextmanager
def as_a_worker() -> Iterator[None]:
    """The environment that a worker must find before it imports anything."""
    before = dict(os.environ)
    os.environ.update(ENVIRONMENT)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
