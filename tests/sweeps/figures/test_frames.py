"""Frames that show means whatever intervals and names are, and marks that tell entries apart."""

from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from curved_episodes import table_rows, wide_study, wide_text, written
from drawn_text import looks_right, texts
from matplotlib.container import ErrorbarContainer

from sweeps.analysis.bootstrap import REPLICATES, Estimate
from sweeps.analysis.confusion import Confusion
from sweeps.analysis.curves import Curves, curves_table, mean_curve, read_curves
from sweeps.analysis.entries import Entry
from sweeps.analysis.paired import Paired
from sweeps.analysis.pareto import COST
from sweeps.figures import taxels
from sweeps.figures.contacts import ContactsShown, _drawn
from sweeps.figures.curves import _mean_end
from sweeps.figures.heat_maps import draw_confusion
from sweeps.figures.kinds import KINDS, Asked
from sweeps.figures.pareto import _bars, draw_pareto
from sweeps.figures.style import COLUMN_IN, MARGIN, cut_to, framed, text_width_in, titled
from sweeps.figures.taxels import PadTouch, TaxelsShown, taxels_shown
from sweeps.figures.taxels import _drawn as taxels_drawn
from sweeps.run.plan import Unit
from sweeps.run.unit_file import Columns
from warpgrasp.objects.catalogue_names import BODY_NAMES, NO_ANSWER, NONE_OF_THESE
from warpgrasp.parameters import PadTable

SWEPT = '[sweep.grid]\n"sensors.tendon_threshold_N" = [3.0, 12.0]\n'
WIDE_NAMES = ("Large_Measuring_Cup_With_Handle_And_Wide_Mouth_No_00042", "MW" * 20)


def wide_intervals(unit: Unit) -> Columns:
    """Two objects: the intervals of others like these reach twenty times as far as the means."""
    far = unit.cell.object_name == "block"
    return {"chamfer_mm": np.linspace(12.0, 13.0, 8) if far else np.linspace(8.0, 9.0, 8),
            "robot_time_s": np.full(8, 60.0 if far else 40.0)}


@pytest.mark.parametrize("kind", ["pareto", "curves-touches", "levels"])
def test_intervals_do_not_set_the_frame(tmp_path: Path, kind: str) -> None:
    plan, store = written(tmp_path, 2, wide_intervals, SWEPT)
    ends = [float(row["ci_high"]) for row in table_rows(curves_table(read_curves(plan, [store])))]
    assert max(ends) > 200.0
    drawn = KINDS[kind](Asked(plan, [store]))
    looks_right(drawn)
    low, high = drawn.axes[0].get_ylim()
    assert low < 8.0
    assert 13.0 < high < 40.0
    assert any("cut" in text for text, _ in texts(drawn)) or "cut" in drawn.get_supylabel()


def test_curves_of_unlike_lengths_have_a_logarithmic_axis(tmp_path: Path) -> None:
    def rows(unit: Unit) -> Columns:
        few = unit.cell.strategy.name == "s"
        return {"chamfer_mm": np.linspace(4.0, 5.0, 8), "touches": np.full(8, 8 if few else 600),
                "robot_time_s": np.full(8, 50.0)}

    plan, store = written(tmp_path, 3, rows)
    drawn = KINDS["curves-touches"](Asked(plan, [store]))
    looks_right(drawn)
    assert drawn.axes[0].get_xscale() == "symlog"
    assert drawn.axes[0].get_xlabel() == "touches, logarithmic"
    assert KINDS["curves-time"](Asked(plan, [store])).axes[0].get_xscale() == "linear"


def test_entries_of_a_front_look_different() -> None:
    count = 12
    entries = tuple(Entry(n, f"s{n}", {}) for n in range(count))
    errors = np.linspace(20.0, 5.0, count) + np.linspace(-0.5, 0.5, 8)[:, None]
    costs = np.linspace(10.0, 100.0, count) + np.linspace(-0.5, 0.5, 8)[:, None]
    paired = Paired(entries, ("block", "wedge"), {"chamfer_mm": (errors,) * 2, COST: (costs,) * 2},
                    {name: np.tile(v.mean(0), (1 + REPLICATES, 1))
                     for name, v in (("chamfer_mm", errors), (COST, costs))}, ())
    drawn = draw_pareto(paired, "chamfer_mm")
    looks_right(drawn)
    marks = [(bars.lines[0].get_marker(), bars.lines[0].get_color())
             for bars in drawn.axes[0].containers if isinstance(bars, ErrorbarContainer)
             and str(bars.get_label()).startswith("s") and bars.lines[0] is not None]
    assert len(marks) == len(set(marks)) == count
    assert "less is better" in drawn.axes[0].get_ylabel()
    front = next(line for line in drawn.axes[0].lines if line.get_label() == "_front")
    bars = [part for found in drawn.axes[0].containers if isinstance(found, ErrorbarContainer)
            for part in found.lines[2]]
    assert front.get_zorder() > max(part.get_zorder() for part in bars)  # they lie on its steps


@pytest.mark.parametrize(("lacks", "legend"), [
    ("chamfer_mm", {"2 without a value or time"}), (COST, {"s", "1 without a value or time"})])
def test_a_front_counts_entries_that_have_no_place(lacks: str, legend: set[str]) -> None:
    """Not as dominated, nor as one on the front."""
    values = {"chamfer_mm": np.tile([5.0, 4.0], (8, 1)), COST: np.tile([50.0, 40.0], (8, 1))}
    values[lacks][:, 1 if lacks == COST else slice(None)] = np.nan
    paired = Paired(tuple(Entry(n, "sx"[:n + 1], {}) for n in range(2)), ("block",),
                    {name: (of_object,) for name, of_object in values.items()},
                    {name: np.tile(of_object[0], (1 + REPLICATES, 1))
                     for name, of_object in values.items()}, ())
    drawn = draw_pareto(paired, "chamfer_mm")
    assert {text.get_text() for text in drawn.legends[0].get_texts()} == legend


def test_levels_have_ticks_at_the_values_that_were_swept(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 2, 3, """
[sweep.grid]
"sensors.tendon_threshold_N" = [3.0, 12.0]
"contact.friction" = [0.001, 0.01, 0.1, 1.0]
"strategy.tilt_deg" = [30.0, 31.0, 70.0]
"strategy.closings" = [["together"], ["curl40", "base_then_curl"], ["together", "curl40"]]
"""))
    drawn = KINDS["levels"](Asked(plan, [store]))
    looks_right(drawn)
    newtons, friction, tilt, _ = drawn.axes
    assert newtons.get_xticks().tolist() == [3.0, 12.0]
    assert np.sort(friction.get_xticks()) == pytest.approx([0.001, 0.01, 0.1, 1.0])
    assert 70.0 in tilt.get_xticks()
    assert {line.get_linestyle() for line in drawn.legends[0].get_lines()} != {"None"}
    looks_right(KINDS["settings"](Asked(plan, [store])))


def confusion(known: int, others: int) -> Confusion:
    """Objects that are taken for themselves and some for others, and objects that nothing is."""
    bodies = list(BODY_NAMES)[:known] + [f"Scanned_Object_With_Long_Name_{n:02d}"
                                         for n in range(known - len(BODY_NAMES))]
    objects = [*bodies, *(f"Other_Object_With_A_Long_Name_{n:02d}" for n in range(others))]
    counts = {("ring4", body): Counter({body if body in bodies else NONE_OF_THESE: 8,
                                        bodies[0]: 2, NO_ANSWER: 1}) for body in objects}
    return Confusion(("ring4",), tuple(objects), (*objects, NONE_OF_THESE, NO_ANSWER), counts,
                     {"ring4": 0.7}, ())


@pytest.mark.parametrize(("known", "others"), [
    (1, 0), (5, 24), (11, 0), pytest.param(40, 24, marks=pytest.mark.slow)])
def test_a_confusion_matrix_of_many_objects_is_readable(known: int, others: int) -> None:
    drawn = draw_confusion(confusion(known, others))
    looks_right(drawn)
    axes, answers = drawn.axes[0], known + 1 + (others > 0)
    assert axes.get_xlim() == (-0.5, answers - 0.5)  # none of what nothing was taken for
    share = np.asarray(axes.collections[0].get_array()).reshape(known + others, answers)
    assert share.sum(axis=1) == pytest.approx(100.0)  # of the episodes with each object
    if answers > 13:
        assert f"{known + others + 2} {NO_ANSWER}" in axes.get_xlabel()
        assert axes.get_yticklabels()[2].get_text() == "3 small_cylinder"


def test_a_confusion_matrix_of_wide_names_keeps_its_cells() -> None:
    found = Confusion(("a-very-long-name-" * 4,), WIDE_NAMES, (*WIDE_NAMES, NONE_OF_THESE),
                      {("a-very-long-name-" * 4, name): Counter({NONE_OF_THESE: 3, name: 1})
                       for name in WIDE_NAMES}, {"a-very-long-name-" * 4: 0.5}, ())
    drawn = draw_confusion(found)
    looks_right(drawn)
    assert drawn.axes[0].get_window_extent().width / drawn.dpi > 1.0
    assert drawn.axes[0].get_xticklabels()[-1].get_text() == NONE_OF_THESE


@pytest.mark.parametrize("name", WIDE_NAMES)
def test_titles_keep_their_words_beside_long_names(name: str) -> None:
    cube = np.array([[[x, 0, 0], [x, 30, 0], [x, 30, 50], [x, 0, 50]] for x in (-30.0, 30.0)])
    shown = ContactsShown(name, "recovered body", False, cube, cube, cube[:, 0], np.ones(2, bool))
    looks_right(_drawn(shown, wide=False))
    touches = (PadTouch(1, 1, np.full((16, 16), 90, np.uint8)),)
    looks_right(taxels_drawn(TaxelsShown(name, touches, PadTable())))
    title = titled(name, "traces on faces, planes fitted; neighbours at 89.9 deg")
    assert title.endswith("\ntraces on faces, planes fitted; neighbours at 89.9 deg")
    for line in title.split("\n"):
        assert text_width_in(line, 7.5) < COLUMN_IN
    assert titled("block", "contacts") == "block: contacts"
    assert cut_to("block", 1.0) == "block"


@pytest.mark.parametrize("last", [np.nan, 300.0])
def test_what_is_cut_is_said_below_the_ends(tmp_path: Path, last: float) -> None:
    """Also where the last interval is not known, and bands along the curves alone are cut."""
    plan, store = wide_study(tmp_path, wide_text(2, 2, 8))

    def mean(curves: Curves, axis: str, entry: int, grid: np.ndarray) -> Estimate:
        found = mean_curve(curves, axis, entry, grid)
        high = np.full(len(grid), 300.0)
        high[-1] = last
        return Estimate(found.value, found.low, high)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sweeps.figures.curves.mean_curve", mean)
        drawn = KINDS["curves-touches"](Asked(plan, [store]))
    looks_right(drawn)
    below = drawn.axes[1].get_xlabel()
    assert below == ("at the end\n(95 % cut)" if np.isnan(last) else "at the end,\n95 % (cut)")


def test_entries_end_where_their_episodes_do_in_the_mean_over_objects() -> None:
    """However many episodes an object has; one that was never fitted ends nowhere."""
    def steps(*ends: float) -> list:
        return [(np.array([1.0, end]), None) for end in ends]

    curves: Any = SimpleNamespace(steps={"touches": [
        [steps(5.0, 9.0, np.nan)], [steps(3.0)], [steps(np.nan)]]})
    assert _mean_end(curves, "touches", 0) == pytest.approx((7.0 + 3.0) / 2)


def test_a_frame_is_cut_beyond_three_times_the_largest_mean_or_beyond_one() -> None:
    low = np.array([0.1, 0.2])
    assert framed(np.array([2.0, 4.0]), low, np.array([5.0, 11.9])) is None
    assert framed(np.array([2.0, 4.0]), low, np.array([5.0, 90.0])) == pytest.approx(
        (0.1 - MARGIN * 11.9, 12.0))
    assert framed(np.array([0.1, 0.2]), low, np.array([0.5, 1.0])) is None  # a share's interval


def test_the_touches_shown_are_the_strongest_in_their_order(
        monkeypatch: pytest.MonkeyPatch) -> None:
    sums = (3, 9, 1, 7, 5, 8)
    touches = [PadTouch(n, 0, np.full((16, 16), level, np.uint8)) for n, level in enumerate(sums)]
    monkeypatch.setattr(taxels, "pad_touches", lambda *given: touches)
    shown = taxels_shown(cast(Any, None), PadTable(), "block").touches
    assert [touch.number for touch in shown] == [1, 3, 4, 5]


def test_settings_above_their_strategys_mean_are_tinted_so(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 2, 4, SWEPT))
    *panels, _ = KINDS["settings"](Asked(plan, [store])).axes
    for axes in panels:
        shown = np.array([float(text.get_text()) for text in axes.texts])
        off = np.asarray(axes.collections[0].get_array())
        means = shown.reshape(off.shape) - off
        assert np.abs(off).max() > 0.2
        assert np.abs(means - means.mean(axis=1, keepdims=True)).max() < 0.06


def test_bars_reach_from_the_lower_to_the_upper_end_of_intervals() -> None:
    rng = np.random.default_rng(3)
    cost, error = (Estimate(value, value - rng.uniform(0.1, 0.3, 4), value + rng.uniform(1, 2, 4))
                   for value in rng.uniform(4.0, 6.0, (2, 4)))
    found: Any = SimpleNamespace(cost=cost, error=error)
    for name, of in (("xerr", cost), ("yerr", error)):
        below, above = _bars(found, [3, 1])[name]
        np.testing.assert_allclose(of.value[[3, 1]] - below, of.low[[3, 1]])
        np.testing.assert_allclose(of.value[[3, 1]] + above, of.high[[3, 1]])
