"""`warpgrasp table`: the tables beside the leaderboard."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from sweeps.analysis.confusion import confusion_table, read_confusion
from sweeps.analysis.curves import curves_table, reach_table, read_curves, same_time_table
from sweeps.analysis.entries import check_metric
from sweeps.analysis.objects import ALSO, objects_table
from sweeps.analysis.paired import read_paired
from sweeps.analysis.pairs import pairs_table
from sweeps.analysis.pareto import COST, pareto_table
from sweeps.analysis.settings import read_settings, settings_table
from sweeps.analysis.text_table import TextTable, print_table
from sweeps.output import is_quiet, write_atomic
from sweeps.run.plan import Plan
from sweeps.run.store import Store, open_study
from sweeps.spec.errors import StoreError

Maker = Callable[[Plan, Sequence[Store], str, str | None], TextTable]

KINDS: dict[str, tuple[Maker, str]] = {
    "pairs": (lambda plan, stores, metric, against: pairs_table(
        read_paired(plan, stores, [metric]), metric, against),
        "paired tests between strategies, Holm-corrected"),
    "objects": (lambda plan, stores, metric, _: objects_table(
        read_paired(plan, stores, [metric, *ALSO]), metric),
        "each strategy on each object: medians with intervals, cost"),
    "confusion": (lambda plan, stores, *_: confusion_table(read_confusion(plan, stores)),
                  "what each object was taken for"),
    "curves": (lambda plan, stores, *_: curves_table(read_curves(plan, stores)),
               "error against touches and robot time"),
    "reach": (lambda plan, stores, *_: reach_table(read_curves(plan, stores)),
              "touches and seconds to come within 5 mm and 3 mm"),
    "same-time": (lambda plan, stores, _, against: same_time_table(
        read_curves(plan, stores), against),
        "errors at the robot time at which one strategy ended"),
    "pareto": (lambda plan, stores, metric, _: pareto_table(
        read_paired(plan, stores, [metric, COST]), metric),
        "error against robot time, and which strategies are dominated"),
    "settings": (lambda plan, stores, metric, _: settings_table(
        plan, read_settings(plan, stores, metric), metric), "what each swept factor does"),
}


def table(folders: Sequence[Path], kind: str, out: Path | None, *, metric: str,
          against: str | None, as_json: bool) -> int:
    """Prints one of the tables, and writes it as CSV."""
    check_metric(metric)
    plan, stores = open_study(folders)
    made = KINDS[kind][0](plan, stores, metric, against)
    if out is not None:
        try:
            write_atomic(out, made.csv())
        except OSError as error:
            raise StoreError(f"{out}: cannot be written: {error.strerror}") from None
    print_table(made.header, made.rows, as_json)
    for note in () if is_quiet() else made.notes:
        print(f"note: {note}", file=sys.stderr)
    return 0
