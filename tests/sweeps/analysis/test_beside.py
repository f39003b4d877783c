"""The table of settings side by side: means of each strategy on each object, by hand."""

from pathlib import Path

import numpy as np
import pytest
from studies import SMALL, fill, plan_of

from sweeps.analysis.entries import Entry
from sweeps.analysis.objects import BESIDE, beside_table
from sweeps.analysis.paired import Paired, read_paired
from sweeps.analysis.settings import effects


def test_settings_stand_side_by_side() -> None:
    values = np.array([[1.0, 2.0, 3.0, 4.0], [3.0, 4.0, 5.0, 8.0]])  # two episodes
    settings = ("errors.scale=0", "errors.scale=1")
    entries = tuple(Entry(n, f"{name} [{text}]", {0: point}, text)
                    for n, name in enumerate("ab") for point, text in enumerate(settings))
    paired = Paired(entries,
                    ("block", "wedge"), {"chamfer_mm": (values, 2 * values),
                                         "iou": (values / 10, values / 20)}, {}, ())
    table = beside_table(paired)
    assert table.header == ("object", "strategy", "chamfer_mm errors.scale=0",
                            "chamfer_mm errors.scale=1", "iou errors.scale=0",
                            "iou errors.scale=1")
    assert table.rows == (
        ("block", "a", "2.00", "3.00", "0.20", "0.30"),
        ("block", "b", "4.00", "6.00", "0.40", "0.60"),
        ("wedge", "a", "4.00", "6.00", "0.10", "0.15"),
        ("wedge", "b", "8.00", "12.00", "0.20", "0.30"))


def test_settings_that_differ_little_are_told_apart(tmp_path: Path) -> None:
    """Labels of six digits would be the same."""
    text = SMALL + '[sweep.grid]\n"sensors.tendon_threshold_N" = [3, 3.0000001]\n'
    plan = plan_of(tmp_path, text)
    paired = read_paired(plan, [fill(tmp_path, plan)], BESIDE)
    key = "sensors.tendon_threshold_N"
    assert paired.labels[:2] == [f"ring6 [{key}=3]", f"ring6 [{key}=3.0000001]"]
    assert beside_table(paired).header == (
        "object", "strategy", f"chamfer_mm {key}=3", f"chamfer_mm {key}=3.0000001",
        f"iou {key}=3", f"iou {key}=3.0000001")
    assert [e.levels for e in effects(plan, paired, "iou")] == [("3", "3.0000001")] * 2


def test_entries_of_the_same_label_keep_their_columns() -> None:
    values = np.array([[1.0, 2.0, 3.0, 4.0]])
    entries = tuple(Entry(n // 2, label, {0: n % 2}) for n, label in enumerate("aabb"))
    table = beside_table(Paired(entries, ("block",), {"chamfer_mm": (values,),
                                                      "iou": (values / 10,)}, {}, ()))
    assert table.header == ("object", "strategy", "chamfer_mm", "chamfer_mm", "iou", "iou")
    assert table.rows == (("block", "a", "1.00", "2.00", "0.10", "0.20"),
                          ("block", "b", "3.00", "4.00", "0.30", "0.40"))


@pytest.mark.parametrize("sweep", [False, True])
def test_names_that_hold_brackets_are_whole(tmp_path: Path, sweep: bool) -> None:
    """Two strategies were both called "a", with columns of settings that nothing had."""
    text = SMALL.replace('"ring6"', '"a [b=1]"\nwaypoints = { kind = "ring", count = 5 }').replace(
        '"mine"', '"a [c=1]"')
    text += '[sweep.grid]\n"sensors.tendon_threshold_N" = [3, 6]\n' if sweep else ""
    plan = plan_of(tmp_path, text)
    table = beside_table(read_paired(plan, [fill(tmp_path, plan)], BESIDE))
    ends = [f" sensors.tendon_threshold_N={n}" for n in (3, 6)] if sweep else [""]
    assert table.header[2:] == tuple(f"{metric}{end}" for metric in BESIDE for end in ends)
    assert [row[1] for row in table.rows] == ["a [b=1]", "a [c=1]"] * 2


IDLE = SMALL.replace("= 70", "= 4").replace(
    '"ring6"', '"plan [b=1]"\nstrategy = "even"\nbudget = { touches = 24 }')


@pytest.mark.parametrize("turned", [False, True])
def test_a_value_stands_below_its_own_setting(tmp_path: Path, turned: bool) -> None:
    """Of a strategy that a swept key says nothing of there is one column, with nothing else in
    it."""
    text = IDLE + '[sweep.grid]\n"strategy.tilt_deg" = [40, 50]\n'
    if turned:
        head, plan, ring = text.partition("[sweep")[0].split("[[strategy]]")
        text = "[[strategy]]".join([head, ring, plan]) + text[text.index("[sweep"):]
    plan = plan_of(tmp_path, text)
    paired = read_paired(plan, [fill(tmp_path, plan)], BESIDE)
    table = beside_table(paired)
    own = [f"{metric}{end}" for metric in BESIDE
           for end in ("", " strategy.tilt_deg=40", " strategy.tilt_deg=50")]
    assert sorted(table.header[2:]) == sorted(own)
    assert len(table.rows) == 4
    for row in table.rows:
        cells = dict(zip(table.header, row, strict=True))
        one = row[1] == "plan [b=1]"
        for metric in BESIDE:
            assert [cells[name] != "" for name in own if name.startswith(metric)] == [
                one, not one, not one]
            for n, entry in enumerate(paired.entries):
                if entry.label.startswith(row[1]):
                    mean = paired.values[metric][paired.objects.index(row[0])][:, n].mean()
                    assert cells[f"{metric} {entry.setting}".strip()] == f"{mean:.2f}"


def test_a_study_that_sweeps_nothing_has_one_column_a_metric() -> None:
    one = (np.ones((2, 1)),)
    table = beside_table(Paired((Entry(0, "a", {}),), ("block",),
                                {"chamfer_mm": one, "iou": one}, {}, ()))
    assert table.header == ("object", "strategy", "chamfer_mm", "iou")
    assert table.rows == (("block", "a", "1.00", "1.00"),)
