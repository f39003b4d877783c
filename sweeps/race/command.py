"""`warpgrasp race`: runs a race in rungs, says which entry is best within how much."""

import time
from collections.abc import Sequence
from pathlib import Path

from sweeps.analysis.entries import LeaderboardError, check_metric, fault_line
from sweeps.analysis.leaderboard import few_lines
from sweeps.output import note, say, write_atomic
from sweeps.race.course import Course, afforded, check_entries, run_course
from sweeps.race.elimination import Race, Rules
from sweeps.race.race_note import begin_race_note
from sweeps.race.race_units import RaceUnits
from sweeps.race.search import SearchCourse, search_lines, search_table
from sweeps.race.shards import SharedRungs
from sweeps.race.verdict import Verdict, amount, claim, race_table, summary, verdict_of
from sweeps.run.local_engine import Options, terminated_as_interrupted
from sweeps.run.plan import Plan, plan_study, same_bodies
from sweeps.run.store import Store
from sweeps.spec.errors import StoreError
from sweeps.spec.reader import read_spec, spec_text
from sweeps.spec.toml_reader import read_content
from sweeps.text_table import finite_or_none, json_record, print_json, print_table
from warpgrasp.core.plain_text import counted, on_one_line

SHOWN = 20
"""Rows that are printed; `race.csv` has them all."""


def race(spec: Path, folder: Path, *, rules: Rules, episodes: int | None, minutes: float | None,
         metric: str, over: str, options: Options, settings: Sequence[str], as_json: bool,
         engine: str = "local", address: str | None = None) -> int:
    """Runs what is left of a race, writes `race.csv` and `race.svg`, prints the outcome.

    `episodes` and `minutes` are budgets. Raises LeaderboardError for a race that cannot be run,
    SpecError and StoreError as a sweep does.
    """
    began = time.monotonic()
    check_metric(metric)
    content = read_content(spec)
    plan = plan_study(read_spec(spec, settings, content))
    store = Store(folder)
    until = began + 60.0 * minutes if minutes is not None else float("inf")
    course = _course(spec, plan, store, rules, episodes, metric, over, until)
    with terminated_as_interrupted(), store.lock(options.shard, "race"):
        for line in (*store.open_for(plan, spec_text(content, settings), options.device),
                     *same_bodies(plan.study)):
            note(line)
        begin_race_note(plan, store, metric, over)
        try:
            further = (course.further if options.shard[1] == 1 else
                       SharedRungs(course.further, store, options.shard).further)
            outcome = run_course(course.whole, store, options, further, engine, address)
        except KeyboardInterrupt:
            if course.race.looks:
                found = verdict_of(course.race, course.units)
                _write(folder, found)
                note(f"so far: {claim(found)}; {found.labels[found.last.leader]} leads")
            raise
        if isinstance(course, SearchCourse) and course.proposed:
            write_atomic(folder / "search.csv", search_table(course).csv())
        if not course.race.looks:
            raise StoreError(course.why_nothing(episodes), 2)
        found = verdict_of(course.race, course.units)
        _write(folder, found)
    for line in few_lines([fault_line(*fault) for fault in sorted(found.faults.items())]):
        note(line)
    _show(found, as_json, search_lines(course) if isinstance(course, SearchCourse) else {})
    if not found.reached:
        spent = ("time" if course.late else
                 "budget of episodes" if episodes and not _all_taken(course.race) else "objects")
        note(f"the {spent} ended before the best was known within {amount(rules.within, metric)}; "
             f"more {'of them' if spent == 'objects' else 'of it'} may tell")
    if outcome.failed:
        say(f"{counted(outcome.failed, 'unit')} failed, counted as the worst; see "
            f"{store.logs}/*.failed.log")
    return int(bool(outcome.failed or outcome.lost))


def _course(spec: Path, plan: Plan, store: Store, rules: Rules, episodes: int | None, metric: str,
            over: str, until: float) -> Course | SearchCourse:
    """The race of a study's entries, or of those that its search proposes."""
    if plan.study.search is None:
        units = RaceUnits(plan, store, metric, over)
        check_entries(units, spec)
        return Course(Race(len(units.entries), afforded(rules, units, episodes)), units, until)
    if over != "these":
        raise LeaderboardError("--over like-these: a [search] races on these objects; race its "
                               "finalists in a spec of their own")
    return SearchCourse(plan, store, metric, rules, episodes, until)


def _all_taken(race: Race) -> bool:
    """Whether every entry that is open has taken all replicates that there are."""
    most, last = race.rules.most, race.looks[-1]
    return most is not None and bool((last.replicates[last.open] >= most).all())


def _write(folder: Path, found: Verdict) -> None:
    """Writes `race.csv` and `race.svg`."""
    from sweeps.figures.style import encode
    from sweeps.race.picture import draw_race

    write_atomic(folder / "race.csv", race_table(found).csv())
    write_atomic(folder / "race.svg", encode(draw_race(found), "svg"))


def _show(found: Verdict, as_json: bool, more: dict[str, str]) -> None:
    lines, made = {**summary(found), **more}, race_table(found)
    if as_json:
        print_json({**json_record(lines), "reached": found.reached, "table": made.records(),
                    "within": finite_or_none(found.within)})
        return
    width = max(map(len, lines))
    for name, text in lines.items():
        print(f"{name.ljust(width)}  {on_one_line(text)}")
    print()
    print_table(made.header, made.rows[:SHOWN], False)
    if len(made.rows) > SHOWN:
        print(f"... {len(made.rows) - SHOWN:,} more in race.csv")
