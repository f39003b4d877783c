"""`warpgrasp report`: a study as one HTML file that needs no network.

It is made from the study's directory; the episodes shown in 3-D are run again. It holds no clock
time: the same study gives the same bytes.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from sweeps.analysis.confusion import Confusion, read_confusion
from sweeps.analysis.curves import Curves, read_curves
from sweeps.analysis.leaderboard import MORE, Leaderboard, make_leaderboard
from sweeps.analysis.paired import Paired, interval_note, read_paired
from sweeps.analysis.pareto import columns_of
from sweeps.output import note
from sweeps.report.html import page, paragraph
from sweeps.report.sections import (
    METRIC,
    confusion_section,
    curves_section,
    leaderboard_section,
    objects_section,
    pairs_section,
    pareto_section,
    reproduce_section,
    settings_section,
    spec_section,
    views_section,
)
from sweeps.report.views import Views, make_views, pick_episodes, pick_objects
from sweeps.result_file import check_result, write_result
from sweeps.run.plan import Plan
from sweeps.run.race_record import open_sweep
from sweeps.run.store import Store
from sweeps.spec.errors import StoreError
from warpgrasp.core.plain_text import counted, first_few

SCRIPTS = ("tables.js", "solids.js", "views.js", "print.js")
MANY_FAIL = 0.2
POPULATIONS = {"these": "these objects", "like-these": "objects like these"}
NOTES = 6
"""Notes that stand open on the page."""


def report(folders: Sequence[Path], out: Path, *, views: bool, device: str,
           workers: int = 1) -> int:
    """Writes the report of a study and prints its path; StoreError where it cannot be written.

    The exit code comes back: 1 where a worker process died and episodes are missing from the page.
    """
    check_result(out)
    plan, stores = open_sweep(folders)
    content, died = _made(plan, stores, views, device, workers)
    write_result(out, content)
    print(out)
    return int(died)


def make_report(plan: Plan, stores: Sequence[Store], *, views: bool = True,
                device: str = "cpu", workers: int = 1) -> bytes:
    """The bytes of the page. Raises StoreError where no block of episodes of a sweep is finished.
    """
    return _made(plan, stores, views, device, workers)[0]


def _made(plan: Plan, stores: Sequence[Store], views: bool, device: str,
          workers: int) -> tuple[bytes, bool]:
    """The bytes of the page, and whether a worker process died over it."""
    board = make_leaderboard(plan, stores)
    paired = read_paired(plan, stores, [*columns_of(METRIC), "touches", "failure_rate"])
    if not paired.objects:
        raise StoreError(f"{stores[0].folder}: no block of episodes is finished for every "
                         "strategy yet; `warpgrasp status` says how far it is")
    curves, confusion = read_curves(plan, stores), read_confusion(plan, stores)
    shown = Views({}, [], ["3-D views were left out (--no-views)"])
    if views:
        shown = make_views(plan, [*pick_episodes(plan, stores), *pick_objects(plan, stores)],
                           device, workers, note)
    body = "".join(_parts(plan, stores, board, paired, curves, confusion, shown))
    name = plan.study.head.name or "study"
    return page(f"{name}: warpgrasp report", body,
                {"bodies": shown.bodies, "episodes": shown.episodes}, SCRIPTS), shown.died


def _parts(plan: Plan, stores: Sequence[Store], board: Leaderboard, paired: Paired,
           curves: Curves, confusion: Confusion, shown: Views) -> Sequence[str]:
    head = plan.study.head
    first = board.rows[0]
    best = dict(zip(board.header, first, strict=True))
    strategies, objects = len(plan.study.strategies), len(plan.study.objects)
    asked = (f"{strategies} strateg{'y' if strategies == 1 else 'ies'}, "
             f"{counted(objects, 'object')}, {counted(head.episodes_per_cell, 'episode')} of each "
             "strategy on each object"
             + (f" under each of {plan.study.settings_each} settings" if plan.study.axes else ""))
    return [
        '<a class="skip" href="#board">To the leaderboard</a><header>',
        f"<h1>{escape(head.name or 'study')}</h1>", paragraph(asked, "lead"),
        paragraph("No strategy has a score." if best[METRIC] == "NA" else
                  f"First is {best['strategy']}: chamfer distance {best[METRIC]} mm "
                  f"({_interval(best, paired.over)}), IoU {best['iou']}. {_rivals(board)}", "lead"),
        "</header><main>", _warnings(board, paired, shown),
        leaderboard_section(board, paired), curves_section(curves),
        pareto_section(paired), objects_section(paired),
        pairs_section(paired), confusion_section(confusion),
        settings_section(plan, stores), views_section(plan, shown),
        spec_section(_spec(stores), plan), reproduce_section(plan, _environment(stores)),
        "</main>"]


def _interval(row: Mapping[str, str], over: str) -> str:
    """The interval of a row's mean, of one of POPULATIONS; of the other where that is not known."""
    for population in (over, *(name for name in POPULATIONS if name != over)):
        stem = f"{METRIC}_{'these' if population == 'these' else 'ci'}"
        low, high = row[f"{stem}_low"], row[f"{stem}_high"]
        if "NA" not in (low, high):
            return f"95 % interval of {POPULATIONS[population]} {low} to {high}"
    return "no interval is known"


def _rivals(board: Leaderboard) -> str:
    """How many entries cannot be told from the first, by each of the two intervals."""
    rows = [dict(zip(board.header, row, strict=True)) for row in board.rows[1:]]
    rows = [row for row in rows if row["rank"].isdigit()]
    if not rows:
        return ""
    ties = [sum(row[f"delta_{over}_low"] == "NA" or float(row[f"delta_{over}_low"]) <= 0.0
                for row in rows) for over in ("these", "ci")]
    return (f"Of the {counted(len(rows), 'other')}, {ties[0]} cannot be told from it on these "
            f"objects, {ties[1]} on objects like these.")


def _warnings(board: Leaderboard, paired: Paired, shown: Views) -> str:
    notes = list(dict.fromkeys([*paired.notes, *shown.notes]))
    if (option := interval_note(paired.over)) in notes:  # a page takes no options
        notes[notes.index(option)] = ("where one interval is shown, it is of "
                                      + POPULATIONS[paired.over])
    at, name = board.header.index("failure_rate"), board.header.index("strategy")
    failing = [row[name] for row in board.rows if row[at] != "NA" and float(row[at]) > MANY_FAIL]
    if failing:
        notes.append(f"more than {MANY_FAIL:.0%} of the episodes failed: {first_few(failing)}")
    notes += _unsaid(board.notes, set(notes))
    first, folded = ("".join(f"<li>{escape(note)}</li>" for note in part)
                     for part in (notes[:NOTES], notes[NOTES:]))
    if folded:
        folded = (f"<li><details><summary>{counted(len(notes) - NOTES, 'more note')}</summary>"
                  f"<ul>{folded}</ul></details></li>")
    return f'<ul class="warnings">{first}{folded}</ul>' if notes else ""


def _unsaid(notes: Sequence[str], said: set[str]) -> Iterator[str]:
    """Notes of a leaderboard that the page has not said, in these or in other words. How many more
    there are of a kind goes with the note before it."""
    new = False
    for line in notes:
        new = new if line.endswith(MORE) else (
            line not in said and not line.startswith("the ranking is of"))
        if new:
            yield line


def _spec(stores: Sequence[Store]) -> str:
    try:
        return (stores[0].folder / "spec.toml").read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return ""


def _environment(stores: Sequence[Store]) -> dict[str, Any]:
    try:
        found = json.loads((stores[0].folder / "environment.json").read_bytes())
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}

