"""How a race stands after its last look, as a note beside its logs: what `warpgrasp watch` shows.

No result of a race depends on the note. A race that is resumed writes it again, look by look. A
sweep that begins in the same directory removes it: what was worked on last is shown, and tables are
of sweeps alone (`sweeps.run.race_record`).
"""

import json
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from sweeps.analysis.entries import sign_of
from sweeps.output import write_atomic
from sweeps.race.elimination import Look
from sweeps.race.verdict import Verdict, claim, verdict_name
from sweeps.run.plan import Plan
from sweeps.run.race_record import RACE_NOTE, read_race_note, swept_before
from sweeps.run.store import Store
from sweeps.text_table import six_digits


def write_race_note(logs: Path, found: Verdict, statuses: Counter[str],
                    faults: Mapping[str, str], touches: np.ndarray, stage: str = "") -> None:
    """Writes the note into the folder of logs; `touches` is each entry's mean, (entry,).

    `stage` says which race of a search it is; its entries are not those of the study.
    """
    last = found.last
    sign = sign_of(found.metric)
    entries = [{
        "label": found.labels[n], "mean": six_digits(sign * found.means[n]),
        "worse_by": six_digits(last.difference[n]), "at_least": six_digits(found.at_least[n]),
        "verdict": verdict_name(last, n), "episodes": int(found.episodes[n]),
        "touches": six_digits(touches[n]),
        "entry": n, "stops": [] if stage else _stops(found.looks, n)} for n in found.order]
    before = read_race_note(logs) or {}
    content = {
        "swept": before.get("swept", ""), "stage": stage, "metric": found.metric,
        "over": found.over, "objects": found.objects,
        "within": found.rules.within, "confidence": found.rules.confidence,
        "reached": found.reached, "claim": claim(found), "equal": six_digits(found.equal),
        "rungs": [{"replicates": int(look.replicates.max()), "taking": taking,
                   "out": int(look.out.sum()), "open": int(look.open.sum())}
                  for look, taking in zip(found.looks, taking_part(found.looks), strict=True)],
        "statuses": dict(sorted(statuses.items())),
        "faults": dict(sorted(faults.items())), "entries": entries}
    _write(logs, content)


def begin_race_note(plan: Plan, store: Store, metric: str, over: str) -> None:
    """Writes the note of a race that has not looked yet, unless there is one: with what it is of,
    and of which study the sweep was finished before. (If there is one that cannot be read, it was
    raced before, and units that are there may all be of a race.)"""
    if read_race_note(store.logs) is None:
        raced = (store.logs / RACE_NOTE).exists()
        _write(store.logs, {"swept": "" if raced else swept_before(plan, store), "metric": metric,
                            "over": over, "rungs": [], "entries": []})


def end_race_note(logs: Path) -> None:
    """Removes the note: from now on the directory is a sweep's."""
    with suppress(OSError):
        (logs / RACE_NOTE).unlink(missing_ok=True)


def race_state(found: Mapping[str, Any], running: bool) -> str:
    """How far the race of a note is, in words; `running` if a run holds its directory."""
    rungs = found["rungs"]
    if not rungs:
        return "rung 1 is being run" if running else "stopped in rung 1"
    state = ("decided" if not rungs[-1]["open"] else f"rung {len(rungs) + 1} is being run"
             if running else "stopped before it was decided")
    return f"{found['stage']}: {state}" if found["stage"] else state


def _write(logs: Path, content: dict[str, Any]) -> None:
    with suppress(OSError):  # a full disk must not stop a race over a note
        write_atomic(logs / RACE_NOTE, (json.dumps(content) + "\n").encode())


def taking_part(looks: tuple[Look, ...]) -> list[int]:
    """How many entries took episodes in each rung."""
    before = [np.zeros_like(looks[0].replicates), *(look.replicates for look in looks)]
    return [int((now > then).sum()) for then, now in pairwise(before)]


def _stops(looks: tuple[Look, ...], entry: int) -> list[int]:
    """The replicates that an entry had after each rung in which it took part."""
    counts = [0, *(int(look.replicates[entry]) for look in looks)]
    return [now for then, now in pairwise(counts) if now > then]
