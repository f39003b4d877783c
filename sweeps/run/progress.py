"""Progress of a run on stderr: a bar on a terminal, otherwise a line now and then."""

import json
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from sweeps.output import is_quiet, say, write_atomic
from warpgrasp.core.plain_text import printable

LINE_EVERY_S = 30.0
NOTE_EVERY_S = 2.0


def read_note(file: Path) -> dict[str, Any]:
    """The last note of a run; without one, or with a damaged one, no run."""
    try:
        found = json.loads(file.read_bytes())
        return {"running": int(found["running"]), "units_per_s": float(found["units_per_s"] or 0),
                "past": sum(int(found[name]) for name in ("kept", "done", "failed")),
                "total": int(found["total"])}
    except (OSError, ValueError, TypeError, KeyError, OverflowError, RecursionError):
        return {"running": 0, "units_per_s": 0.0, "past": 0, "total": 0}


class Progress:
    """Counts units; writes a note that `warpgrasp status` reads while the run goes on."""

    def __init__(self, total: int, note: Path | None = None, quiet: bool = False) -> None:
        self.total = total
        self.note = note
        self.quiet = quiet or is_quiet()
        self.kept_units = self.done_units = self.failed_units = self.episodes = 0
        self.before = 0  # units done when rates were first shown
        self.began = self.first = self.last = time.monotonic()
        self.last_line = self.last_note = self.began
        self.bar: Any = None
        self.task: Any = None

    def __enter__(self) -> "Progress":
        if not self.quiet and sys.stderr.isatty():
            from rich import progress as rich_progress
            from rich.console import Console

            self.bar = rich_progress.Progress(
                "{task.description}", rich_progress.BarColumn(),
                rich_progress.MofNCompleteColumn(), rich_progress.TimeElapsedColumn(),
                rich_progress.TimeRemainingColumn(), console=Console(stderr=True))
            self.task = self.bar.add_task("units", total=self.total)
            self.bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        if self.bar:
            self.bar.stop()
        if self.note:
            self._write_note(0)

    def kept(self) -> None:
        """A unit was there already."""
        self.kept_units += 1
        self._show()

    def more(self, units: int) -> None:
        """A run that is decided in steps goes on by so many units."""
        self.total += units
        if self.bar:
            self.bar.update(self.task, total=self.total)

    def done(self, episodes: int) -> None:
        """A unit was finished."""
        self.done_units += 1
        self.episodes += episodes
        self.last = time.monotonic()
        self._show()

    def measure(self) -> None:
        """Rates are shown from now on: workers run, everything is compiled."""
        self.first = self.last = time.monotonic()
        self.before = self.done_units

    def failed(self, text: str) -> None:
        """A unit was set aside: printed even where notes are suppressed."""
        self.failed_units += 1
        self._print(text)
        self._show()

    def say(self, text: str) -> None:
        """One line on stderr, beside the bar, unless progress is suppressed."""
        if not self.quiet:
            self._print(text)

    def _print(self, text: str) -> None:
        if self.bar:
            self.bar.console.print(printable(text), markup=False, highlight=False)
        else:
            say(text)

    def tick(self, running: int) -> None:
        """Called often: writes what is due."""
        now = time.monotonic()
        if self.note and now - self.last_note >= NOTE_EVERY_S:
            self.last_note = now
            self._write_note(running)
        if not self.bar and now - self.last_line >= LINE_EVERY_S:
            self.last_line = now
            left = self.seconds_left
            self.say(f"{self._past} of {self.total} units"
                     + (f", about {left:.0f} s left" if left is not None else ""))

    @property
    def rate(self) -> float | None:
        """Units a second of this run up to the last one, once it can be estimated."""
        seconds = self.last - self.first
        return (self.done_units - self.before) / seconds if seconds > 0 else None

    @property
    def seconds_left(self) -> float | None:
        """A guess from the rate so far."""
        return (self.total - self._past) / self.rate if self.rate else None

    @property
    def _past(self) -> int:
        return self.kept_units + self.done_units + self.failed_units

    def _show(self) -> None:
        if self.bar:
            self.bar.update(self.task, completed=self._past)

    def _write_note(self, running: int) -> None:
        content = {"running": running, "kept": self.kept_units, "done": self.done_units,
                   "failed": self.failed_units, "total": self.total, "episodes": self.episodes,
                   "units_per_s": self.rate, "seconds_left": self.seconds_left}
        with suppress(OSError):  # a full disk must not stop the run over a note
            write_atomic(self.note, (json.dumps(content) + "\n").encode())  # type: ignore[arg-type]
