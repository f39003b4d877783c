"""`warpgrasp race`: runs a race in rungs, says which entry is best within how much."""

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from sweeps.analysis.entries import HIGHER_IS_BETTER, LeaderboardError, check_metric
from sweeps.output import note, say, write_atomic
from sweeps.race.elimination import Look, Part, Race, Rules
from sweeps.race.race_note import begin_race_note, write_race_note
from sweeps.race.race_units import RaceUnits
from sweeps.race.verdict import Verdict, amount, claim, race_table, summary, verdict_of
from sweeps.run.local_engine import Options, run, terminated_as_interrupted
from sweeps.run.plan import Plan, Unit, plan_study
from sweeps.run.progress import Progress
from sweeps.run.scheduler import Outcome
from sweeps.run.store import Store
from sweeps.spec.errors import StoreError
from sweeps.spec.reader import read_spec
from sweeps.text_table import print_table
from warpgrasp.core.plain_text import on_one_line

SHOWN = 20
"""Rows that are printed; `race.csv` has them all."""


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

    def further(self) -> Sequence[Unit]:
        """Takes in the rung that has been run, and gives the units of the next."""
        if self.asked:
            found = self.units.scores(self.asked)
            if damaged := self.units.missing:
                return self._once_more(damaged)
            look = self.race.take(self.asked, found)
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
                        self.units.statuses, self.units.touches)

    @property
    def over(self) -> bool:
        """Whether the race is decided."""
        return bool(self.race.looks) and not self.race.looks[-1].open.any()

    def _once_more(self, damaged: list[Unit]) -> list[Unit]:
        """Units whose rows turned out to be damaged are run again, once."""
        if twice := self.again & {unit.id for unit in damaged}:
            raise StoreError(f"{self.units.store.folder}: {len(twice)} units were damaged twice; "
                             f"see {self.units.store.logs}", 1)
        self.again |= {unit.id for unit in damaged}
        note(f"{len(damaged)} damaged units are run again; see {self.units.store.logs}")
        return damaged

    def _line(self, look: Look) -> str:
        """How the race stands after a rung."""
        each = int(look.replicates.max())
        what = ("episodes on each object" if self.units.over == "these" else "objects")
        best = self.units.entries[look.leader].label
        known = amount(look.within if look.open.any() else self.race.rules.within,
                       self.units.metric)
        return (f"rung {look.number}, {each} {what}: {int(look.out.sum()):,} of "
                f"{len(look.out):,} entries are worse, {int(look.open.sum()):,} may be better by "
                f"more; {best} leads, within {known} of the best")


def rules_of(within: float, confidence: float, start: int, cap: float | None, metric: str) -> Rules:
    """The rules of a race from the command's arguments; `confidence` in percent.

    What is right or wrong has safe bounds always: entries that were right eight times are no proof
    that they never differ, as a standard error of zero would have it.
    """
    if metric == "recognized":
        cap = 1.0
    bounds = None if cap is None else (-cap, 0.0) if metric in HIGHER_IS_BETTER else (0.0, cap)
    return Rules(within, confidence / 100.0, start, bounds)


def race(spec: Path, folder: Path, *, rules: Rules, episodes: int | None, minutes: float | None,
         metric: str, over: str, options: Options, settings: Sequence[str], as_json: bool,
         engine: str = "local", address: str | None = None) -> int:
    """Runs what is left of a race, writes `race.csv` and `race.svg`, prints the outcome.

    `episodes` and `minutes` are budgets. Raises LeaderboardError for a race that cannot be run,
    SpecError and StoreError as a sweep does.
    """
    began = time.monotonic()
    check_metric(metric)
    plan = plan_study(read_spec(spec, settings))
    store = Store(folder)
    units = RaceUnits(plan, store, metric, over)
    course = Course(Race(len(units.entries), _afforded(rules, units, episodes)), units,
                    began + 60.0 * minutes if minutes is not None else float("inf"))
    check_entries(units, spec)
    with terminated_as_interrupted(), store.lock(options.shard):
        for line in store.open_for(plan, spec.read_bytes(), options.device):
            note(line)
        begin_race_note(store.logs, metric, over, len(units.entries))
        try:
            outcome = run_course(units.plan, store, options, course, engine, address)
        except KeyboardInterrupt:
            if course.race.looks:
                _write(folder, verdict_of(course.race, units))
                say(f"so far: {claim(verdict_of(course.race, units))}")
            raise
        if not course.race.looks:
            raise StoreError(f"--budget-episodes: is {episodes}; the first rung of "
                             f"{len(units.entries):,} entries takes "
                             f"{_first_rung(units, rules):,} episodes", 2)
        found = verdict_of(course.race, units)
        _write(folder, found)
    _show(found, as_json)
    if not found.reached:
        spent = "time" if course.late else "budget of episodes" if episodes else "objects"
        note(f"note: the {spent} ended before the best was known within "
             f"{amount(rules.within, metric)}; more of it goes on from here")
    if outcome.failed:
        note(f"{outcome.failed} units failed and count as the worst; see {store.logs}/*.failed.log")
    return int(bool(outcome.failed or outcome.lost))


def _afforded(rules: Rules, units: RaceUnits, episodes: int | None) -> Rules:
    """The rules with the budget in replicates, and as many of each as there can be."""
    budget = None if episodes is None else episodes // units.episodes_each
    most = len(units.order) if units.over == "like-these" else None
    return replace(rules, budget=budget, most=most,
                   start=min(rules.start, most) if most else rules.start)


def _first_rung(units: RaceUnits, rules: Rules) -> int:
    return len(units.entries) * units.episodes_each * 2


def check_entries(units: RaceUnits, spec: Path) -> None:
    """Refuses a race of one entry, or one that could never end."""
    if len(units.entries) < 2:
        raise LeaderboardError(f"{spec}: has one entry; a race needs two or more strategies, or "
                               "values of [sweep.grid] or --set")
    if units.over == "like-these" and len(units.order) < 2:
        raise LeaderboardError("--over like-these: nothing follows from one object about others; "
                               "use --over these, or name more objects")


def run_course(plan: Plan, store: Store, options: Options, course: Course, engine: str,
               address: str | None) -> Outcome:
    """Runs a race on one of the engines to its end."""
    with Progress(0, store.note("1-of-1")) as progress:
        if engine == "ray":
            from sweeps.run.ray_engine import run_on_ray

            return run_on_ray(plan, store, options, progress, address, course.further)
        return run(plan, store, options, progress, course.further)


def _write(folder: Path, found: Verdict) -> None:
    """Writes `race.csv` and `race.svg`."""
    from sweeps.figures.style import encode
    from sweeps.race.picture import draw_race

    write_atomic(folder / "race.csv", race_table(found).csv())
    write_atomic(folder / "race.svg", encode(draw_race(found), "svg"))


def _show(found: Verdict, as_json: bool) -> None:
    lines, made = summary(found), race_table(found)
    if as_json:
        rows = [dict(zip(made.header, row, strict=True)) for row in made.rows]
        print(json.dumps({**lines, "reached": found.reached, "within": found.within,
                          "table": rows}, indent=1))
        return
    width = max(map(len, lines))
    for name, text in lines.items():
        print(f"{name.ljust(width)}  {on_one_line(text)}")
    print()
    print_table(made.header, made.rows[:SHOWN], False)
    if len(made.rows) > SHOWN:
        print(f"... {len(made.rows) - SHOWN:,} more in race.csv")
