"""`warpgrasp table`: everything that the units alone tell, beside the leaderboard."""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from sweeps.analysis.entries import check_metric
from sweeps.analysis.text_table import TextTable, print_table
from sweeps.output import is_quiet, write_atomic
from sweeps.run.plan import Plan
from sweeps.run.store import Store, open_study
from sweeps.spec.errors import StoreError

Maker = Callable[[Plan, Sequence[Store], str, str | None], TextTable]


def _pairs(plan: Plan, stores: Sequence[Store], metric: str, against: str | None) -> TextTable:
    from sweeps.analysis.paired import read_paired
    from sweeps.analysis.pairs import pairs_table

    return pairs_table(read_paired(plan, stores, [metric]), metric, against)


def _objects(plan: Plan, stores: Sequence[Store], metric: str, against: str | None) -> TextTable:
    from sweeps.analysis.objects import ALSO, objects_table
    from sweeps.analysis.paired import read_paired

    return objects_table(read_paired(plan, stores, [metric, *ALSO]), metric)


def _confusion(plan: Plan, stores: Sequence[Store], metric: str, against: str | None) -> TextTable:
    from sweeps.analysis.confusion import confusion_table, read_confusion

    return confusion_table(read_confusion(plan, stores))


def _curves(plan: Plan, stores: Sequence[Store], metric: str, against: str | None) -> TextTable:
    from sweeps.analysis.curves import curves_table, read_curves

    return curves_table(read_curves(plan, stores))


def _reach(plan: Plan, stores: Sequence[Store], metric: str, against: str | None) -> TextTable:
    from sweeps.analysis.curves import reach_table, read_curves

    return reach_table(read_curves(plan, stores))


def _same_time(plan: Plan, stores: Sequence[Store], metric: str,
               against: str | None) -> TextTable:
    from sweeps.analysis.curves import read_curves, same_time_table

    return same_time_table(read_curves(plan, stores), against)


def _pareto(plan: Plan, stores: Sequence[Store], metric: str, against: str | None) -> TextTable:
    from sweeps.analysis.paired import read_paired
    from sweeps.analysis.pareto import COST, pareto_table

    return pareto_table(read_paired(plan, stores, [metric, COST]), metric)


def _settings(plan: Plan, stores: Sequence[Store], metric: str, against: str | None) -> TextTable:
    from sweeps.analysis.settings import read_settings, settings_table

    return settings_table(plan, read_settings(plan, stores, metric), metric)


KINDS: dict[str, tuple[Maker, str]] = {
    "pairs": (_pairs, "paired tests between strategies, Holm-corrected"),
    "objects": (_objects, "each strategy on each object: medians with intervals, cost"),
    "confusion": (_confusion, "what each object was taken for"),
    "curves": (_curves, "error against touches and robot time"),
    "reach": (_reach, "touches and seconds to come within 5 mm and 3 mm"),
    "same-time": (_same_time, "errors at the robot time at which one strategy ended"),
    "pareto": (_pareto, "error against robot time, and which strategies are dominated"),
    "settings": (_settings, "what each swept factor does"),
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
