"""Stand-ins with a curve in every row, answers of recognition, failures; and a wide study."""

import csv
import io
from collections.abc import Callable
from pathlib import Path

import fake_episodes
import numpy as np
from studies import plan_of

from sweeps.run.plan import Plan, Unit
from sweeps.run.store import Store
from sweeps.run.unit_file import Columns, write_unit
from sweeps.run.worker import run_units
from sweeps.spec.cell import Cell
from sweeps.text_table import TextTable

OBJECTS = ("block", "large_cylinder", "small_cylinder", "wedge", "lightbulb", "funnel",
           "wine_bottle", "beer_bottle", "coke_bottle", "orangina_bottle")
REFITS = 5


def lists(rows: list[list[float]]) -> np.ndarray:
    """A column of lists."""
    column = np.empty(len(rows), object)
    for n, row in enumerate(rows):
        column[n] = np.array(row, float)
    return column


@fake_episodes.cell_by_cell
def run_episodes(cell: Cell, episodes: np.ndarray, device: str) -> Columns:
    rows = fake_episodes.rows_of(cell, episodes)
    end = rows["chamfer_mm"]
    share = np.arange(1, REFITS + 1) / REFITS
    rows |= {
        "hausdorff95_mm": 3 * end, "arm_path_m": rows["robot_time_s"] / 20,
        "volume_ratio": 1 + end / 50, "coverage5mm": 1 / (1 + end / 10),
        "curve_touches": lists([(np.round(share * t)).tolist() for t in rows["touches"]]),
        "curve_time_s": lists([(share * t).tolist() for t in rows["robot_time_s"]]),
        "curve_chamfer_mm": lists([(e + 8 * (1 - share)).tolist() for e in end]),
        "curve_iou": lists([(i * share).tolist() for i in rows["iou"]]),
    }
    return fake_episodes.with_contacts(rows, cell, episodes)


def wide_text(strategies: int = 3, objects: int = 6, episodes: int = 16, more: str = "") -> str:
    names = ", ".join(f'"{name}"' for name in OBJECTS[:objects])
    lines = [f"schema = 1\nname = \"wide\"\nseed = 5\nepisodes_per_cell = {episodes}\n"
             f"objects = [{names}]"]
    lines += [f'[[strategy]]\nname = "s{"x" * n}"\nwaypoints = {{ kind = "ring", count = 6 }}'
              for n in range(strategies)]
    return "\n".join([*lines, more]) + "\n"


def wide_study(folder: Path, text: str | None = None) -> tuple[Plan, Store]:
    """A study on disk, run in this process."""
    plan = plan_of(folder, wide_text() if text is None else text)
    store = Store(folder)
    store.open_for(plan, (folder / "spec.toml").read_bytes(), "cpu")
    for unit in plan.units():
        write_unit(store.path(unit), unit.id, run_units(run_episodes, [unit], "cpu")[0])
    return plan, store


SWEPT = wide_text(2, 3, 8, """
[sweep.grid]
"sensors.tendon_threshold_N" = [3.0, 6.0]
[sweep.sobol]
n = 16
"object.yaw_deg" = { low = -180, high = 180 }
""")


def unfinished_study(
    folder: Path, objects: int, there: int, episodes: int = 16
) -> tuple[Plan, Store]:
    """A study of which the units of the first objects alone are there."""
    plan, store = wide_study(folder, wide_text(2, objects, episodes))
    names = [body.name for body in plan.study.objects[there:]]
    for unit in plan.units():
        if unit.cell.object_name in names:
            store.path(unit).unlink()
    return plan, store


def written(folder: Path, objects: int, rows: Callable[[Unit], Columns],
            more: str = "") -> tuple[Plan, Store]:
    """A study of two strategies, "s" and "sx", of eight episodes with these rows."""
    plan, store = plan_of(folder, wide_text(2, objects, 8, more)), Store(folder)
    store.open_for(plan, None, "cpu")
    for unit in plan.units():
        write_unit(store.path(unit), unit.id, {
            "episode": np.arange(8), "status": np.full(8, "ok", object),
            "touches": np.full(8, 8), **rows(unit)})
    return plan, store


def table_rows(table: TextTable) -> list[dict[str, str]]:
    """The rows of a table's CSV."""
    return list(csv.DictReader(io.StringIO(table.csv().decode())))
