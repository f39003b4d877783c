"""What a run still has to do, and what became of it: the part that every engine shares."""

from collections import deque
from dataclasses import dataclass, field

from sweeps.atomic import write_atomic
from sweeps.plan import Plan, Unit
from sweeps.progress import Progress
from sweeps.store import Store

ATTEMPTS = 2


@dataclass
class Outcome:
    """What a run did, in units."""

    kept: int = 0  # were there already
    done: int = 0
    failed: int = 0


@dataclass
class Work:
    """The units of a shard, handed out one at a time.

    A unit that fails is handed out once more; the second time it is set aside as failed, with its
    log, and the rest goes on.
    """

    plan: Plan
    store: Store
    shard: tuple[int, int]
    progress: Progress
    verify: bool = False  # read every row of what is there, not just the files' ends
    outcome: Outcome = field(default_factory=Outcome)
    again: deque[Unit] = field(default_factory=deque)
    attempts: dict[str, int] = field(default_factory=dict)
    in_hand: set[str] = field(default_factory=set)
    exhausted: bool = False

    def __post_init__(self) -> None:
        self.fresh = self.plan.units(self.shard)

    def take(self) -> Unit | None:
        """What to do next, retries first; units that are there are counted and passed over."""
        if self.again:
            unit = self.again.popleft()
            self.in_hand.add(unit.id)
            return unit
        for unit in self.fresh:
            known = unit.id in self.in_hand or unit.id in self.attempts
            if not (known or self._is_there(unit)):
                self.store.sweep_out(unit)
                self.in_hand.add(unit.id)
                return unit
            self.outcome.kept += 1
            self.progress.kept()
        self.exhausted = True
        return None

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

    def put_back(self, unit: Unit) -> None:
        """A unit that was taken and not begun."""
        self.in_hand.discard(unit.id)
        self.again.append(unit)

    def done(self, unit: Unit) -> None:
        """A unit has been written."""
        self.in_hand.discard(unit.id)
        self.outcome.done += 1
        self.store.log(unit).unlink(missing_ok=True)
        self.progress.done(unit.stop - unit.start)

    def failed(self, unit: Unit, text: str, final: bool = False) -> None:
        """A unit raised, its worker died, or (`final`: it is not tried again) its time ran out."""
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
