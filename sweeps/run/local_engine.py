"""Running the units of a study that are not there yet, in worker processes.

The parent hands out batches of units (`scheduler`) and runs none itself. Where nothing was
compiled before, only one worker works until the first unit has come back: it fills the caches of
kernels and fits that the others then load, instead of all compiling the same.

A worker that has run a planner or a reconstruct function of the user's runs no units of other
strategies after it: what that code did to its process stays with its own rows.
"""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from types import FrameType

from strategies.planners.planner_file import environment_without_planners
from sweeps.run.plan import Plan, Unit
from sweeps.run.progress import Progress
from sweeps.run.scheduler import Outcome, UnitQueue
from sweeps.run.store import Store
from sweeps.run.worker import ENVIRONMENT, EPISODES, SAY_WHERE, Report, work
from sweeps.spec.cell import own_code
from sweeps.spec.errors import StoreError
from warpgrasp.core.cache_file import cache_root, drop_cached
from warpgrasp.core.plain_text import counted

EARLY_DEATHS = 2  # workers that may die before they are ready
UNIT_TIMEOUT_S = 3600.0  # a unit takes seconds; what takes this long hangs
LOOK_S = 1.0  # between two looks at the workers, at most
STOPPED_S = 5.0  # between two looks: a batch system has suspended the run, and its workers
SAY_WHERE_S = 0.5  # for a hanging worker to do so
LOG_TAIL = 20_000  # characters of a worker's output kept with a failed unit
LOG_BYTES = 4 << 20  # a worker's log that grows beyond is cut to its end
CRASHES = {-number for number in (signal.SIGILL, signal.SIGSEGV, signal.SIGBUS, signal.SIGABRT,
                                  signal.SIGFPE)}


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
    sent: bool = False  # its units
    warm: bool = False  # nothing is left to compile
    own: str = ""  # code of the user's that it has run, and for which strategy
    since: float = field(default_factory=time.monotonic)  # when it was started, or got its units


@dataclass
class _Run:
    work: UnitQueue
    options: Options
    slots: list[_Slot] = field(default_factory=list)
    early_deaths: int = 0  # in a row
    crashes: int = 0
    draining: bool = False  # no more units are handed out
    looked: float = field(default_factory=time.monotonic)  # at the workers, last

    def go(self) -> None:
        while True:
            self._start_workers()
            self._hand_out()  # which may find that nothing was left
            if self.work.over:
                return
            ready = wait([slot.pipe for slot in self.slots], timeout=LOOK_S)
            self._leave_out_stops()
            for number, slot in enumerate(self.slots):
                if slot.pipe in ready:
                    self.slots[number] = self._hear(slot, number + 1)
                elif self._hangs(slot):
                    self.slots[number] = self._replace(slot, number + 1, timed_out=True)
                elif slot.process.exitcode is not None:  # what it forked may hold its pipe open
                    self.slots[number] = self._replace(slot, number + 1)
                _bound(slot.log)
            self.work.progress.tick(self.work.running)
            if self.draining and not any(slot.sent for slot in self.slots):
                return

    def _leave_out_stops(self) -> None:
        """Time in which this process stood still is not counted as the workers'."""
        now = time.monotonic()
        if now - self.looked > STOPPED_S:
            for slot in self.slots:
                slot.since = min(now, slot.since + now - self.looked)
        self.looked = now

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """Ctrl-C or SIGTERM: the units in hand are waited for; a second one does not wait."""
        if self.draining:
            raise KeyboardInterrupt
        self.draining = True
        count = sum(len(slot.units) for slot in self.slots if slot.sent)
        if not count:
            return
        now = time.monotonic()
        left = max([len(slot.units) * self.work.unit_s(slot.units[0]) - (now - slot.since)
                    for slot in self.slots if slot.sent], default=0.0)
        self.work.progress.say(
            f"interrupted: waiting for {counted(count, 'unit')} being run, about "
            f"{max(1.0, left):.0f} s (estimate); interrupt again to stop now, without them")

    def _start_workers(self) -> None:
        """As many as there is work for, which in a run decided in steps may come later."""
        if not self.draining:
            for number in range(len(self.slots), self.work.at_least(self.options.workers)):
                self.slots.append(self._start_worker(number + 1, first=True))

    def _start_worker(self, number: int, first: bool = False) -> _Slot:
        context = get_context("spawn")
        mine, theirs = context.Pipe()
        index, count = self.options.shard
        log = self.work.store.logs / f"worker-{number}-shard-{index}-of-{count}.log"
        process = context.Process(
            target=work, args=(theirs, self.options.function, self.options.device, log, first),
            name=f"warpgrasp worker {number}", daemon=True)
        with as_a_worker(), _interrupts_held():
            process.start()
        theirs.close()
        return _Slot(process, mine, log)

    def _hand_out(self) -> None:
        if self.draining:
            return
        for number, slot in enumerate(self.slots):
            may = self.work.tried_any or slot.warm or slot is self.slots[0]
            if not (may and slot.ready) or slot.units:
                continue
            cold = not (self.work.tried_any or slot.warm)
            units = self.work.take(len(self.slots), self._in_hand(), cold=cold)
            if not units:
                continue
            if slot.own and slot.own != own_code(units[0].cell):
                self._end(slot)
                slot = self.slots[number] = self._start_worker(number + 1)
            slot.units = units
            if slot.ready:
                self._send(slot)

    def _send(self, slot: _Slot) -> None:
        slot.since, slot.sent = time.monotonic(), True
        slot.own = slot.own or own_code(slot.units[0].cell)
        paths = [self.work.store.path(unit).absolute() for unit in slot.units]
        with suppress(OSError):  # it has died, which its pipe will report
            slot.pipe.send((slot.units, paths))

    def _in_hand(self) -> float:
        """About how many units the workers still have before them."""
        now = time.monotonic()
        return sum(max(0.0, len(slot.units) - (now - slot.since) / self.work.unit_s(slot.units[0]))
                   for slot in self.slots if slot.sent)

    def _hear(self, slot: _Slot, number: int) -> _Slot:
        """Takes a worker's report; the slot to go on with comes back."""
        try:
            report: Report = slot.pipe.recv()
        except (EOFError, OSError):
            return self._replace(slot, number)
        if report.kind == "ready":
            slot.ready, slot.warm, self.early_deaths = True, report.text == "warm", 0
            if slot.units and not self.draining:
                self._send(slot)
        elif report.kind == "broken":
            raise StoreError(f"a worker cannot start:\n{report.text.rstrip()}", 1)
        elif report.kind == "disk":
            if not (slot.own and self.work.store.takes_files()):
                raise disk_error(report.text)
            # it is code of the user's that keeps its process from writing
            units, slot.units, slot.sent = slot.units, [], False
            self.work.failed(units, report.text)
            return self._replace(slot, number)
        elif report.kind == "changed":
            units, slot.units, slot.sent = slot.units, [], False
            self.work.changed(units, report.text)
        elif report.kind == "done" and slot.units and report.unit == slot.units[0].id:
            self.work.done(slot.units.pop(0), float(report.text))
            slot.sent = bool(slot.units)
        elif report.kind == "done":  # of a unit that it does not have: it is not to be believed
            return self._replace(slot, number)
        else:
            units, slot.units, slot.sent = slot.units, [], False
            self.work.failed(units, report.text)
        return slot

    def _hangs(self, slot: _Slot) -> bool:
        busy = slot.sent or not slot.ready
        return busy and time.monotonic() - slot.since > self.options.unit_timeout_s

    def _replace(self, slot: _Slot, number: int, timed_out: bool = False) -> _Slot:
        """A worker died or hangs: its units have failed, a new worker takes its place."""
        if timed_out:
            _say_where(slot)
        self._end(slot)
        for unit in [unit for unit in slot.units if slot.sent and self.work.store.has(unit)]:
            slot.units.remove(unit)  # written, and died before its report
            self.work.done(unit, self.work.unit_s(unit))
        code = slot.process.exitcode
        dropped = code in CRASHES and not slot.own and self._drop_caches()
        if slot.units and timed_out:
            self.work.failed(slot.units, f"{_tail(slot.log)}\nstopped: it took longer than "
                             f"{self.options.unit_timeout_s:g} s (--unit-timeout-s)", final=True)
        elif slot.units and (dropped or not slot.sent):
            self.work.put_back(slot.units)
        elif slot.units:
            self.work.failed(slot.units, f"{_tail(slot.log)}\nthe worker died (exit code {code})")
        if not slot.ready and not dropped:
            self.early_deaths += 1
            if self.early_deaths > EARLY_DEATHS:
                raise StoreError(f"workers die at their start (exit code {code}); "
                                 f"see {slot.log}", 1)
        return self._start_worker(number)

    def _drop_caches(self) -> bool:
        """After a second crash, once: compiled programs may be what does not run here."""
        self.crashes += 1
        if self.crashes != 2:
            return False
        self.work.progress.say("workers have crashed twice: compiled programs and kernels are "
                               "thrown away and compiled again")
        from warpgrasp.core.kernel_cache import drop_kernels  # imports Warp

        drop_cached(cache_root() / "programs")
        drop_kernels("warpgrasp", "strategies", "sweeps")
        return True

    def _end(self, slot: _Slot) -> None:
        """Ends a worker and all that it has started."""
        slot.pipe.close()
        if slot.process.pid is not None:
            with suppress(OSError):
                os.killpg(slot.process.pid, signal.SIGKILL)
        slot.process.kill()
        slot.process.join()

    def stop(self) -> None:
        for slot in self.slots:
            self._end(slot)
            for unit in slot.units:
                self.work.store.sweep_out(unit)


def run(plan: Plan, store: Store, options: Options, progress: Progress,
        further: Callable[[], Sequence[Unit] | None] | None = None) -> Outcome:
    """Runs what is left of a study's shard; the caller holds the shard's lock.

    `further` gives the units of the next step of a run that is decided in steps (see `UnitQueue`).
    """
    current = _Run(UnitQueue(plan, store, options.shard, progress, options.verify,
                        options.unit_timeout_s, further), options)
    with _handled_by(current.interrupt):
        try:
            current.go()
        finally:
            current.stop()
    if current.draining:
        raise KeyboardInterrupt
    current.work.count_files()
    return current.work.outcome


def disk_error(reason: str) -> StoreError:
    """A unit that could not be written ends the run: the next would meet the same."""
    return StoreError(f"{reason}; finished units are kept, the same command goes on from there", 1)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Ctrl-C comes after it, and not to a process that is started in it."""
    resource_tracker.ensure_running()  # whose start would let it through
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _handled_by(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """SIGINT and SIGTERM go to a handler, where they are not ignored."""
    before = {}
    if threading.current_thread() is threading.main_thread():
        before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    taken = [number for number, old in before.items() if old is not signal.SIG_IGN]
    for number in taken:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, before[number])


@contextmanager
def terminated_as_interrupted() -> Iterator[None]:
    """A batch system's SIGTERM ends a run as Ctrl-C does: what is finished is kept."""
    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _say_where(slot: _Slot) -> None:
    """A worker that hangs writes its stack to its log."""
    if slot.ready and slot.process.pid is not None:
        with suppress(OSError):
            os.kill(slot.process.pid, SAY_WHERE)
        slot.process.join(SAY_WHERE_S)


def _bound(log: Path) -> None:
    """Cuts a log that has grown too long to its end; the worker goes on appending to it."""
    with suppress(OSError):
        if log.stat().st_size > LOG_BYTES:
            with log.open("r+b") as stream:
                stream.seek(-LOG_TAIL, os.SEEK_END)
                end = stream.read(LOG_TAIL)
                stream.truncate(0)
                stream.seek(0)
                stream.write(b"[the beginning is left out]\n" + end)


def _tail(log: Path) -> str:
    try:
        return log.read_text(errors="replace")[-LOG_TAIL:]
    except OSError:
        return ""


@contextmanager
def as_a_worker() -> Iterator[None]:
    """The environment that a worker must find before it imports anything; what a planner's file
    changed in this process is not for the others' workers."""
    before, clean = dict(os.environ), environment_without_planners()
    try:
        os.environ.clear()
        os.environ.update(clean | ENVIRONMENT)
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
