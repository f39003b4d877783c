"""Units of a study that was given more episodes: what is there of them is kept. And units that
another study has: they are taken over, for their names say all that their rows come from.

A cell's last unit may be short. With more episodes it is another, longer unit; its rows begin with
those of the short one, for rows do not depend on what is run beside them. So only the rest is run,
and the two are joined to the file that a run of the whole unit would have written.
"""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sweeps.output import write_atomic
from sweeps.run.plan import Plan, Unit, part_of
from sweeps.run.store import Store
from sweeps.run.unit_file import Columns, DamagedUnit, read_unit, write_unit


@dataclass(frozen=True)
class Kept:
    """How many units of a study are there before a run, whole or in part."""

    whole: int
    part: int


def kept_units(plan: Plan, store: Store, shard: tuple[int, int] = (1, 1)) -> Kept:
    """What is there of a shard, by the names of its files."""
    there, earlier = store.unit_ids(), store.earlier()
    whole = part = 0
    for unit in plan.units(shard) if there else ():
        if unit.id in there:
            whole += 1
        elif begun(unit, earlier, there):
            part += 1
    return Kept(whole, part)


def begun(unit: Unit, earlier: Sequence[int], there: set[str]) -> Unit | None:
    """The longest part of a unit that was a unit when the study had fewer episodes.

    `earlier` are those numbers of episodes a cell, `there` the ids of the units that have a file.
    """
    stops = {count for count in earlier if unit.start < count < unit.stop}
    for stop in sorted(stops, reverse=True):
        part = part_of(unit, unit.start, stop)
        if part.id in there:
            return part
    return None


def begun_in(stores: Sequence[Store]) -> Callable[[Unit], Unit]:
    """What gives a unit, or in its place the longest part that was a unit before the study grew,
    where that is all that is there of it; `Store.growing` says so then."""
    known = [(store, store.unit_ids(), store.earlier()) for store in stores]

    def longest(unit: Unit) -> Unit:
        if any(unit.id in there or store.log(unit).exists() for store, there, _ in known):
            return unit
        parts = [(part, store) for store, there, earlier in known
                 if (part := begun(unit, earlier, there))]
        if not parts:
            return unit
        part, store = max(parts, key=lambda found: found[0].stop)
        store.growing = True
        return part

    return longest


def rest_of(unit: Unit, part: Unit) -> Unit:
    """What is to be run of a unit of which a part is there."""
    return part_of(unit, part.stop, unit.stop)


def join(store: Store, part: Unit, rest: Unit, whole: Unit) -> bool:
    """Writes a unit from its two parts, and removes those; False where one is damaged."""
    reads = (store.read, store.read_contacts)  # as `files` names them: rows, then contacts
    named = list(zip(reads, store.files(whole).items(), strict=False))
    for read, (path, identity) in reversed(named):
        first, second = read(part), read(rest)
        if first is None or second is None:
            return False
        write_unit(path, identity, _joined(first, second))
    for file in (*store.files(part), *store.files(rest)):
        file.unlink(missing_ok=True)
    return True


def _joined(first: Columns, second: Columns) -> Columns:
    """Rows after one another; NaN where those of one part have no such column, as contacts without
    a row have none of joints past the fourth."""
    return {name: np.concatenate([
        rows[name] if name in rows else np.full(len(rows["episode"]), np.nan, np.float32)
        for rows in (first, second)]) for name in dict.fromkeys((*first, *second))}


def reuse_units(plan: Plan, store: Store, others: Sequence[Store],
                shard: tuple[int, int] = (1, 1)) -> int:
    """Takes the units of a shard that are not there from other studies, and says how many.

    Every row of theirs is read first; what is damaged is left where it is. They are hard links
    where the disk can have them. Raises OSError where nothing can be written.
    """
    own, count = store.unit_ids(), 0
    theirs = [(other, other.unit_ids()) for other in others]
    for unit in plan.units(shard):
        if unit.id not in own:
            count += any(unit.id in ids and _take(store, other, unit) for other, ids in theirs)
    return count


def _take(store: Store, other: Store, unit: Unit) -> bool:
    """Whether another study has a unit whole, which is then in this one as well."""
    pairs = list(zip(other.files(unit), store.files(unit).items(), strict=True))
    for theirs, (_, identity) in pairs:
        rows = unit.stop - unit.start if identity == unit.id else None
        try:
            read_unit(theirs, identity, rows)
        except (OSError, DamagedUnit):
            return False
    for theirs, (ours, _) in reversed(pairs):  # the rows last: a unit that is there is whole
        try:
            os.link(theirs.resolve(), ours)  # of a link, the file: it may go away
        except OSError:  # on another disk, or there already
            write_atomic(ours, theirs.read_bytes())
    return True
