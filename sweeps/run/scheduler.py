"""What a run still has to do, and what became of it: the part that every engine shares."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from math import inf

from strategies.ready_made import run_together
from sweeps.output import write_atomic
from sweeps.run.estimate import episode_seconds, form_seconds
from sweeps.run.grown_units import begun, join, rest_of
from sweeps.run.plan import BLOCK, TOGETHER, Plan, Unit
from sweeps.run.progress import Progress
from sweeps.run.store import Store
from sweeps.spec.cell import batch_key, own_code
from sweeps.spec.errors import StoreError

ATTEMPTS = 2
MOST_EPISODES = TOGETHER * BLOCK
"""Handed out together; twice as many save no more and take 0.2 GiB more."""
IN_HAND_S = 30.0
"""Seconds of work handed out together: what a kill may lose, of each worker. With ten,
`coarse-to-fine` is run some 200 at once, which takes it a fifth longer than 512 (reckoned)."""
EPISODE_S = 0.05
"""What an episode of an order given in advance is taken to need until one of its strategy has come
back [est]; one of `coarse-to-fine` does, many at once."""


@dataclass
class Outcome:
    """What a run did, in units."""

    kept: int = 0  # were there already
    done: int = 0
    failed: int = 0
    lost: int = 0  # neither there nor failed, though the run ended


@dataclass
class UnitQueue:
    """The units of a shard, handed out in batches: units of one cell, or of cells that can be run
    in one call (`batch_key`).

    A batch that fails is handed out again unit by unit, which counts against none of them. A unit
    that fails alone is handed out once more; the second time it is set aside as failed, with its
    log, and the rest continues.
    """

    plan: Plan
    store: Store
    shard: tuple[int, int]
    progress: Progress
    verify: bool = False  # read every row of what is there, not just the files' ends
    unit_timeout_s: float = inf  # a batch should end long before
    further: Callable[[], Sequence[Unit] | None] | None = None
    """The next units of a run that is decided in steps; asked for when all that went before are
    there or have failed. An empty sequence ends it; None: not yet, ask again."""
    outcome: Outcome = field(default_factory=Outcome)
    again: deque[Unit] = field(default_factory=deque)
    attempts: dict[str, int] = field(default_factory=dict)
    in_hand: set[str] = field(default_factory=set)
    seconds: dict[str, float] = field(default_factory=dict)  # a unit of a strategy took last
    alone: set[str] = field(default_factory=set)  # cells of which a batch has failed
    spoilers: set[str] = field(default_factory=set)  # objects of which a unit has failed alone
    slow: set[str] = field(default_factory=set)  # units for which all was compiled
    exhausted: bool = False
    waiting: bool = False  # for what other shards have in hand

    def __post_init__(self) -> None:
        self.missing = self._missing(self.plan.units(self.shard))
        self.found: deque[Unit] = deque()  # missing, to be handed out before all others
        self.left_behind = self.store.left_behind()
        self.earlier = self.store.earlier()
        self.there = self.store.unit_ids() if self.earlier else set()
        self.parts: dict[str, tuple[Unit, Unit]] = {}  # by a rest's id: the part there, the whole
        self.ahead = self.plan.shard_size(self.shard)  # not looked at yet

    def at_least(self, count: int) -> int:
        """How many units are left to hand out, as far as up to `count` of them."""
        while len(self.found) < count:
            if unit := next(self.missing, None):
                self.found.append(unit)
            elif not self._take_step():
                break
        return min(count, len(self.found) + len(self.again))

    def _take_step(self) -> bool:
        """Goes on to the next step of a run, if nothing of the last one is left and it can."""
        if self.further is None or self.in_hand or self.again:
            return False
        units = self.further()
        self.waiting = units is None
        if units is None:
            return False
        if not units:
            self.further = None
            return False
        self.ahead, self.exhausted = len(units), False
        self.progress.more(len(units))
        self.missing = self._missing(units)
        return True

    def take(self, workers: int = 1, elsewhere: float = 0.0, cold: bool = False) -> list[Unit]:
        """The next units for one of `workers`, retries first; empty where none is left.

        `elsewhere` is about how many units the others still have before them; a `cold` worker
        gets one unit, whose time includes compilation. Units that exist are counted and skipped.
        """
        if self.again:
            batch = [self.again.popleft()]
            self.in_hand.add(batch[0].id)
            return batch
        if not self.at_least(1):
            return []
        batch = [self.found.popleft()]
        if cold:
            self.slow.add(batch[0].id)
        elif not self.outcome.done:
            self.progress.measure()
        room = 1 if cold else self._room(batch[0], workers, elsewhere)
        while len(batch) < room and self.at_least(1) and self._joins(batch, self.found[0]):
            batch.append(self.found.popleft())
        return batch

    def _joins(self, batch: list[Unit], unit: Unit) -> bool:
        """Whether a unit can be run together with a batch; what fills calls of its own does not
        meet other cells."""
        size = sum(other.stop - other.start for other in (*batch, unit))
        last = batch[-1]
        apart = {unit.cell.object_name, last.cell.object_name} & self.spoilers
        return size <= MOST_EPISODES and bool(unit.cell_hash == last.cell_hash or (
            last.stop % MOST_EPISODES and unit.cell_hash not in self.alone and not apart
            and batch_key(unit.cell) == batch_key(last.cell)))

    def unit_s(self, unit: Unit) -> float:
        """How long a unit should take [s]: what the last one of its strategy did."""
        strategy = unit.cell.strategy
        each = (episode_seconds(strategy, unit.cell.arm.kind, unit.cell.hand.kind)
                + unit.cell.fit.free_forms * form_seconds(strategy)
                if strategy.call else EPISODE_S)
        return self.seconds.get(strategy.name, each * (unit.stop - unit.start))

    def _missing(self, units: Iterable[Unit]) -> Iterator[Unit]:
        for unit in units:
            self.ahead -= 1
            known = unit.id in self.in_hand or unit.id in self.attempts
            if known or self._is_there(unit):
                self.outcome.kept += 1
                self.progress.kept()
            else:
                if unit.id in self.left_behind:
                    self.store.sweep_out(unit)
                if part := begun(unit, self.earlier, self.there):
                    whole, unit = unit, rest_of(unit, part)
                    if self._is_there(unit) and join(self.store, part, unit, whole):
                        self.outcome.kept += 1
                        self.progress.kept()
                        continue
                    self.parts[unit.id] = part, whole
                self.in_hand.add(unit.id)
                yield unit
        self.exhausted = True

    def _room(self, unit: Unit, workers: int, elsewhere: float) -> int:
        """How many units to hand out with this one as the first.

        At most a worker's share of all that is not done yet, so that all end together. Planners and
        reconstruct functions of one's own are called for a unit at a time, since they need not keep
        worlds apart.
        """
        together = not own_code(unit.cell) and run_together(
            unit.cell.strategy.call, unit.cell.fit.free_forms)
        if unit.cell_hash in self.alone or not together:
            return 1
        short = min(IN_HAND_S, self.unit_timeout_s / 4) / max(self.unit_s(unit), 1e-9)
        share = (1 + len(self.found) + self.ahead + elsewhere) / workers
        return max(1, min(int(short), round(share)))

    def count_files(self) -> None:
        """Counts what the run should have left and did not: files, not reports, are the record."""
        there = self.store.unit_ids()
        self.outcome.lost = sum(unit.id not in there for unit in self.plan.units(self.shard)
                                ) - self.outcome.failed

    def _is_there(self, unit: Unit) -> bool:
        return self.store.has(unit, self.verify)

    @property
    def over(self) -> bool:
        """Whether nothing is left and nothing is in hand (or found and still to be handed out).

        A run that is decided in steps may take its next one here.
        """
        return (self.exhausted and not self.again and not self.in_hand
                and not self._take_step() and not self.waiting)

    @property
    def running(self) -> int:
        """Units handed out that have not come back."""
        return len(self.in_hand) - len(self.found)

    @property
    def tried_any(self) -> bool:
        """Whether any unit has come back yet."""
        return bool(self.outcome.done or self.attempts)

    def put_back(self, batch: list[Unit]) -> None:
        """Units that were taken and not begun, or failed together: each is to be run alone."""
        for unit in batch:
            self.in_hand.discard(unit.id)
            self.again.append(unit)

    def done(self, unit: Unit, seconds: float) -> None:
        """A unit has been written; it took `seconds`, or its share of its batch's."""
        if not self.store.has(unit):
            self.failed([unit], "it was reported as done, and its file is not there")
            return
        if unit.id in self.parts:
            part, whole = self.parts.pop(unit.id)
            if not join(self.store, part, unit, whole):  # the part was damaged
                self.in_hand.discard(unit.id)
                self.again.append(whole)
                return
            self.store.log(whole).unlink(missing_ok=True)
        self.in_hand.discard(unit.id)
        self.outcome.done += 1
        self.store.log(unit).unlink(missing_ok=True)
        self.progress.done(unit.stop - unit.start)
        if unit.id in self.slow:
            self.progress.measure()
        else:
            self.seconds[unit.cell.strategy.name] = seconds

    def changed(self, batch: list[Unit], text: str) -> None:
        """Files that units read have changed. What is decided by scores ends there: StoreError."""
        if self.further is not None:
            raise StoreError(f"{text}; finished units are kept", 1)
        self.failed(batch, text, final=True)

    def failed(self, batch: list[Unit], text: str, final: bool = False) -> None:
        """A call raised, its worker died, or (`final`: it is not tried again) its time ran out."""
        if len(batch) > 1:  # it is unknown which unit was the cause
            self.alone |= {unit.cell_hash for unit in batch}
            self.attempts |= {unit.id: 0 for unit in batch}
            self.put_back(batch)
            return
        unit = batch[0]
        self.spoilers.add(unit.cell.object_name)
        self.in_hand.discard(unit.id)
        self.attempts[unit.id] = self.attempts.get(unit.id, 0) + 1
        if self.attempts[unit.id] < ATTEMPTS and not final:
            self.again.append(unit)
            return
        self.outcome.failed += 1
        about = (f"strategy {unit.cell.strategy.name}, object {unit.cell.object_name}, setting "
                 f"{dict(unit.cell.setting)}, episodes {unit.start} to {unit.stop - 1}")
        whole = self.parts[unit.id][1] if unit.id in self.parts else unit
        write_atomic(self.store.log(whole), f"{about}\n\n{text}\n".encode())
        reason = text.rstrip().rpartition("\n")[2]
        self.progress.failed(f"unit set aside as failed: {about}: {reason[:200]}")
