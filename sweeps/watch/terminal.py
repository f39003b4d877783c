"""`warpgrasp watch --terminal`: the same state as text, where there is no browser."""

import sys
import time
from pathlib import Path

from sweeps.analysis.entries import check_metric
from sweeps.race.verdict import verdict_word
from sweeps.text_table import number_text, print_table
from sweeps.watch.state import Row, State
from sweeps.watch.view import View
from warpgrasp.core.plain_text import on_one_line

EVERY_S = 2.0
ROWS = 20
CLEAR = "\033[H\033[2J\033[3J"


def watch_in_terminal(folder: Path, *, metric: str) -> int:
    """Prints how a sweep or race stands; on a terminal again and again until its run ends, or
    Ctrl-C."""
    check_metric(metric)
    view = View(folder, metric)
    while True:
        state = view.state()
        live = sys.stdout.isatty() and state.running
        print((CLEAR if live else "") + as_text(state), flush=True)
        race = state.kind == "race"
        print_table(HEADER, [_cells(row, race) for row in state.rows[:ROWS]], False)
        rest = max(0, len(state.rows) - ROWS) + state.more
        print("\n".join([*([f"... {rest:,} more"] if rest else []), "", *_ends(state)]), flush=True)
        if not live:
            return 0
        try:
            time.sleep(EVERY_S)
        except KeyboardInterrupt:
            return 0


ONE_SIDED = ("Where a bar begins is in the column low, or high where more is better; the other "
             "side has no bound (NA).")
HEADER = ("strategy", "mean", "low", "high", "behind", "verdict", "episodes", "touches")


def _cells(row: Row, one_sided: bool = False) -> tuple[str, ...]:
    """A row as text. A race bounds an entry on one side: there the mean is no end of an interval,
    as it is of a bar that is drawn from the bound to it."""
    ends = (None if one_sided and end == row.mean else end for end in (row.low, row.high))
    numbers = (row.mean, *ends, row.behind)
    return (row.label, *(_text(value, 3) for value in numbers), verdict_word(row.verdict),
            f"{row.episodes}", _text(row.touches, 1))


def _text(value: float | None, digits: int) -> str:
    return "NA" if value is None else number_text(value, digits)


def as_text(state: State) -> str:
    """The lines above the table."""
    lines = [f"{state.kind} {state.name}", state.headline,
             "  ".join(f"{what}: {value}" for what, value in state.facts)]
    if state.rungs:
        lines.append("entries in each rung: " + " ".join(f"{count}" for _, count in state.rungs))
    return "\n".join(map(on_one_line, [*lines, *state.notes])) + "\n"


def _ends(state: State) -> list[str]:
    """The lines below the table."""
    failed = ", ".join(f"{count:,} {name}" for name, count in state.failures)
    failed = failed or ("none" if state.rows else "not known yet")
    return [on_one_line(line) for line in (
        state.about, *([ONE_SIDED] if state.kind == "race" else ()),
        f"failed episodes: {failed}",
        *state.faults, *(f"unit set aside: {text}" for text in state.failed_units))]
