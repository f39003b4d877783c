"""What stands in a directory, whether a sweep or a race, looked at again and again."""

import json
import time
from pathlib import Path

from sweeps.run.race_record import race_of
from sweeps.run.store import Store, plan_of
from sweeps.spec.errors import StoreError
from sweeps.watch.race_view import RaceView
from sweeps.watch.state import State
from sweeps.watch.sweep_view import SweepView

METRIC = "chamfer_mm"
"""Of a sweep, where no other score is named."""
SHARE = 0.01
"""Of the time since it last looked, a view takes no more than this for looking."""
LEAST_S = 1.0


def watched_metric(folder: Path, metric: str | None) -> str:
    """The score that a directory's entries are watched by. Raises StoreError where one is asked of
    a race, which has its own."""
    store = Store(folder)
    if metric is not None and race_of(plan_of(store), store) is not None:
        raise StoreError(f"--metric: is of a sweep, and {folder} holds a race, which has its own")
    return metric or METRIC


class View:
    """The state of a directory. A look is due when the last one is so old that looks take less
    than a hundredth of the time."""

    def __init__(self, folder: Path, metric: str) -> None:
        self.store, self.metric = Store(folder), metric
        self.plan = plan_of(self.store)
        self.race = RaceView(self.plan, self.store)
        self.sweep: SweepView | None = None
        self.last: State | None = None
        # not from 0: a page that an earlier watch left open on this port would take another study's
        # state for what it has seen
        self.version = time.time_ns() // 1_000_000
        self._due = 0.0

    def state(self) -> State:
        """The newest state, or the last one where no look is due; `version` counts changes."""
        if self.last is None or time.monotonic() >= self._due:
            began = time.process_time()
            found = self._look()
            took = time.process_time() - began
            self._due = time.monotonic() + max(LEAST_S, took / SHARE)
            self.version += found != self.last
            self.last = found
        return self.last

    def json(self) -> str:
        """The state, with its version."""
        return json.dumps({"version": self.version, **self.state().plain()}, allow_nan=False)

    def _look(self) -> State:
        found = self.race.state()
        if found is not None:
            return found
        if self.store.resolved()["hash"] != self.plan.hash:  # the study has grown
            self.plan = plan_of(self.store)
            self.sweep = SweepView(self.plan, self.store, self.metric,
                                   self.sweep.reader if self.sweep else None)
        self.sweep = self.sweep or SweepView(self.plan, self.store, self.metric)
        return self.sweep.state()
