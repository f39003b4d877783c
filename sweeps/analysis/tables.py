"""`warpgrasp table`: the tables beside the leaderboard."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from sweeps.analysis.confusion import confusion_table, read_confusion
from sweeps.analysis.curves import (
    Curves,
    curves_table,
    reach_table,
    read_curves,
    same_time_table,
)
from sweeps.analysis.entries import check_metric
from sweeps.analysis.objects import ALSO, BESIDE, beside_table, objects_table
from sweeps.analysis.paired import Paired, read_paired
from sweeps.analysis.pairs import pairs_table
from sweeps.analysis.pareto import columns_of, pareto_table
from sweeps.analysis.settings import read_settings, settings_table
from sweeps.output import note
from sweeps.result_file import check_table, write_result
from sweeps.run.plan import Plan
from sweeps.run.race_record import open_sweep
from sweeps.run.store import Store, damaged_notes
from sweeps.text_table import TextTable, print_table


@dataclass(frozen=True)
class Asked:
    """The study, and the options of the command."""

    plan: Plan
    stores: Sequence[Store]
    metric: str
    against: str | None
    over: str | None

    def paired(self, *also: str) -> Paired:
        """Every entry's values of the metric, and of others."""
        return read_paired(self.plan, self.stores, [self.metric, *also], over=self.over)

    def curves(self) -> Curves:
        """Every episode's error as it falls."""
        return read_curves(self.plan, self.stores, self.over)


KINDS: dict[str, tuple[Callable[[Asked], TextTable], str]] = {
    "pairs": (lambda a: pairs_table(a.paired(), a.metric, a.against),
              "paired tests between strategies, Holm-corrected"),
    "objects": (lambda a: objects_table(a.paired(*ALSO), a.metric),
                "each strategy on each object: medians with intervals, cost"),
    "beside": (lambda a: beside_table(read_paired(a.plan, a.stores, BESIDE, over=a.over)),
               "each strategy on each object, the settings of a study side by side"),
    "confusion": (lambda a: confusion_table(read_confusion(a.plan, a.stores)),
                  "what each object was taken for"),
    "curves": (lambda a: curves_table(a.curves()), "error against touches and robot time"),
    "reach": (lambda a: reach_table(a.curves()),
              "touches and seconds to come within 5 mm and 3 mm"),
    "same-time": (lambda a: same_time_table(a.curves(), a.against),
                  "errors at the robot time at which one strategy ended"),
    "pareto": (lambda a: pareto_table(a.paired(*columns_of(a.metric)), a.metric),
               "error against robot time, and which strategies are dominated"),
    "settings": (lambda a: settings_table(
        a.plan, read_settings(a.plan, a.stores, a.metric, a.over), a.metric),
        "what each swept factor does"),
}


def table(folders: Sequence[Path], kind: str, out: Path | None, *, metric: str,
          against: str | None, over: str | None, as_json: bool) -> int:
    """Prints one of the tables, and writes it as CSV."""
    check_metric(metric)
    check_table(out)
    plan, stores = open_sweep(folders)
    made = KINDS[kind][0](Asked(plan, stores, metric, against, over))
    if out is not None:
        write_result(out, made.csv())
    print_table(made.header, made.rows, as_json)
    for line in (*made.notes, *damaged_notes(stores)):
        note(line)
    return 0
