"""A race under way: what the engine asks for the next units, rung by rung."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from sweeps.analysis.entries import HIGHER_IS_BETTER, LeaderboardError, bounds_of
from sweeps.output import note
from sweeps.race.elimination import Look, Part, Race, Rules
from sweeps.race.race_note import write_race_note
from sweeps.race.race_units import RaceUnits
from sweeps.race.verdict import amount, verdict_of
from sweeps.run.local_engine import Options, run
from sweeps.run.plan import Plan, Unit
from sweeps.run.progress import Progress
from sweeps.run.scheduler import Outcome
from sweeps.run.store import Store
from sweeps.spec.errors import StoreError
from warpgrasp.core.plain_text import counted, first_few


@dataclass
class Course:
    """A race under way: what the engine asks for the next units."""

    race: Race
    units: RaceUnits
    until: float = float("inf")
    """The time of `time.monotonic` after which no rung begins."""
    late: bool = False
    asked: list[Part] = field(default_factory=list)
    again: set[str] = field(default_factory=set)  # ids of units that were found damaged

    @property
    def whole(self) -> Plan:
        """The units that were asked for so far, as a plan."""
        return self.units.plan

    def why_nothing(self, episodes: int | None) -> str:
        """Why no rung was run with this budget."""
        count = len(self.units.entries)
        return (f"--budget-episodes: is {episodes}; the first rung of {count:,} entries takes "
                f"{2 * count * self.units.episodes_each:,} episodes")

    def further(self) -> Sequence[Unit]:
        """Takes in the rung that has been run, and gives the units of the next. Raises
        LeaderboardError where nothing has a score on an object: its cost would be made up."""
        if self.asked:
            found, unknown = self.units.scores(self.asked)
            if damaged := self.units.missing:
                return self._once_more(damaged)
            if lost := self.units.lost:
                raise LeaderboardError(
                    f"no entry has any {self.units.metric} on {first_few(lost)}, where all of them "
                    "failed or nothing has one: nothing can race there; leave such objects out, or "
                    f"race for another score ({self.units.store.logs} says which units failed)")
            look = self.race.take(self.asked, found, self.units.worst, unknown)
            note(self._line(look))
            self.looked()
            self.asked = []
        if self.race.looks and time.monotonic() > self.until:
            self.late = not self.over
            return []
        self.asked = self.race.asked()
        return self.units.units(self.asked)

    def looked(self) -> None:
        """Leaves a note for those who watch."""
        write_race_note(self.units.store.logs, verdict_of(self.race, self.units),
                        self.units.statuses, self.units.faults, self.units.touches)

    @property
    def over(self) -> bool:
        """Whether the race is decided."""
        return bool(self.race.looks) and not self.race.looks[-1].open.any()

    def _once_more(self, damaged: list[Unit]) -> list[Unit]:
        """Units whose rows turned out to be damaged are run again, once."""
        if twice := self.again & {unit.id for unit in damaged}:
            raise StoreError(f"{self.units.store.folder}: {counted(len(twice), 'unit')} damaged "
                             f"twice; see {self.units.store.logs}", 1)
        self.again |= {unit.id for unit in damaged}
        note(f"running {counted(len(damaged), 'damaged unit')} again; see {self.units.store.logs}")
        return damaged

    def _line(self, look: Look) -> str:
        """How the race stands after a rung."""
        each = int(look.replicates.max())
        what = ("episodes on each object" if self.units.over == "these" else "objects")
        best = self.units.entries[look.leader].label
        within = verdict_of(self.race, self.units).within
        known = (f"within {amount(within, self.units.metric)} of the best" if np.isfinite(within)
                 else "nothing can be claimed yet")
        return (f"rung {look.number}, {each} {what}: {int(look.out.sum()):,} of "
                f"{len(look.out):,} entries are worse, {int(look.open.sum()):,} may be better by "
                f"more; {best} leads, {known}")


def rules_of(within: float, confidence: float, start: int, cap: float | None, metric: str) -> Rules:
    """The rules of a race from the command's arguments; `confidence` in percent.

    What is right or wrong has safe bounds always: entries that were right eight times are no proof
    that they never differ, as a standard error of zero would have it. Raises LeaderboardError where
    no difference can be larger than `within`, or for a cap that says nothing.
    """
    highest = bounds_of(metric)[1]
    if cap is not None and cap > highest:
        raise LeaderboardError(f"--cap: is {cap:g}; should be at most {highest:g}, the largest "
                               f"{metric} that there can be")
    if metric == "recognized":
        if cap not in (None, highest):
            raise LeaderboardError(f"--cap: is {cap:g}; should be left out: {metric} always has a "
                                   f"cap of {highest:g}")
        cap = highest
    most = highest if cap is None else cap
    if within >= most:
        raise LeaderboardError(f"--within: is {within:g}; should be below {most:g}, the largest "
                               f"difference in {metric} that there can be")
    bounds = None if cap is None else (-cap, 0.0) if metric in HIGHER_IS_BETTER else (0.0, cap)
    return Rules(within, confidence / 100.0, start, bounds)


def afforded(rules: Rules, units: RaceUnits, episodes: int | None) -> Rules:
    """The rules with the budget in replicates, and as many of each as there can be, or as these
    rules have it."""
    budget = None if episodes is None else episodes // units.episodes_each
    limits = (rules.most, len(units.order) if units.over == "like-these" else None)
    most = min((limit for limit in limits if limit is not None), default=None)
    return replace(rules, budget=budget, most=most,
                   start=min(rules.start, most) if most else rules.start)


def check_entries(units: RaceUnits, spec: Path) -> None:
    """Refuses a race of one entry, or one that could never end."""
    if len(units.entries) < 2:
        raise LeaderboardError(f"{spec}: has one entry; a race needs two or more strategies, or "
                               "values of [sweep.grid] or --set")
    if units.over == "like-these" and len(units.order) < 2:
        raise LeaderboardError("--over like-these: nothing follows from one object about others; "
                               "use --over these, or name more objects")


def run_course(plan: Plan, store: Store, options: Options,
               further: Callable[[], Sequence[Unit] | None], engine: str, address: str | None
               ) -> Outcome:
    """Runs a race, or a shard's part of it, on one of the engines to its end."""
    index, count = options.shard
    with Progress(0, store.note(f"{index}-of-{count}")) as progress:
        if engine == "ray":
            from sweeps.run.ray_engine import run_on_ray

            return run_on_ray(plan, store, options, progress, address, further)
        return run(plan, store, options, progress, further)
