"""A race over a space: entries are proposed and raced in rounds, the best of them race once more.

In every round some entries are proposed and race against each other, but for few episodes; the
means are told to the sampler. The finalists are those of the lowest means. They were chosen for
their luck, too: so the last race gives them other seeds, and nothing of the rounds counts in it.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from sweeps.analysis.entries import digits_of, sign_of
from sweeps.output import note
from sweeps.race.course import Course, afforded
from sweeps.race.elimination import Race, Rules
from sweeps.race.proposals import Point, Proposals
from sweeps.race.race_note import write_race_note
from sweeps.race.race_units import RacePlan, RaceUnits
from sweeps.race.verdict import verdict_of
from sweeps.run.plan import Plan, Unit, digest, plan_study
from sweeps.run.store import Store
from sweeps.spec.search import Search, with_points
from sweeps.text_table import TextTable, number_text
from warpgrasp.core.plain_text import counted

SHARE = 0.5
"""Of a budget of episodes, for the rounds; the last race has what they leave."""


@dataclass
class Heat(Course):
    """A race of a search: one of its rounds, or the last one."""

    stage: str = ""

    def looked(self) -> None:
        """Leaves a note for those who watch."""
        write_race_note(self.units.store.logs, verdict_of(self.race, self.units),
                        self.units.statuses, self.units.faults, self.units.touches, self.stage)


@dataclass
class Proposed:
    """An entry that was proposed, and how it did."""

    point: Point
    label: str
    round: int
    mean: float = float("nan")
    """Less is better."""
    episodes: int = 0
    final: bool = False


@dataclass
class SearchCourse:
    """A search under way: what the engine asks for the next units."""

    plan: Plan
    store: Store
    metric: str
    rules: Rules
    budget: int | None
    until: float = float("inf")
    proposed: list[Proposed] = field(default_factory=list)
    asked: list[Unit] = field(default_factory=list)
    heat: Heat | None = None
    last: bool = False
    """Whether the last race is on."""

    def __post_init__(self) -> None:
        self.search: Search = self.plan.study.search
        self.proposals = Proposals(self.search, self.plan.study.head.seed)
        self.round = 0
        self.alike = False  # whether the last proposals are one entry, so that nothing can race

    @property
    def whole(self) -> Plan:
        """The units that were asked for so far, as a plan."""
        return RacePlan(self.plan.study, self.plan.resolved, self.plan.hash, self.plan.folders,
                        self.asked)

    @property
    def taken(self) -> int:
        """Episodes of the rounds. An entry that is proposed again has the same: they count once."""
        most: dict[str, int] = {}
        for found in self.proposed:
            most[found.label] = max(found.episodes, most.get(found.label, 0))
        return sum(most.values())

    @property
    def race(self) -> Race:
        """The last race; before it, one without entries."""
        return self.heat.race if self.heat and self.last else Race(0, self.rules)

    @property
    def units(self) -> RaceUnits:
        """Those of the race that is on, or of the study without a search."""
        return (self.heat.units if self.heat else
                RaceUnits(self.plan, self.store, self.metric, "these"))

    def why_nothing(self, episodes: int | None) -> str:
        """Why there was no last race with this budget."""
        if self.alike and not self.proposed:
            return "[search]: all proposals are the same entry; a race needs two that differ"
        return (f"--budget-episodes: is {episodes}; half of it is for proposals, and the rest "
                "should suffice for a first rung of the finalists")

    @property
    def late(self) -> bool:
        """Whether the last race was ended by the time."""
        return self.heat is not None and self.heat.late

    def further(self) -> Sequence[Unit]:
        """The units of the next rung of the race that is on, or of the first of the next one."""
        while True:
            if self.heat is not None:
                if units := self.heat.further():
                    return units
                if self.last:
                    return []
                self._end_round(self.heat)
            self.heat = self._next_round() or self._last_race()
            if self.heat is None:
                return []

    def _next_round(self) -> Heat | None:
        """The race of the next proposals; None where there are no more, or a budget says so."""
        if self.proposed and time.monotonic() > self.until:
            return None
        left = self.search.trials - self.proposals.tried
        count = left if left <= self.search.round + 1 else self.search.round  # one cannot race
        each = self.search.episodes * self.units.episodes_each
        if self.budget is not None:
            count = min(count, int(SHARE * self.budget - self.taken) // each)
        if count < 2:
            return None
        points = self.proposals.ask(count)
        self.alike = len(points) < 2
        if self.alike:
            return None
        self.round += 1
        rules = replace(self.rules, most=self.search.episodes,
                        start=min(self.rules.start, self.search.episodes))
        heat = self._heat(points, rules, None, f"round {self.round} of proposals")
        self.proposed += [Proposed(point, entry.label, self.round) for point, entry in
                          zip(points, heat.units.entries, strict=True)]
        return heat

    def _end_round(self, heat: Heat) -> None:
        """Tells the sampler how its proposals did."""
        mine = self.proposed[-len(heat.units.entries):]
        for found, mean, count in zip(mine, heat.race.means, heat.race.count, strict=True):
            found.mean, found.episodes = float(mean), int(count) * heat.units.episodes_each
        self.proposals.tell([found.mean for found in mine])

    def _last_race(self) -> Heat | None:
        """The race of the finalists, on other seeds; None where fewer than two were proposed."""
        self.last = True
        best: dict[str, Proposed] = {}
        for found in sorted(self.proposed, key=lambda found: found.mean):
            best.setdefault(found.label, found)
        chosen = list(best.values())[:self.search.finalists]
        if len(chosen) < 2:
            return None
        for found in self.proposed:  # one that was proposed twice is marked twice
            found.final = best[found.label] in chosen
        left = None if self.budget is None else self.budget - self.taken
        seed = int(digest([self.plan.study.head.seed, "last race"])[:15], 16)
        note(f"{counted(len(self.proposed), 'proposal')} took {self.taken:,} episodes; the best "
             f"{len(chosen)} race again, on other seeds")
        return self._heat([found.point for found in chosen], self.rules, seed, "last race", left)

    def _heat(self, points: Sequence[Point], rules: Rules, seed: int | None, stage: str,
              episodes: int | None = None) -> Heat:
        study = with_points(self.plan.study, self.search, points, seed)
        # Files are those of the first plan: units would not tell that one has changed since.
        plan = plan_study(study, read_again=False)
        units = RaceUnits(plan, self.store, self.metric, "these", self.asked)
        rules = afforded(rules, units, episodes)
        return Heat(Race(len(units.entries), rules), units, self.until, stage=stage)


def search_table(course: SearchCourse) -> TextTable:
    """A row for each entry that was proposed, in that order: what `search.csv` holds."""
    sign = sign_of(course.metric)
    digits = digits_of(course.metric)
    keys = tuple(factor.key for factor in course.search.factors)
    return TextTable(("round", *keys, course.metric, "n_episodes", "finalist"), tuple(
        (f"{found.round}", *(_text(found.point.get(key)) for key in keys),
         number_text(sign * found.mean if np.isfinite(found.mean) else np.nan, digits),
         f"{found.episodes}", "yes" if found.final else "no") for found in course.proposed))


def search_lines(course: SearchCourse) -> dict[str, str]:
    """What is said of the rounds, beside the outcome of the last race."""
    return {"search": f"{counted(len(course.proposed), 'proposal')} in "
                      f"{counted(course.round, 'round')} took {course.taken:,} episodes; "
                      "the claim is of the finalists, on other seeds"}


def _text(value: Any) -> str:
    if isinstance(value, tuple):
        return " ".join(map(_text, value))
    return "" if value is None else f"{value}"
