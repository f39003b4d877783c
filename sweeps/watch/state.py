"""How a sweep or a race stands, as plain data for the page and the terminal."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from sweeps.analysis.entries import fault_line
from sweeps.run.progress import read_note
from sweeps.run.store import Store
from warpgrasp.core.plain_text import counted

FAILED_SHOWN = 8
LOG_BYTES = 4096


@dataclass(frozen=True)
class Row:
    """An entry: its mean and from where to where it is known to lie, and what it is said to be."""

    label: str
    mean: float | None
    low: float | None
    high: float | None
    behind: float | None
    """Its mean minus the first's."""
    verdict: str
    """best, worse, open, tied (see `sweeps.race.verdict.verdict_word`), or empty for open."""
    episodes: int
    objects: int
    touches: float | None


@dataclass(frozen=True)
class State:
    """All that is shown. Every text in it may come from a user."""

    kind: str
    """sweep or race."""
    name: str
    running: bool
    headline: str
    facts: tuple[tuple[str, str], ...]
    """Short ones, with what they are of."""
    done: float
    """The share of the work that is done; of a race that runs, unknown: -1."""
    metric: str
    about: str
    """What the intervals claim."""
    rows: tuple[Row, ...]
    more: int
    """Entries beyond those in `rows`."""
    rungs: tuple[tuple[int, int], ...] = ()
    """Of a race: episodes of each object, and how many entries took them."""
    curves: tuple[tuple[str, list[tuple[float, float]]], ...] = ()
    failures: tuple[tuple[str, int], ...] = ()
    """Episodes by what became of them, but for those that are all right."""
    failed_units: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    """What is wrong with strategies whose episodes failed for it."""
    notes: tuple[str, ...] = field(default=())

    def plain(self) -> dict[str, Any]:
        """As JSON has it."""
        return asdict(self)


@dataclass(frozen=True)
class Pace:
    """Who works on a directory, and how fast."""

    running: bool
    units_per_s: float
    in_hand: int
    past: int
    """Units that are done, of those asked for so far."""
    total: int


def pace_of(store: Store) -> Pace:
    """What the runs that hold the directory note of themselves."""
    holders = store.holders()
    notes = [read_note(store.note(shard)) for shard in holders]
    return Pace(bool(holders), *(sum(note[name] for note in notes)
                                 for name in ("units_per_s", "running", "past", "total")))


def pace_facts(pace: Pace, left: int | None) -> list[tuple[str, str]]:
    """The rate, and how long the rest takes at it (of a race: of the rung)."""
    if not pace.running:
        return []
    found = [("in hand", counted(pace.in_hand, "unit"))]
    if pace.units_per_s > 0:
        found.append(("rate", f"{pace.units_per_s:.3g} units/s"))
        if left is not None:
            found.append(("left", duration(left / pace.units_per_s)))
    return found


def duration(seconds: float) -> str:
    """Seconds, minutes or hours, whichever reads best."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def failures_of(statuses: Counter[str]) -> tuple[tuple[str, int], ...]:
    """Episodes that failed by why, the most frequent first."""
    bad = [(name, count) for name, count in statuses.items() if name != "ok"]
    return tuple(sorted(bad, key=lambda pair: (-pair[1], pair[0])))


def faults_of(faults: Mapping[str, str]) -> tuple[str, ...]:
    """What is said of strategies at fault, as a leaderboard has it, of the first ones."""
    told = [fault_line(label, fault) for label, fault in sorted(faults.items())]
    more = len(told) - FAILED_SHOWN
    return (*told[:FAILED_SHOWN], *([f"and {more} more, see the notes of the rows"]
                                    if more > 0 else []))


def failed_units(logs: Path) -> tuple[str, ...]:
    """What units that were set aside say of themselves: what they were, and the error's last line.
    """
    files = sorted(logs.glob("*.failed.log"))
    told = [text for file in files[:FAILED_SHOWN] if (text := _told(file))]
    more = len(files) - FAILED_SHOWN
    return (*told, *([f"and {more} more, see {logs.name}/*.failed.log"] if more > 0 else []))


def _told(file: Path) -> str:
    try:
        with file.open("rb") as stream:
            first = stream.readline(LOG_BYTES).decode(errors="replace").strip()
            stream.seek(max(0, file.stat().st_size - LOG_BYTES))
            last = stream.read().decode(errors="replace").rstrip().rpartition("\n")[2]
    except OSError:
        return ""
    return f"{first}: {last}" if last and last != first else first
