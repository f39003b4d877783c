"""What a directory records of a race: that it was worked on last, and which units it has.

The record is the note that a race leaves after every rung (`logs/race.json`). A sweep that begins
in the same directory removes it.
"""

import json
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from shlex import quote
from typing import Any

import numpy as np

from sweeps.run.plan import BLOCK, Plan
from sweeps.run.store import Store, open_study
from sweeps.spec.errors import StoreError
from sweeps.spec.study import Study

RACE_NOTE = "race.json"
WHOLE = {"stage", "objects", "within", "confidence", "reached", "claim", "statuses"}
ENTRY = {"label", "mean", "worse_by", "at_least", "verdict", "episodes", "touches", "entry",
         "stops"}
"""Keys of the note of a race that has looked, and of its entries."""


def read_race_note(logs: Path) -> dict[str, Any] | None:
    """The note of a race; None where there is none, or none of this form that can be read."""
    try:
        found = json.loads((logs / RACE_NOTE).read_bytes())
        begun = {"metric", "over", "rungs", "entries"} <= set(found)
        looked = set(found) >= WHOLE and bool(found["entries"]) and all(
            set(entry) >= ENTRY for entry in found["entries"])
        known = begun and (looked or not found["rungs"])
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None
    return found if known else None


def swept_before(plan: Plan, store: Store) -> str:
    """The hash of a study whose sweep is finished, as a race that begins notes it; or nothing."""
    if plan.study.search is not None:
        return ""
    there = store.unit_ids()
    whole = all(unit.id in there or store.log(unit).exists() for unit in plan.units())
    return plan.hash if whole else ""


def race_of(plan: Plan, store: Store) -> dict[str, Any] | None:
    """The note of the race that a directory holds; None where it is a sweep's, or where the sweep
    of this study was finished before the race began.

    Raises StoreError (exit code 3) where there is a note that cannot be read.
    """
    found = read_race_note(store.logs)
    if found is None and (store.logs / RACE_NOTE).exists():
        raise StoreError(f"{store.logs / RACE_NOTE} should say how the race in {store.folder} "
                         "stands, and cannot be read; `warpgrasp race` with the same options "
                         "writes it again from the units that are there", 3)
    return None if found is None or found.get("swept") == plan.hash else found


def open_sweep(folders: Sequence[Path]) -> tuple[Plan, list[Store]]:
    """As `open_study`, for what compares entries: of a race, StoreError (exit code 3)."""
    plan, stores = open_study(folders)
    refuse_races(plan, stores)
    return plan, stores


def refuse_races(plan: Plan, stores: Sequence[Store]) -> None:
    """Raises StoreError (exit code 3) where a directory holds a race: its entries have as many
    episodes as it took to decide, and the first of them alone may contradict it."""
    for folder in (store.folder for store in stores if race_of(plan, store) is not None):
        outcome = (", whose outcome is in its race.csv and race.svg: read race.csv"
                   if (folder / "race.csv").exists() else " that has no outcome yet")
        advice = ("" if plan.study.search is not None else
                  f"; `warpgrasp sweep SPEC.toml -o {quote(str(folder))}` finishes a sweep there")
        raise StoreError(f"{folder} holds a race{outcome}. Leaderboards, tables, figures, reports "
                         f"and comparisons are of the episodes of a sweep{advice}", 3)


def object_order(study: Study) -> list[int]:
    """The order in which a race over objects like these meets them, drawn from the seed."""
    bodies = len(study.objects)
    drawn = np.random.Generator(np.random.Philox(np.random.SeedSequence([study.head.seed, bodies])))
    return [int(body) for body in drawn.permutation(bodies)]


def race_blocks(study: Study, over: str, start: int, stop: int) -> Iterator[tuple[int, int, int]]:
    """(object, first, last) of each block of episodes of the replicates `start` to `stop`."""
    if over == "like-these":
        whole = [(body, 0, study.head.episodes_per_cell)
                 for body in object_order(study)[start:stop]]
    else:
        whole = [(body, start, stop) for body in range(len(study.objects))]
    for body, first, last in whole:
        for begin in range(first, last, BLOCK):
            yield body, begin, min(begin + BLOCK, last)


def taken_blocks(study: Study, note: dict[str, Any], stops: Sequence[int]
                 ) -> Iterator[tuple[int, int, int]]:
    """(object, first, last) of each block that an entry of a race's note has taken."""
    for start, stop in pairwise([0, *stops]):
        yield from race_blocks(study, note["over"], start, stop)
