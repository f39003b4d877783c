"""Races in shards: each runs its share of every rung, and waits for the others' in the directory.

Every shard plans the whole race: which units a rung has follows from those before. A unit of a
shard that does not run (not started yet, or killed) falls to the first one that does. So shards may
start and end at any time, and one of them alone ends the race.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from sweeps.run.plan import LEAST_RUNS, Unit
from sweeps.run.store import Store

POLL_S = 0.5
"""The directory is listed as often as this, at most, while a shard waits."""


@dataclass
class SharedRungs:
    """The rungs of a race as one of several shards runs them."""

    rungs: Callable[[], Sequence[Unit]]
    """The units of the whole next rung; called when all of the last one are there."""
    store: Store
    shard: tuple[int, int]
    owner: dict[str, int] = field(default_factory=dict)  # shard of each unit of this rung
    rung: Sequence[Unit] = ()
    mine: set[str] = field(default_factory=set)  # ids of units that this shard was given
    looked: float = -POLL_S  # when it last had to wait

    def further(self) -> Sequence[Unit] | None:
        """The next units of this shard; None while it has to wait, none where the race is over."""
        if self.rung:
            if time.monotonic() < self.looked + POLL_S:
                return None
            if left := self._left():
                mine = [unit for unit in left if self._falls_to_me(unit)]
                self.looked = -POLL_S if mine else time.monotonic()
                return self._taken(mine) or None
        self.rung = self.rungs()
        index, count = self.shard
        run = max(1, len(self.rung) // (LEAST_RUNS * count))
        # What is asked for again was found damaged, here and maybe nowhere else.
        self.owner = {unit.id: index if unit.id in self.mine else 1 + number // run % count
                      for number, unit in enumerate(self.rung)}
        if not self.rung:
            return self.rung
        return self._taken([unit for unit in self.rung if self.owner[unit.id] == index]) or None

    def _left(self) -> list[Unit]:
        """The units of the rung that are neither there nor failed."""
        self.running = self._running()  # before the look: what ends in between is there
        there = self.store.unit_ids()
        return [unit for unit in self.rung
                if unit.id not in there and not self.store.log(unit).exists()]

    def _running(self) -> list[int]:
        """The shards that run now, in order, this one among them."""
        index, count = self.shard
        held = self.store.holders()
        return [n for n in range(1, count + 1) if n == index or f"{n}-of-{count}" in held]

    def _falls_to_me(self, unit: Unit) -> bool:
        """Whether nobody else will run a unit that is left."""
        index, _ = self.shard
        owner = self.owner[unit.id]
        return owner == index or (owner not in self.running and self.running[0] == index)

    def _taken(self, units: Sequence[Unit]) -> Sequence[Unit]:
        self.mine |= {unit.id for unit in units}
        return units
