"""A sweep as it goes on: every entry by the episodes that it has so far."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product

import numpy as np

from sweeps.analysis.curves import Steps
from sweeps.analysis.entries import (
    averaged_points,
    bounds_of,
    entries_of,
    entry_axes,
    setting_index,
    sign_of,
)
from sweeps.analysis.paired import failure_score
from sweeps.figures.style import order_of
from sweeps.run.plan import Plan, Unit, cell_hash
from sweeps.run.store import Store
from sweeps.text_table import six_digits
from sweeps.watch.any_time import Mean, alpha_of, mean_over_objects
from sweeps.watch.mean_error import mean_errors
from sweeps.watch.state import (
    Row,
    State,
    failed_units,
    failures_of,
    faults_of,
    pace_facts,
    pace_of,
)
from sweeps.watch.unit_rows import UnitReader, UnitRows
from warpgrasp.core.plain_text import counted

ROWS = 100
CURVES = 6


@dataclass
class Found:
    """What one entry has on one object so far, by unit; of a failed unit what stands for it."""

    units: dict[str, tuple[Unit, UnitRows]] = field(default_factory=dict)
    statuses: Counter[str] = field(default_factory=Counter)

    def add(self, unit: Unit, rows: UnitRows) -> None:
        """Takes in a unit."""
        self.drop(unit)
        self.units[unit.id] = unit, rows
        self.statuses += rows.statuses

    def drop(self, unit: Unit) -> None:
        """Leaves out what stood for a unit."""
        if unit.id in self.units:
            self.statuses -= self.units.pop(unit.id)[1].statuses

    @property
    def rows(self) -> list[UnitRows]:
        """Those of all units."""
        return [rows for _, rows in self.units.values()]

    @property
    def steps(self) -> list[Steps]:
        """Error after each fit, of all episodes that curves are drawn of."""
        return [steps for rows in self.rows for steps in rows.steps]

    @property
    def touches(self) -> np.ndarray:
        """Those of the episodes that were run, as far as they are known."""
        every = np.concatenate([rows.touches for rows in self.rows])
        return every[np.isfinite(every)]

    def by_episode(self, worst: float) -> "Scores":
        """Scores by episode, the mean over the cases in which it was run so far."""
        episodes = [np.arange(unit.start, unit.stop) for unit, _ in self.units.values()]
        numbers, own, counts = np.unique(np.concatenate(episodes), return_inverse=True,
                                         return_counts=True)
        values = np.concatenate([rows.scores for rows in self.rows])
        sums = np.bincount(own, np.where(np.isfinite(values), values, worst), len(numbers))
        return Scores(numbers, sums / counts)


@dataclass(frozen=True)
class Scores:
    """Scores of some episodes of one object, by their numbers."""

    episodes: np.ndarray
    values: np.ndarray

    def minus(self, other: "Scores") -> np.ndarray:
        """Differences over the episodes that both have."""
        _, mine, theirs = np.intersect1d(self.episodes, other.episodes, assume_unique=True,
                                         return_indices=True)
        return self.values[mine] - other.values[theirs]


class SweepView:
    """Reads a sweep's directory again and again, every unit once."""

    def __init__(self, plan: Plan, store: Store, metric: str, kept: UnitReader | None = None
                 ) -> None:
        self.plan, self.store, self.metric = plan, store, metric
        self.reader = kept or UnitReader(store.units, store.logs, metric)
        axes, _ = entry_axes(plan, None)
        self.entries = entries_of(plan, axes)
        self.found: list[dict[int, Found]] = [{} for _ in self.entries]  # by object
        self.waiting = {unit.id: (entry, body, unit)
                        for entry, body, unit in self._every_unit(axes)}
        """Units without rows; those that failed among them, since a later run tries them again."""
        self.aside: set[str] = set()  # of these, units that failed

    def _every_unit(self, axes: list[int]) -> Iterator[tuple[int, int, Unit]]:
        """All units with their entry and object."""
        study = self.plan.study
        for (n, entry), body in product(enumerate(self.entries), range(len(study.objects))):
            for case in averaged_points(self.plan, axes):
                cell = study.cell(entry.strategy, body,
                                  setting_index(self.plan, case | entry.points))
                name = cell_hash(cell, study.objects[body])
                for block in range(self.plan.block_count):
                    yield n, body, self.plan.unit(cell, name, block)

    @property
    def looks(self) -> int:
        """Units of an entry: so often its mean changes."""
        return self.plan.unit_count // max(1, len(self.entries))

    def take_in(self) -> None:
        """Reads the units that have come since, also in the place of failed ones."""
        there = self.store.unit_ids()
        failed = {file.name.removesuffix(".failed.log")
                  for file in self.store.logs.glob("*.failed.log")}
        for name in sorted((there | failed | self.aside) & self.waiting.keys()):
            entry, body, unit = self.waiting[name]
            rows = self.reader.read(unit)
            if rows is not None and rows.aside and name in self.aside:
                continue
            self.aside.discard(name)
            if rows is None:  # damaged, or a run tries it again just now
                self._leave_out(entry, body, unit)
                continue
            if rows.aside:
                self.aside.add(name)
            else:
                del self.waiting[name]
            self.found[entry].setdefault(body, Found()).add(unit, rows)
        for name in self.reader.damaged.keys() - there:
            del self.reader.damaged[name]
        self.reader.unreadable &= there

    def _leave_out(self, entry: int, body: int, unit: Unit) -> None:
        found = self.found[entry].get(body, Found())
        found.drop(unit)
        if not found.units:
            self.found[entry].pop(body, None)

    def state(self) -> State:
        """How the sweep stands."""
        self.take_in()
        pace = pace_of(self.store)
        total, left = self.plan.unit_count, len(self.waiting) - len(self.aside)
        done = total - left
        rows = self._rows()
        statuses: Counter[str] = sum((found.statuses for of_objects in self.found
                                      for found in of_objects.values()), Counter())
        facts = [("state", "finished" if not left else "running" if pace.running
                  else "stopped before its end"), ("units", f"{done:,} of {total:,}"),
                 ("episodes", f"{sum(statuses.values()):,}"), *pace_facts(pace, left)]
        notes = []
        if len({row.objects for row in rows}) > 1:
            notes.append("Entries have met different objects so far: their means cannot be "
                         "compared yet. Those that have met most are first.")
        if self.reader.damaged:
            notes.append(f"{counted(len(self.reader.damaged), 'damaged unit')} left out")
        if unreadable := self.reader.unreadable:
            notes.append(f"{counted(len(unreadable), 'unit')} cannot be read: permission denied")
        about = (f"95 % intervals of these objects, with other episodes, which may be read "
                 f"at any time: an entry has {counted(self.looks, 'unit')}, and each look takes "
                 "an equal share of the 5 %. Behind: over the episodes that both have. Worse: "
                 "than the first, of all pairs together.")
        return State("sweep", self.plan.study.head.name or self.store.folder.name, pace.running,
                     self._headline(rows, done), tuple(facts), done / max(total, 1), self.metric,
                     about, tuple(rows[:ROWS]), max(0, len(rows) - ROWS), (),
                     tuple(self._curves(rows)), failures_of(statuses),
                     failed_units(self.store.logs), faults_of(self._faults()), tuple(notes))

    def _faults(self) -> dict[str, str]:
        """Of each entry at fault, what the first of its episodes says that has come."""
        told = {entry.label: next((rows.fault for found in of_objects.values()
                                   for rows in found.rows if rows.fault), "")
                for entry, of_objects in zip(self.entries, self.found, strict=True)}
        return {label: fault for label, fault in told.items() if fault}

    def _headline(self, rows: list[Row], done: int) -> str:
        if not rows:
            return "no unit is finished yet" if not done else "no episode has a score yet"
        if len(rows) == 1:
            return rows[0].label
        near = sum(row.verdict != "worse" for row in rows) - 1
        return (f"{rows[0].label} is first; {near} of {counted(len(rows) - 1, 'other')} "
                "cannot be told from it")

    def _rows(self) -> list[Row]:
        """A row for each entry that has a score, the best of those that met most objects first."""
        worst = self._worst()
        scores = [{body: found.by_episode(worst[body]) for body, found in of_objects.items()
                   if body in worst} for of_objects in self.found]
        means = {n: mean_over_objects([part.values for part in of.values()])
                 for n, of in enumerate(scores) if of}
        sign = sign_of(self.metric)
        errors = np.array([sign * means[n].value if n in means else np.inf
                           for n in range(len(self.entries))])
        ranked = order_of(errors, [entry.label for entry in self.entries])  # as figures colour them
        order = sorted(filter(means.__contains__, ranked), key=lambda n: -len(scores[n]))
        return [self._row(n, order[0], scores, means[n], sign) for n in order]

    def _row(self, n: int, first: int, scores: list[dict[int, Scores]], mean: Mean,
             sign: float) -> Row:
        half = mean.half_width(alpha_of(self.looks))
        lowest, highest = bounds_of(self.metric)
        apart = [sign * scores[n][body].minus(scores[first][body])
                 for body in scores[n] if body in scores[first]]
        apart = [values for values in apart if len(values)]
        verdict, behind = "best" if n == first else "", 0.0
        if n != first and apart:
            found = mean_over_objects(apart)
            pairs = len(self.entries) * (len(self.entries) - 1)
            one_sided = 2.0 * alpha_of(self.looks, pairs)
            verdict = "worse" if found.value > found.half_width(one_sided) else ""
            behind = found.value
        touches = [known.mean() for found in self.found[n].values()
                   if len(known := found.touches)]
        return Row(self.entries[n].label, six_digits(mean.value),
                   six_digits(max(mean.value - half, lowest)),
                   six_digits(min(mean.value + half, highest)), six_digits(behind), verdict,
                   sum(len(part.values) for part in scores[n].values()), len(scores[n]),
                   six_digits(float(np.mean(touches))) if touches else None)

    def _worst(self) -> dict[int, float]:
        """What an episode without a score counts as on each object that has any."""
        found: dict[int, float] = {}
        score = failure_score(self.metric)
        for of_objects in self.found:
            for body, part in of_objects.items():
                values = np.concatenate([values for rows in part.rows
                                         for values in (rows.scores, rows.given)])
                known = values[np.isfinite(values)]
                if len(known):
                    found[body] = (max(found.get(body, -np.inf), float(known.max()))
                                   if score is None else score)
        return found

    def _curves(self, rows: list[Row]) -> Iterator[tuple[str, list[tuple[float, float]]]]:
        numbers = {entry.label: n for n, entry in enumerate(self.entries)}
        shown = rows[:CURVES]
        steps = [{self.plan.study.objects[body].name: given
                  for body, found in self.found[numbers[row.label]].items()
                  if (given := found.steps)}
                 for row in shown]
        for row, curve in zip(shown, mean_errors(steps), strict=True):
            if curve:
                yield row.label, curve
