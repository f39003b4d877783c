"""What is shown of a unit's rows, read once each; nothing is written, a damaged file is skipped.

A unit that failed or was damaged may be run again, so it is looked at again."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sweeps.analysis.curves import Steps, episode_steps
from sweeps.analysis.entries import HIGHER_IS_BETTER, fault_of, prior_column, values_of
from sweeps.run.plan import Unit
from sweeps.run.unit_file import Columns, DamagedUnit, read_unit

CURVES_OF = 64
"""Episodes of each object of which error is drawn against touches: the first ones."""


@dataclass(frozen=True)
class UnitRows:
    """A unit's scores and what else is shown of it."""

    scores: np.ndarray
    """(episode,), NaN for an episode without a score."""
    given: np.ndarray
    """What their priors score, (episode,); nothing for a metric that has none."""
    touches: np.ndarray
    statuses: Counter[str]
    steps: tuple[Steps, ...]
    """Error after each fit of the episodes that curves are drawn of; empty of later ones."""
    fault: str = ""
    """What the first episode says whose strategy is at fault."""
    aside: bool = False
    """Whether the unit was set aside as failed: these stand for rows that it may still get."""


class UnitReader:
    """Reads the units of a directory, each once; keeps what is shown of them."""

    def __init__(self, units: Path, logs: Path, metric: str) -> None:
        self.units, self.logs, self.metric = units, logs, metric
        self.known: dict[str, UnitRows] = {}
        self.damaged: dict[str, tuple[int, int]] = {}  # with the time and size of their files
        self.unreadable: set[str] = set()  # units whose files may not be read

    def read(self, unit: Unit) -> UnitRows | None:
        """A unit's rows; of one set aside as failed, episodes that all failed; None if it is not
        there or damaged."""
        if unit.id not in self.known:
            found = self._read(unit)
            if found is None or found.aside:
                return found
            self.known[unit.id] = found
        return self.known[unit.id]

    def _read(self, unit: Unit) -> UnitRows | None:
        count, file, stamp = unit.stop - unit.start, self.units / f"{unit.id}.parquet", (0, 0)
        try:
            found = file.stat()
            stamp = found.st_mtime_ns, found.st_size
            if self.damaged.get(unit.id) == stamp:
                return None
            rows = read_unit(file, unit.id, count)
            self.damaged.pop(unit.id, None)
            self.unreadable.discard(unit.id)
        except DamagedUnit:
            self.damaged[unit.id] = stamp
            return None
        except PermissionError:
            self.unreadable.add(unit.id)
            return None
        except OSError:
            self.damaged.pop(unit.id, None)
            if not (self.logs / f"{unit.id}.failed.log").exists():
                return None
            nothing = np.full(count, np.nan)
            return UnitRows(np.zeros(count) if self.metric in HIGHER_IS_BETTER else nothing,
                            nothing, nothing, Counter(unit_failed=count), (), aside=True)
        return self._shown(unit, rows)

    def _shown(self, unit: Unit, rows: Columns) -> UnitRows:
        steps = tuple(episode_steps(rows, "touches")) if unit.start < CURVES_OF else ()
        prior = prior_column(self.metric)
        return UnitRows(values_of(rows, self.metric),
                        np.zeros(0) if prior is None else values_of(rows, prior),
                        values_of(rows, "touches"), Counter(map(str, rows["status"])), steps,
                        fault_of(rows))
