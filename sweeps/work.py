"""What a run still has to do, and what became of it: the part that every engine shares."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import groupby, islice
from math import inf

from sweeps.atomic import write_atomic
from sweeps.plan import Plan, Unit
from sweeps.progress import Progress
from sweeps.store import Store

ATTEMPTS = 2
MOST_UNITS = 8
"""Units handed out together: 512 episodes; twice as many save no more and take 0.2 GiB more."""
IN_HAND_S = 30.0
"""Seconds of work handed out together: what a kill may lose, of each worker. With ten,
`coarse-to-fine` is run some 200 at once, which takes it a fifth longer than 512 (reckoned)."""


@dataclass
class Outcome:
    """What a run did, in units."""

    kept: int = 0  # were there already
    done: int = 0
    failed: int = 0


@dataclass
class Work:
    """The units of a shard, handed out in batches: units of one cell, to be run in one call.

    A batch that fails is handed out again unit by unit, which counts against none of them. A unit
    that fails alone is handed out once more; the second time it is set aside as failed, with its
    log, and the rest goes on.
    """

    plan: Plan
    store: Store
    shard: tuple[int, int]
    progress: Progress
    verify: bool = False  # read every row of what is there, not just the files' ends
    unit_timeout_s: float = inf  # a batch should end long before
    outcome: Outcome = field(default_factory=Outcome)
    again: deque[Unit] = field(default_factory=deque)
    attempts: dict[str, int] = field(default_factory=dict)
    in_hand: set[str] = field(default_factory=set)
    seconds: dict[str, float] = field(default_factory=dict)  # a unit of a strategy took last
    alone: set[str] = field(default_factory=set)  # cells of which a batch has failed
    exhausted: bool = False

    def __post_init__(self) -> None:
        self.cells = groupby(self.plan.units(self.shard), key=lambda unit: unit.cell_hash)
        self.fresh: Iterator[Unit] = iter(())  # of the cell under way
        self.left_behind = self.store.left_behind()
        index, count = self.shard
        self.ahead = len(range(index - 1, self.plan.unit_count, count))  # not looked at yet

    def take(self, workers: int = 1) -> list[Unit]:
        """What one of `workers` should do next, retries first; nothing where nothing is left.

        Units that are there are counted and passed over.
        """
        if self.again:
            batch = [self.again.popleft()]
            self.in_hand.add(batch[0].id)
            return batch
        while not (batch := list(islice(self.fresh, 1))):
            _, units = next(self.cells, (None, None))
            if units is None:
                self.exhausted = True
                return []
            self.fresh = self._missing(units)
        return batch + list(islice(self.fresh, self._room(batch[0], workers) - 1))

    def _missing(self, units: Iterator[Unit]) -> Iterator[Unit]:
        for unit in units:
            self.ahead -= 1
            known = unit.id in self.in_hand or unit.id in self.attempts
            if known or self._is_there(unit):
                self.outcome.kept += 1
                self.progress.kept()
            else:
                if unit.id in self.left_behind:
                    self.store.sweep_out(unit)
                self.in_hand.add(unit.id)
                yield unit

    def _room(self, unit: Unit, workers: int) -> int:
        """How many units to hand out with this one as the first.

        One where it is not known yet how long they take; towards the end a worker's share of what
        is left, ever fewer, so that none is idle long while another has many. Planners of one's own
        are called for a unit at a time, since they need not keep worlds apart.
        """
        seconds = self.seconds.get(unit.cell.strategy.name, inf)
        if unit.cell.strategy.call or unit.cell_hash in self.alone:
            return 1
        short = min(IN_HAND_S, self.unit_timeout_s / 4) / max(seconds, 1e-9)
        return int(max(1, min(MOST_UNITS, short, (self.ahead + 1) / workers)))

    def _is_there(self, unit: Unit) -> bool:
        return self.store.read(unit) is not None if self.verify else self.store.has(unit)

    @property
    def over(self) -> bool:
        """Whether nothing is left and nothing is in hand."""
        return self.exhausted and not self.again and not self.in_hand

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
        self.in_hand.discard(unit.id)
        self.seconds[unit.cell.strategy.name] = seconds
        self.outcome.done += 1
        self.store.log(unit).unlink(missing_ok=True)
        self.progress.done(unit.stop - unit.start)

    def failed(self, batch: list[Unit], text: str, final: bool = False) -> None:
        """A call raised, its worker died, or (`final`: it is not tried again) its time ran out."""
        if len(batch) > 1:  # nobody can tell whose fault it was
            self.alone.add(batch[0].cell_hash)
            self.attempts |= {unit.id: 0 for unit in batch}
            self.put_back(batch)
            return
        unit = batch[0]
        self.in_hand.discard(unit.id)
        self.attempts[unit.id] = self.attempts.get(unit.id, 0) + 1
        if self.attempts[unit.id] < ATTEMPTS and not final:
            self.again.append(unit)
            return
        self.outcome.failed += 1
        about = (f"strategy {unit.cell.strategy.name}, object {unit.cell.object_name}, setting "
                 f"{dict(unit.cell.setting)}, episodes {unit.start} to {unit.stop - 1}")
        write_atomic(self.store.log(unit), f"{about}\n\n{text}\n".encode())
        reason = text.rstrip().rpartition("\n")[2]
        self.progress.failed(f"unit set aside as failed: {about}: {reason[:200]}")
