"""Figures: the same bytes twice, and no text over another or off the page."""

import re
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from curved_episodes import SWEPT, table_rows, wide_study, wide_text
from drawn_text import looks_right, texts
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.proj3d import proj_transform
from PIL import Image

from strategies.ready_made import STRATEGIES
from sweeps.analysis.bootstrap import REPLICATES
from sweeps.analysis.entries import Entry
from sweeps.analysis.paired import Paired
from sweeps.analysis.pareto import COST, find_front
from sweeps.analysis.settings import read_settings, settings_table
from sweeps.cli import main as cli
from sweeps.episode.contact_rows import contacts_csv
from sweeps.episode.episodes import run_block
from sweeps.figures import kinds as figures
from sweeps.figures.contacts import contacts_figure
from sweeps.figures.contour import contour_figure, fill_axes
from sweeps.figures.faces import faces_figure
from sweeps.figures.forest import draw_forest
from sweeps.figures.kinds import KINDS, Asked
from sweeps.figures.style import distinct_labels, drawing, encode, figure
from sweeps.figures.taxels import (
    PadTouch,
    TaxelsShown,
    _drawn,
    draw_taxels,
    image_ellipse,
    taxels_figure,
)
from sweeps.run.plan import Plan
from sweeps.run.store import Store
from sweeps.spec.cell import Cell
from sweeps.spec.errors import StoreError
from warpgrasp.parameters import PadTable

EPISODE_KINDS = ("contacts", "faces", "contour", "taxels", "grasp")
STUDY_KINDS = [kind for kind in KINDS if kind not in (*EPISODE_KINDS, "settings", "levels")]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Store]:
    return wide_study(tmp_path_factory.mktemp("wide"), wide_text(10, 10, 8))


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Store]:
    return wide_study(tmp_path_factory.mktemp("swept"), SWEPT)


@pytest.mark.parametrize("kind", STUDY_KINDS)
def test_text_is_on_the_page_and_apart(study: tuple[Plan, Store], kind: str) -> None:
    looks_right(KINDS[kind](Asked(study[0], [study[1]])))


@pytest.fixture(scope="module", params=[1, 40, pytest.param(200, marks=pytest.mark.slow)])
def entries(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
            ) -> tuple[Plan, Store]:
    """Studies of so many entries: strategies, and settings of a long name."""
    values = ", ".join(str(3.0 + 0.1 * n) for n in range(request.param // 5))
    grid = f'[sweep.grid]\n"sensors.tendon_threshold_N" = [{values}]\n' if values else ""
    return wide_study(tmp_path_factory.mktemp("entries"),
                      wide_text(min(request.param, 5), 3, 4, grid))


@pytest.mark.parametrize("kind", STUDY_KINDS)
def test_any_number_of_entries_is_readable(entries: tuple[Plan, Store], kind: str) -> None:
    drawn = KINDS[kind](Asked(entries[0], [entries[1]]))
    looks_right(drawn)
    assert drawn.get_figheight() < 6.0  # of a page
    if kind == "forest" and entries[0].study.setting_count > 1:
        count = entries[0].study.setting_count * len(entries[0].study.strategies)
        assert any(f"best 20 of {count}" in text for text, _ in texts(drawn)) == (count > 20)


def test_settings_of_any_number_of_levels_are_readable(entries: tuple[Plan, Store]) -> None:
    if not entries[0].study.axes:
        pytest.skip("a study of one setting has no such figure")
    looks_right(KINDS["settings"](Asked(entries[0], [entries[1]])))
    looks_right(KINDS["levels"](Asked(entries[0], [entries[1]])))


@pytest.mark.parametrize("kind", ["forest", "pareto", "curves-time"])
def test_one_episode_is_drawn_without_intervals(tmp_path: Path, kind: str) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 1, 1))
    looks_right(KINDS[kind](Asked(plan, [store])))


def test_a_forest_explains_the_lines_that_it_has(tmp_path: Path) -> None:
    for objects, episodes, thick, thin in ((1, 1, False, False), (1, 4, True, False),
                                           (3, 4, True, True)):
        plan, store = wide_study(tmp_path / f"{objects}-{episodes}",
                                 wide_text(2, objects, episodes))
        said = KINDS["forest"](Asked(plan, [store])).get_supxlabel()
        assert ("thick" in said, "thin" in said) == (thick, thin)
        assert ("intervals" in said) == thick


def test_a_heat_map_of_settings(swept: tuple[Plan, Store]) -> None:
    drawn = KINDS["settings"](Asked(swept[0], [swept[1]]))
    looks_right(drawn)
    assert drawn.axes[-1].get_ylabel().endswith("mean;\nless is better")


def test_a_heat_map_of_a_score_that_no_episode_has_is_drawn(swept: tuple[Plan, Store]) -> None:
    drawn = KINDS["settings"](Asked(swept[0], [swept[1]], "fit_rms_mm"))
    assert "NA" in {text for text, _ in texts(drawn)}


def test_levels_stand_at_their_numbers_with_the_table_s_intervals(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 3, 4, """
[sweep.grid]
"sensors.tendon_threshold_N" = [12.0, 3.0, 100.0]
"strategy.closings" = [["curl40"], ["base_then_curl"]]
"""))
    drawn = KINDS["levels"](Asked(plan, [store]))
    looks_right(drawn)
    rows = table_rows(settings_table(plan, read_settings(plan, [store], "chamfer_mm"),
                                     "chamfer_mm"))
    numbers, words = drawn.axes
    assert (numbers.get_xscale(), words.get_xscale()) == ("log", "linear")
    assert [text.get_text() for text in words.get_xticklabels()] == ["(curl40)", "(base_then_curl)"]
    for axes, factor in ((numbers, "sensors.tendon_threshold_N"), (words, "strategy.closings")):
        for line in axes.get_lines():
            mine = [row for row in rows
                    if (row["strategy"], row["factor"]) == (line.get_label(), factor)]
            if axes is numbers:
                mine.sort(key=lambda row: float(row["level"]))
                np.testing.assert_allclose(np.asarray(line.get_xdata(), float), [3, 12, 100],
                                           rtol=0.03)
            np.testing.assert_allclose(np.asarray(line.get_ydata(), float),
                                       [float(row["chamfer_mm"]) for row in mine], atol=6e-4)
        ends = {round(float(y), 3) for lines in axes.collections
                if isinstance(lines, LineCollection) for way in lines.get_segments()
                for _, y in way}
        assert ends == {round(float(row[f"chamfer_mm_ci_{end}"]), 3) for row in rows
                        if row["factor"] == factor for end in ("low", "high")}


def test_a_low_heat_map_has_room_for_its_label(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 2, 4, """
[sweep.grid]
"sensors.tendon_threshold_N" = [3, 6, 12]
"""))
    looks_right(KINDS["settings"](Asked(plan, [store])))


def test_a_factor_shows_the_strategies_that_it_says_something_of(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(2, 2, 4, """
[[strategy]]
name = "crossed"
order = ["planar"]
[sweep.grid]
"planar.step_mm" = [6, 9]
"sensors.tendon_threshold_N" = [3, 6, 12]
"""))
    drawn = KINDS["settings"](Asked(plan, [store]))
    looks_right(drawn)
    shown = [[text.get_text() for text in axes.get_yticklabels()] for axes in drawn.axes[:2]]
    assert shown[0] == ["crossed"]
    assert len(shown[1]) == 3


@pytest.mark.parametrize("ending", ["svg", pytest.param("pdf", marks=pytest.mark.slow), "png"])
def test_the_same_study_gives_the_same_bytes(
        study: tuple[Plan, Store], tmp_path: Path, ending: str) -> None:
    folder = str(study[1].folder)
    for name in ("a", "b"):
        assert cli.run(["figure", folder, "forest", "-o", str(tmp_path / f"{name}.{ending}")]) == 0
    content = (tmp_path / f"a.{ending}").read_bytes()
    assert content == (tmp_path / f"b.{ending}").read_bytes()
    assert not re.search(rb"20\d\d-\d\d-\d\d", content)  # no date
    if ending == "png":
        with Image.open(tmp_path / "a.png") as image:
            assert image.width == pytest.approx(85 / 25.4 * 300, abs=1)


@pytest.mark.parametrize("kind", [
    pytest.param(kind, marks=() if kind == "forest" else pytest.mark.slow)
    for kind in STUDY_KINDS])
def test_a_png_is_what_matplotlib_would_write(study: tuple[Plan, Store], kind: str) -> None:
    asked, theirs = Asked(study[0], [study[1]]), BytesIO()
    ours = Image.open(BytesIO(encode(KINDS[kind](asked), "png")))
    with drawing():
        KINDS[kind](asked).savefig(theirs, format="png")
    assert ours.info["dpi"] == Image.open(theirs).info["dpi"]
    assert np.array_equal(np.asarray(ours), np.asarray(Image.open(theirs).convert("RGB")))


def test_better_is_first_and_lower_for_errors(study: tuple[Plan, Store]) -> None:
    drawn = KINDS["forest"](Asked(study[0], [study[1]]))
    labels = [text.get_text() for text in drawn.axes[0].get_yticklabels()]
    assert labels == sorted(labels, key=len)  # the stand-ins are worse the longer their names
    assert drawn.axes[0].yaxis_inverted()


def test_intervals_keep_to_the_scores_range() -> None:
    """Student's t over two objects knows no bounds; an IoU lies between 0 and 1, and of time
    nothing is known."""
    means = np.random.default_rng(1).normal(0.5, 0.6, (1 + REPLICATES, 2))
    means[0] = 0.4, 0.6
    entries = tuple(Entry(0, name, {}) for name in "ab")
    values = (np.array([[0.1, 0.9]] * 4), np.array([[0.7, 0.3]] * 4))
    paired = Paired(entries, ("block", "wedge"),
                    {"iou": values, COST: tuple(9 * v for v in values)},
                    {"iou": means, COST: 9 * means}, ())
    found = find_front(paired, "iou")
    assert (found.error.low >= 0.0).all()
    assert (found.error.low < 0.01).all()
    assert (found.error.high > 0.99).all()
    assert (found.error.high <= 1.0).all()
    assert np.isnan([found.cost.low, found.cost.high]).all()  # beyond a hundred times the mean
    drawn = draw_forest(paired, "iou")
    assert [tick.get_text() for tick in drawn.axes[0].get_yticklabels()] == ["b", "a"]
    bars = [c for c in drawn.axes[0].collections if isinstance(c, LineCollection)]
    ends = [x for bar in bars for line in bar.get_segments() for x, _ in line]
    assert 0.0 <= min(ends) < 0.1
    assert 0.9 < max(ends) <= 1.0


@pytest.mark.parametrize(("arguments", "says"), [
    (["DIR", "forest", "-o", "a.jpg"], "cannot be written as 'jpg'"),
    (["DIR", "forest", "-o", "a.csv"], "cannot be written as 'csv'"),
    (["DIR", "forrest", "-o", "a.svg"], "did you mean forest?"),
    (["DIR", "confusion", "-o", "a.svg", "--strategy", "no"], "no strategy 'no'"),
    (["DIR", "contacts", "-o", "a.svg", "--object", "blok"], "did you mean block?"),
    (["DIR", "contacts", "-o", "a.svg", "--episode", "8"], "whole number from 0 to 7"),
])
def test_bad_usage(study: tuple[Plan, Store], arguments: list[str], says: str,
                   capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["figure", *(a.replace("DIR", str(study[1].folder)) for a in arguments)]) == 2
    assert says in capsys.readouterr().err


def test_moments_of_a_tactile_image_are_those_of_its_ellipse() -> None:
    """Sums written out anew, in millimetres, over the taxels that the robot itself goes by."""
    pads = PadTable()
    row, column = np.mgrid[:16, :16]
    image = np.round(90 * np.exp(-(((row - 9) / 1.2) ** 2 + ((column - 6 - (row - 9) / 2)
                                                             / 1.1) ** 2) / 2)).astype(np.uint8)
    image[0, 0] = 5  # noise far off
    found = image_ellipse(image, pads)
    counts = {(r, c): float(image[r, c]) for r in range(6, 13) for c in range(3, 10)
              if image[r, c] >= pads.threshold_counts / 2}
    mass = sum(counts.values())
    x, y = ({(r, c): 1e3 * (c + 0.5) * pads.width_m / 16 for r, c in counts},
            {(r, c): 1e3 * (r + 0.5) * pads.length_m / 16 for r, c in counts})
    mean = [sum(counts[k] * axis[k] for k in counts) / mass for axis in (x, y)]
    assert found.centroid_mm == pytest.approx(mean)
    second = np.array([[sum(counts[k] * (a[k] - m) * (b[k] - n) for k in counts) / mass
                        for b, n in ((x, mean[0]), (y, mean[1]))]
                       for a, m in ((x, mean[0]), (y, mean[1]))])
    assert np.allclose(found.axes_mm.T @ found.axes_mm, second)
    assert np.linalg.norm(found.axes_mm[0]) > np.linalg.norm(found.axes_mm[1])
    assert found.axes_mm[0] @ found.axes_mm[1] == pytest.approx(0.0, abs=1e-9)
    alone = np.zeros((16, 16), np.uint8)
    alone[15, 0] = 1  # a corner, below the level
    assert image_ellipse(alone, pads).centroid_mm == pytest.approx([0.397, 24.606], abs=1e-3)


@pytest.mark.parametrize("count", [1, 4])
def test_tactile_images_are_legible_and_the_same_bytes(count: int) -> None:
    rng = np.random.default_rng(1)
    touches = tuple(PadTouch(100 + n, 3 - n, rng.poisson(0.5, (16, 16)).astype(np.uint8) + 60 * (
        np.add.outer(abs(np.arange(16) - 8 - n), abs(np.arange(16) - 5)) < 2).astype(np.uint8))
        for n in range(count))
    shown = TaxelsShown("orangina_bottle", touches, PadTable())
    looks_right(_drawn(shown))
    assert draw_taxels(shown) == draw_taxels(shown)


@pytest.mark.parametrize(("radius", "tall"), [(38.0, 323.0), (40.0, 60.0), (90.0, 20.0)])
def test_a_solid_fills_its_axes_and_is_not_cut(radius: float, tall: float) -> None:
    """The neck and the foot of a bottle were cut off straight."""
    angle = np.linspace(0.0, 2.0 * np.pi, 49)
    rims = np.stack([np.tile(radius * np.cos(angle), 2), np.tile(radius * np.sin(angle), 2),
                     np.repeat([0.0, tall], 49)], 1)
    half = 1.15 * radius
    drawn = figure(3.3)
    axes: Any = drawn.add_subplot(projection="3d")
    axes.set(xlim=(-half, half), ylim=(-half, half), zlim=(0.0, tall))
    axes.view_init(20, -55)
    fill_axes(axes, (2.0 * half, 2.0 * half, tall), rims)
    FigureCanvasAgg(drawn).draw()
    x, y, _ = proj_transform(rims[:, 0], rims[:, 1], rims[:, 2], axes.get_proj())
    reach = np.abs(axes.transLimits.transform(np.stack([x, y], 1)) - 0.5).max()
    assert 0.48 < reach <= 0.5


@pytest.mark.parametrize(("draw", "says"), [
    (lambda block: taxels_figure(block, PadTable(), "block"), "no pad touched anything"),
    (lambda block: faces_figure(block, "block"), "faces: none was crossed"),
    (lambda block: contour_figure(block, "block"), "contour: none was followed"),
])
def test_figures_of_what_did_not_happen_say_so(
        draw: Callable[[Any], Figure], says: str) -> None:
    nothing = SimpleNamespace(exploration=SimpleNamespace(
        procedures=(), belief=SimpleNamespace(faces=(), profile=None)))
    with pytest.raises(StoreError, match=says):
        draw(nothing)


@pytest.mark.slow
@pytest.mark.parametrize(("strategy", "body", "kinds"), [
    ("planar", "block", ("contacts", "faces", "taxels")),
    ("contour", "wine_bottle", ("contacts", "contour", "taxels"))])
def test_figures_of_an_episode_of_pads(tmp_path: Path, strategy: str, body: str,
                                       kinds: tuple[str, ...]) -> None:
    cell = Cell(STRATEGIES[strategy], {"name": body}, body, seed=4)
    block = run_block(cell, np.arange(1), "cpu")
    draw = {"contacts": contacts_figure, "faces": faces_figure, "contour": contour_figure,
            "taxels": lambda block, name: taxels_figure(block, cell.pads, name)}
    for kind in kinds:
        first, second = (draw[kind](block, body) for _ in range(2))
        assert encode(first, "svg") == encode(second, "svg"), kind
        looks_right(first)


@pytest.mark.slow
def test_contacts_of_an_episode_run_again(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(1, 1, 2))
    first, second = (figures.KINDS["contacts"](Asked(plan, [store])) for _ in range(2))
    assert encode(first, "svg") == encode(second, "svg")
    looks_right(first)


def test_contacts_of_an_episode_as_numbers(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The file that `explore` would write of it, and where the object truly stands."""
    plan, store = wide_study(tmp_path, wide_text(1, 1, 2))
    file = tmp_path / "contacts.csv"
    assert cli.run(["figure", str(store.folder), "contacts", "--episode", "1", "-o",
                    str(file)]) == 0
    block = run_block(plan.study.cell(0, 0, 0), np.array([1]), "cpu")
    assert file.read_text() == contacts_csv(block.exploration, block.truth)
    yaw = 2.0 * np.arctan2(*block.truth.body_pose[0, 5:])
    said = capsys.readouterr().err
    assert said.startswith(str(block.status[0]))
    assert f"truly stands at x_m 0.45, y_m 0, yaw_rad {yaw:.4g}\n" in said


def test_letters_without_a_picture_and_empty_axes_are_no_warning(
        recwarn: pytest.WarningsRecorder) -> None:
    with drawing():
        drawn = figure(2.0)
        axes = drawn.add_subplot()
        axes.set_title("\u732b")
        axes.set_xlim(3.0, 3.0)
    for file_format in ("svg", "png"):
        assert encode(drawn, file_format)
    assert not recwarn.list


def test_short_labels_still_tell_entries_apart() -> None:
    long = [f"coarse-to-fine [sensors.tendon_threshold_N={n}, fit.loss=none]" for n in (3, 6)]
    names, keys = distinct_labels(long, 26)
    assert names == ["coarse-to-fine [3, none]", "coarse-to-fine [6, none]"]
    assert keys == "[sensors.tendon_threshold_N, fit.loss]"
    names, _ = distinct_labels(long, 18)
    assert len(set(names)) == 2
    assert distinct_labels(["ring6", "a name with [brackets]"], 30) == (
        ["ring6", "a name with [brackets]"], "")
    plain = [f"a rather long strategy name that goes on, number {n}" for n in range(12)]
    same_ends = [f"a rather long strategy name, number {n}, of many" for n in range(12)]
    swept = [f"{name} [sensors.tendon_threshold_N={n}, b=True]" for name in plain for n in (3, 6)]
    for labels in (plain, same_ends, swept, [*plain, *plain]):
        for width in (18, 22, 26):
            names, _ = distinct_labels(labels, width)
            assert len(set(names)) == len(set(labels))
            assert max(map(len, names)) <= max(width, 6 + len(" [3, True]"))


def test_intervals_of_two_objects_leave_the_others_to_be_seen() -> None:
    """Student's t over two objects may reach a thousand times as far as the episodes do."""
    draw = np.random.default_rng(2)
    values = tuple(level + 0.05 * draw.normal(size=(8, 2)) for level in (1.0, 4.0))
    means = np.concatenate([np.mean([v.mean(0) for v in values], axis=0)[None]] * (1 + REPLICATES))
    paired = Paired(tuple(Entry(0, name, {}) for name in "ab"), ("block", "wedge"),
                    {"chamfer_mm": values}, {"chamfer_mm": means}, ())
    like = paired.statistics("chamfer_mm").values("like-these")
    drawn = draw_forest(paired, "chamfer_mm")
    low, high = drawn.axes[0].get_xlim()
    assert like.high.max() > 10.0 > high > 2.5 > low
    assert "cut at the frame" in drawn.get_supxlabel()


def test_intervals_of_two_episodes_of_many_entries_do_not_set_the_frame() -> None:
    """Simultaneous intervals of hundreds of entries with two episodes each reach for kilometres."""
    draw = np.random.default_rng(3)
    values = tuple(10.0 + draw.normal(size=(2, 200)) for _ in range(2))
    means = np.concatenate([np.mean([v.mean(0) for v in values], axis=0)[None]] * (1 + REPLICATES))
    paired = Paired(tuple(Entry(0, f"e{n}", {}) for n in range(200)), ("block", "wedge"),
                    {"chamfer_mm": values}, {"chamfer_mm": means}, ())
    best = int(means[0].argmin())
    assert paired.statistics("chamfer_mm").differences(best, "these").high.max() > 1e3
    drawn = draw_forest(paired, "chamfer_mm")
    low, high = drawn.axes[1].get_xlim()
    assert -100.0 < low < 0.0 < high < 100.0
    assert "cut at the frame" in drawn.get_supxlabel()
