"""A race as it goes on: from the note that it leaves after every rung, and curves of its best."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

from sweeps.analysis.curves import Steps
from sweeps.analysis.entries import sign_of
from sweeps.race.race_note import race_state
from sweeps.race.race_units import RaceUnits
from sweeps.race.verdict import amount, verdict_word
from sweeps.run.plan import Plan, Unit
from sweeps.run.race_record import read_race_note
from sweeps.run.store import Store
from sweeps.watch.mean_error import mean_errors
from sweeps.watch.state import (
    Pace,
    Row,
    State,
    failed_units,
    failures_of,
    faults_of,
    pace_facts,
    pace_of,
)
from sweeps.watch.unit_rows import CURVES_OF, UnitReader

ROWS = 100
CURVES = 6


def _of_this_rung(pace: Pace) -> list[tuple[str, str]]:
    """How many of the units that were asked for so far are there."""
    return [("units", f"{pace.past:,} of {pace.total:,} so far")] if pace.running else []


class RaceView:
    """Reads a race's directory again and again."""

    def __init__(self, plan: Plan, store: Store) -> None:
        self.plan, self.store = plan, store
        self.units: RaceUnits | None = None
        self.reader: UnitReader | None = None

    def state(self) -> State | None:
        """How the race stands; None where there is no race."""
        found = read_race_note(self.store.logs)
        if found is None:
            return None
        if not found["rungs"]:
            return self._before_the_first_look(found)
        if (self.units is None or self.reader is None or self.units.over != found["over"]
                or self.reader.metric != found["metric"]):
            self.units = RaceUnits(self.plan, self.store, found["metric"], found["over"])
            self.reader = UnitReader(self.store.units, self.store.logs, found["metric"])
        pace, entries, rungs = pace_of(self.store), found["entries"], found["rungs"]
        first = entries[0]
        over = not rungs[-1]["open"]
        taken = sum(entry["episodes"] for entry in entries)
        counts = {name: sum(entry["verdict"] == name for entry in entries)
                  for name in ("open", "tied", "worse")}
        facts = [("state", race_state(found, pace.running)), ("episodes", f"{taken:,}"),
                 ("still open", f"{counts['open']:,}"),
                 (verdict_word("tied"), f"{counts['tied']:,}"),
                 ("worse, out", f"{counts['worse']:,}"), *_of_this_rung(pace),
                 *pace_facts(pace, pace.total - pace.past)]
        return State(
            "race", self.plan.study.head.name or self.store.folder.name, pace.running,
            f"{first['label']}: {found['claim']}", tuple(facts), 1.0 if over else -1.0,
            found["metric"],
            "Bars begin at the lower bound of how much worse than the first an entry is. With a "
            f"chance of at most {100 - 100 * found['confidence']:.3g} % any entry is called worse "
            "and is not, over all entries and rungs together. With a chance as small the best of "
            "all is better than the first by more than its bound. Not better: "
            "not known to be worse, but better by at most "
            f"{amount(found['within'], found['metric'])}.",
            tuple(self._row(entry, first, found) for entry in entries[:ROWS]),
            max(0, len(entries) - ROWS),
            tuple((rung["replicates"], rung["taking"]) for rung in rungs),
            tuple((entry["label"], curve) for entry, curve in zip(
                entries, mean_errors([self._steps(entry) for entry in entries[:CURVES]]),
                strict=False) if curve),
            failures_of(found["statuses"]), failed_units(self.store.logs),
            faults_of(found.get("faults", {})))

    def _before_the_first_look(self, found: Mapping[str, Any]) -> State:
        pace = pace_of(self.store)
        facts = [("state", race_state(found, pace.running)), *_of_this_rung(pace),
                 *pace_facts(pace, pace.total - pace.past)]
        return State("race", self.plan.study.head.name or self.store.folder.name, pace.running,
                     "nothing is known before the first rung is over", tuple(facts), -1.0,
                     found["metric"], "", (), 0, (), (), (), failed_units(self.store.logs))

    def _row(self, entry: Mapping[str, Any], first: Mapping[str, Any], found: Mapping[str, Any]
             ) -> Row:
        mean, at_least = entry["mean"], entry["at_least"]
        turned = sign_of(found["metric"])
        bound = None if at_least is None else first["mean"] + turned * at_least
        low, high = (bound, mean) if turned > 0 else (mean, bound)
        return Row(entry["label"], mean, low, high, entry["worse_by"], entry["verdict"],
                   entry["episodes"], found["objects"], entry["touches"])

    def _steps(self, entry: Mapping[str, Any]) -> dict[str, list[Steps]]:
        """Error after each fit of an entry's first episodes, by object."""
        objects: dict[str, list[Steps]] = {}
        for unit in self._units(entry):
            rows = self.reader.read(unit) if self.reader else None
            if rows is not None and rows.steps:
                objects.setdefault(unit.cell.object_name, []).extend(rows.steps)
        return objects

    def _units(self, entry: Mapping[str, Any]) -> Iterator[Unit]:
        """The units of an entry's first episodes."""
        if self.units is None:
            return
        for start, stop in pairwise([0, *entry["stops"]]):
            if self.units.over == "these" and start >= CURVES_OF:
                return
            yield from self.units.of([(entry["entry"], start, stop)])

