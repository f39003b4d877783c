"""The episodes of a race as units of a study: which units a rung needs, and the scores in them.

Of *these* objects a replicate is an episode with the same number on each object. Of objects *like
these* it is one object, with all the episodes of a cell; objects come in an order drawn from the
study's seed. Axes that do not define entries are averaged over.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from sweeps.analysis.entries import (
    Entry,
    averaged_points,
    entries_of,
    entry_axes,
    fault_of,
    prior_column,
    ranked_values,
    setting_index,
    sign_of,
    values_of,
)
from sweeps.analysis.paired import failure_score
from sweeps.race.elimination import Part, Unknown
from sweeps.run.plan import Plan, Unit, cell_hash, unit_id
from sweeps.run.race_record import object_order, race_blocks
from sweeps.run.store import Store
from sweeps.run.unit_file import Columns
from sweeps.spec.cell import Cell, batch_key


@dataclass(frozen=True)
class RacePlan(Plan):
    """A plan whose units are those that a race has asked for so far."""

    asked: list[Unit] = field(default_factory=list)

    @property
    def unit_count(self) -> int:
        """Units asked for so far."""
        return len(self.asked)

    def units(self, shard: tuple[int, int] = (1, 1)) -> Iterator[Unit]:
        """The same for every shard; `SharedRungs` deals them out."""
        return iter(self.asked)

    def shard_size(self, shard: tuple[int, int] = (1, 1)) -> int:
        """How many they are."""
        return len(self.asked)


class RaceUnits:
    """The units of a race and their scores."""

    def __init__(self, plan: Plan, store: Store, metric: str, over: str,
                 asked: list[Unit] | None = None) -> None:
        """`asked` is the list to which the units of several races are added."""
        self.plan = RacePlan(plan.study, plan.resolved, plan.hash, plan.folders,
                             [] if asked is None else asked)
        self.store, self.metric, self.over = store, metric, over
        self.axes = entry_axes(plan, None)[0]
        self.entries = entries_of(plan, self.axes)
        self.order = object_order(plan.study)
        self._together: dict[str, str] = {}  # by a cell's hash: what it can be run together with
        self._cells: dict[tuple[int, int], list[tuple[Cell, str]]] = {}
        self.missing: list[Unit] = []
        """Units that the last call of `scores` found neither there nor failed: damaged ones."""
        self.lost: list[str] = []
        """Objects of that call on which no entry has a score by now, or was given one."""
        self._worst: dict[int, float] = {}  # by object: what an episode without a score counts as
        self.statuses: Counter[str] = Counter()
        """What became of the episodes that were read."""
        self.faults: dict[str, str] = {}
        """Of each entry at fault, what the first of its episodes says that was read."""
        self._touches, self._failed = np.zeros((2, 2, len(self.entries)))  # sum, number of known

    @property
    def objects_each(self) -> int:
        """Objects of a replicate."""
        return 1 if self.over == "like-these" else len(self.order)

    @property
    def episodes_each(self) -> int:
        """Episodes of a replicate."""
        cases = int(np.prod([len(axis.values) for n, axis in enumerate(self.plan.study.axes)
                             if n not in self.axes], initial=1))
        return cases * (self.plan.study.head.episodes_per_cell if self.over == "like-these"
                        else len(self.order))

    def units(self, asked: Sequence[Part]) -> list[Unit]:
        """The units of a rung; the plan counts them."""
        found = self.of(asked)
        self.plan.asked.extend(found)
        return found

    def of(self, asked: Sequence[Part]) -> list[Unit]:
        """The units of some replicates, those that can be run in one call side by side."""
        together: dict[str, list[Unit]] = {}
        for entry, start, stop in asked:
            for body, first, last in race_blocks(self.plan.study, self.over, start, stop):
                for unit in self._units(entry, body, first, last):
                    together.setdefault(self._together[unit.cell_hash], []).append(unit)
        return [unit for units in together.values() for unit in units]

    def scores(self, asked: Sequence[Part]) -> tuple[list[np.ndarray], Unknown]:
        """The scores of what was asked, each (stratum, replicate), less being better; and what is
        not known of them.

        An episode without a score counts as the worst that any entry has had on its object by now,
        or was given.
        """
        self.missing = []
        before = self.statuses.copy(), self._touches.copy(), self._failed.copy()
        raw = [{body: self._values(entry, body, blocks)
                for body, blocks in self._by_object(start, stop).items()}
               for entry, start, stop in asked]
        if self.missing:  # they will be asked for again
            self.statuses, self._touches, self._failed = before
        for of_objects in raw:
            for body, values in of_objects.items():
                self._note_worst(body, values)
        read = {body for of_objects in raw for body in of_objects}
        self.lost = [self.plan.study.objects[body].name for body in sorted(read - {*self._worst})
                     if failure_score(self.metric) is None]
        known, shares = ([self._replicates(of_objects, what) for of_objects in raw] for what in (
            lambda values: np.where(np.isfinite(values), values, 0.0),
            lambda values: ~np.isfinite(values)))
        bodies = self.order if self.over == "like-these" else range(len(self.order))
        costs = np.array([self._cost(body) for body in bodies])
        return known, Unknown(shares, costs[None] if self.over == "like-these" else costs[:, None])

    def _replicates(self, of_objects: dict[int, np.ndarray],
                    what: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """The mean of something over the cases of each replicate, (stratum, replicate)."""
        rows = [what(values).mean(axis=0) for values in of_objects.values()]
        return np.array([[row.mean() for row in rows]] if self.over == "like-these" else rows)

    def _cost(self, body: int) -> float:
        """What an episode without a score counts as on an object, by now."""
        score = failure_score(self.metric)
        return self._worst.get(body, 0.0) if score is None else score

    @property
    def worst(self) -> np.ndarray:
        """What a replicate scores whose episodes all have no score, (stratum,)."""
        costs = np.array([self._cost(body) for body in range(len(self.order))])
        return costs.max(keepdims=True) if self.over == "like-these" else costs

    def _note_worst(self, body: int, values: np.ndarray) -> None:
        known = values[np.isfinite(values)]
        if len(known):
            self._worst[body] = max(self._worst.get(body, -np.inf), float(known.max()))

    def _by_object(self, start: int, stop: int) -> dict[int, list[tuple[int, int]]]:
        """The blocks of episodes of some replicates, by object."""
        found: dict[int, list[tuple[int, int]]] = {}
        for body, first, last in race_blocks(self.plan.study, self.over, start, stop):
            found.setdefault(body, []).append((first, last))
        return found

    def _values(self, entry: int, body: int, blocks: Sequence[tuple[int, int]]) -> np.ndarray:
        """The scores of an entry on an object, (case, episode); NaN where there is none."""
        sign = sign_of(self.metric)
        given = prior_column(self.metric)
        parts = []
        for first, last in blocks:
            of_cases = []
            for unit in self._units(entry, body, first, last):
                rows = self.store.read(unit)
                if rows is None and not self.store.log(unit).exists():
                    self.missing.append(unit)
                if rows is not None and given is not None:
                    self._note_worst(body, sign * values_of(rows, given))
                self._count(entry, last - first, rows)
                of_cases.append(np.full(last - first, np.nan) if rows is None
                                else sign * ranked_values(rows, self.metric))
            parts.append(np.array(of_cases))
        return np.concatenate(parts, axis=1)

    def _count(self, entry: int, episodes: int, rows: Columns | None) -> None:
        """Takes note of what a reader of the race wants to know beside scores."""
        if rows is None:
            self.statuses["unit_failed"] += episodes
            self._failed[:, entry] += episodes
            return
        self.statuses.update(map(str, rows["status"]))
        if fault := fault_of(rows):
            self.faults.setdefault(self.entries[entry].label, fault)
        self._failed[:, entry] += values_of(rows, "failure_rate").sum(), episodes
        touches = values_of(rows, "touches")
        self._touches[:, entry] += np.nansum(touches), np.isfinite(touches).sum()

    @property
    def touches(self) -> np.ndarray:
        """Each entry's mean number of touches, (entry,); NaN where none is known."""
        return _share(*self._touches)

    @property
    def failure_rate(self) -> np.ndarray:
        """Each entry's share of failed episodes, (entry,); NaN where none was read."""
        return _share(*self._failed)

    def _units(self, entry: int, body: int, first: int, last: int) -> list[Unit]:
        """A block of episodes of an entry on an object: a unit a case."""
        key = entry, body
        if key not in self._cells:
            self._cells[key] = [self._cell(self.entries[entry], body, case)
                                for case in averaged_points(self.plan, self.axes)]
        return [Unit(unit_id(name, first, last), name, cell, first, last)
                for cell, name in self._cells[key]]

    def _cell(self, entry: Entry, body: int, case: dict[int, int]) -> tuple[Cell, str]:
        study = self.plan.study
        cell = study.cell(entry.strategy, body, setting_index(self.plan, case | entry.points))
        name = cell_hash(cell, study.objects[body])
        self._together[name] = repr(batch_key(cell))
        return cell, name


def _share(total: np.ndarray, count: np.ndarray) -> np.ndarray:
    return np.divide(total, count, where=count > 0, out=np.full(len(total), np.nan))
