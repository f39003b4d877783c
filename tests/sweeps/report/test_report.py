"""The report: its markup, its numbers, and its behaviour in a headless Chromium."""

import base64
import html
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from browser import asked_for, browser, needs_browser, pixels, said
from curved_episodes import wide_study, wide_text
from quick_views import drawn_views
from scipy.spatial.transform import Rotation

import sweeps.report.page
from sweeps.analysis.entries import LeaderboardError
from sweeps.analysis.leaderboard import MORE, make_leaderboard
from sweeps.analysis.objects import ALSO
from sweeps.analysis.paired import read_paired
from sweeps.analysis.pairs import pairs_table
from sweeps.cli import main as cli
from sweeps.report.html import source_hash
from sweeps.report.page import make_report
from sweeps.report.sections import _heat, objects_section
from sweeps.report.views import UNIT_M, episode_data, make_views, pick_episodes, pick_objects
from sweeps.run.plan import Plan
from sweeps.run.store import Store

EVIL = '<script>alert("x")</script>&amp;\'"'


@pytest.fixture
def quick_views(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweeps.report.page, "make_views", drawn_views)


@pytest.fixture(scope="module")
def whole_page(study: tuple[Plan, Store]) -> bytes:
    """The study's report with quick views."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sweeps.report.page, "make_views", drawn_views)
        return make_report(study[0], [study[1]])


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Store]:
    text = wide_text(3, 6, 8).replace('"sxx"', f'"{EVIL.replace(chr(34), chr(92) + chr(34))}"')
    return wide_study(tmp_path_factory.mktemp("wide"), text)


class Tags(HTMLParser):
    """Every tag with its attributes; scripts and styles with their text."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.inside: list[tuple[str, dict[str, str | None], str]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1][0] in ("script", "style"):
            self.inside.append((*self.tags[-1], data))


def test_nothing_is_loaded_and_only_its_own_scripts_run(
        study: tuple[Plan, Store], quick_views: None, whole_page: bytes) -> None:
    assert whole_page == make_report(study[0], [study[1]])
    page = Tags()
    page.feed(whole_page.decode())
    policy = next(a["content"] for t, a in page.tags if a.get("http-equiv"))
    assert policy
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    for tag, attributes, text in page.inside:
        if attributes.get("type") != "application/json" and text.strip():
            assert source_hash(text) in policy, tag
    for tag, attributes in page.tags:
        assert tag not in ("link", "iframe", "object", "embed", "base", "img")
        assert not {"style", "src"} & set(attributes), tag
        assert not [name for name in attributes if name.startswith("on")]
        assert (attributes.get("href") or "#").startswith("#")
    assert {"main", "header", "h1", "h2", "caption"} <= {tag for tag, _ in page.tags}
    assert page.tags[0] == ("html", {"lang": "en"})
    ids = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(ids) == len(set(ids))
    charts = [attributes for _, attributes in page.tags if attributes.get("class") == "chart"]
    assert len(charts) >= 4
    assert all(chart["role"] == "img" and chart["aria-label"] for chart in charts)
    assert [tag for tag, _ in page.tags].count("desc") == len(charts)


def test_names_are_escaped(whole_page: bytes) -> None:
    text = whole_page.decode()
    written = re.sub(r"<(text|title|desc)\b[^<>]*>[^<>]*</", "", text)  # quotes are allowed here
    assert 'alert("x")' not in written.replace('alert(\\"x\\")', "")
    assert "<script>alert" not in text
    assert "&lt;script&gt;alert(" in text


def test_numbers_are_the_leaderboards(study: tuple[Plan, Store]) -> None:
    text = make_report(study[0], [study[1]], views=False).decode()
    board = make_leaderboard(study[0], [study[1]])
    bounds = [name.endswith(("_low", "_high")) for name in board.header]
    for row in board.rows:
        for name, bound, cell in zip(board.header[2:], bounds[2:], row[2:], strict=True):
            low = name.endswith("_low") and cell != "NA"
            if name in ("n_objects", "n_episodes"):
                continue
            assert (f">{cell} to " in text if low else f" to {cell}</td>" in text
                    if bound and cell != "NA" else f">{cell}</td>" in text)
    assert "3-D views were left out" in text
    assert "episodes_per_cell = 8" in text
    assert study[0].hash in text
    assert "these objects with other episodes" in text
    assert "where one interval is shown, it is of objects like these" in text
    assert "--over" not in text


def test_best_median_and_worst(study: tuple[Plan, Store]) -> None:
    picked = pick_episodes(study[0], [study[1]])
    mine = [p for p in picked if p.episode.strategy == 0]
    values = np.concatenate([rows["chamfer_mm"] for unit in study[0].units()
                             if unit.cell.strategy.name == "s"
                             and (rows := study[1].read(unit)) is not None])
    values = np.sort(values[np.isfinite(values)])
    assert [p.place for p in mine] == ["best", "median", "worst"]
    assert [p.chamfer_mm for p in mine] == [values[0], values[(len(values) - 1) // 2], values[-1]]


def test_each_object_has_its_median_episode_by_the_strategy_best_there(
        study: tuple[Plan, Store]) -> None:
    picked = pick_objects(study[0], [study[1]])
    assert [p.episode.body for p in picked] == list(range(len(study[0].study.objects)))
    medians: dict[str, list[float]] = {}
    for unit in study[0].units():
        rows = study[1].read(unit)
        assert rows is not None
        values = np.sort(rows["chamfer_mm"][np.isfinite(rows["chamfer_mm"])])
        medians.setdefault(unit.cell.object_name, []).append(values[(len(values) - 1) // 2])
    for pick in picked:
        name = study[0].study.objects[pick.episode.body].name
        assert pick.chamfer_mm == min(medians[name])


def test_tints_go_from_the_best_to_the_worst_of_each_object(study: tuple[Plan, Store]) -> None:
    assert _heat(np.array([[1.0, 10.0, 3.0], [2.0, 30.0, 3.0], [np.nan, 20.0, 3.0]])) == [
        ["heat0", "heat0", "heat0"], ["heat4", "heat4", "heat0"], ["", "heat2", "heat0"]]
    paired = read_paired(study[0], [study[1]], ["chamfer_mm", *ALSO])
    page = objects_section(paired)
    for values in paired.values["chamfer_mm"]:
        for n in range(len(paired.labels)):
            assert f">{np.median(values[:, n]):.2f}<" in page


def test_what_a_page_shows_stands_in_the_frame_of_the_true_body() -> None:
    rng = np.random.default_rng(7)
    grid, felt = rng.uniform(-0.1, 0.1, (4, 5, 3)), rng.uniform(-0.1, 0.1, (6, 3))
    turn = Rotation.from_rotvec([0.0, 0.0, 0.8])
    data = episode_data(turn.apply(grid.reshape(-1, 3)).reshape(grid.shape) + [0.45, 0.1, 0.0],
                        np.array([0.45, 0.1, 0.0, *turn.as_quat()]),
                        turn.apply(felt) + [0.45, 0.1, 0.0])
    for name, places in (("grid", grid), ("contacts", felt)):
        packed = np.frombuffer(base64.b64decode(data[name]), "<i2").reshape(-1, 3)
        np.testing.assert_allclose(packed * UNIT_M, places.reshape(-1, 3), atol=0.51 * UNIT_M)
    assert (data["rows"], data["columns"]) == (4, 5)


def test_a_study_without_units(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, store = wide_study(tmp_path, wide_text(1, 1, 2))
    for file in store.units.iterdir():
        file.unlink()
    out = str(tmp_path / "r.html")
    assert cli.run(["report", str(tmp_path), "-o", out]) == 2
    assert "no block of episodes is finished" in capsys.readouterr().err


def test_a_report_that_cannot_be_written_is_refused_first(
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Before the study is read, let alone played."""
    out = tmp_path / "none" / "r.html"
    assert cli.run(["report", str(tmp_path), "-o", str(out)]) == 2
    assert f"{out}: cannot be written: there is no folder {out.parent}" in capsys.readouterr().err
    assert cli.run(["report", str(tmp_path), "-o", str(tmp_path)]) == 2
    assert "cannot be written: it is a folder" in capsys.readouterr().err
    long = tmp_path / f"{'r' * 240}.html"  # what the disk refuses, as a read-only one does
    assert cli.run(["report", str(tmp_path), "-o", str(long)]) == 2
    assert f"{long}: cannot be written: File name too long" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_study_of_failures_alone(tmp_path: Path) -> None:
    """The report is written, without the comparison with the best."""
    plan, store = wide_study(tmp_path, wide_text(2, 2, 2))
    for unit in plan.units():
        store.path(unit).unlink()
        store.log(unit).write_text("it broke")
    page = make_report(plan, [store], views=False).decode()
    assert "more than 20% of the episodes failed" in page
    assert "Is the difference real?" not in page
    assert "No strategy has a score." in page
    assert "First is" not in page
    with pytest.raises(LeaderboardError, match="no entry has a value"):
        pairs_table(read_paired(plan, [store], ["chamfer_mm"]), "chamfer_mm", "best")


def test_a_report_says_what_the_leaderboard_does(tmp_path: Path) -> None:
    """Such as that units failed, whose episodes alone may decide the ranking."""
    plan, store = wide_study(tmp_path, wide_text(2, 3, 70))
    broken = next(unit for unit in plan.units() if unit.stop - unit.start == 6)
    store.path(broken).unlink()
    store.log(broken).write_text("it broke")
    text = html.unescape(make_report(plan, [store], views=False).decode())
    notes = [line for line in make_leaderboard(plan, [store]).notes if "ranking" not in line]
    assert any("1 of 6 units failed" in line for line in notes)
    assert [line for line in notes if line not in text] == []


def test_a_count_of_notes_goes_with_them(tmp_path: Path) -> None:
    """The page names every object without a score; "and 3 more like that" was left behind."""
    plan, store = wide_study(tmp_path, wide_text(2, 9, 2))
    for unit in plan.units():
        store.path(unit).unlink()
        store.log(unit).write_text("it broke")
    assert sum(note.endswith(MORE) for note in make_leaderboard(plan, [store]).notes) == 1
    text = html.unescape(make_report(plan, [store], views=False).decode())
    assert text.count("<li>no entry has any chamfer_mm on") == 9
    assert MORE not in text


@pytest.mark.parametrize(("objects", "over", "words"), [
    (1, "these", "of these objects"), (3, "ci", "of objects like these")])
def test_the_interval_of_the_first_is_the_one_that_is_shown(
        tmp_path: Path, objects: int, over: str, words: str) -> None:
    plan, store = wide_study(tmp_path, wide_text(1, objects, 8))
    board = make_leaderboard(plan, [store])
    best = dict(zip(board.header, board.rows[0], strict=True))
    low, high = best[f"chamfer_mm_{over}_low"], best[f"chamfer_mm_{over}_high"]
    page = make_report(plan, [store], views=False).decode()
    assert low != "NA"
    assert f"(95 % interval {words} {low} to {high})" in page
    assert f">1 strategy, {objects} object{'s' * (objects > 1)}, 8 episodes of each" in page


def test_all_but_the_first_notes_are_folded(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plan, store = wide_study(tmp_path, wide_text(1, 1, 8))
    notes = [f"note {n}" for n in range(20)]
    monkeypatch.setattr(sweeps.report.page, "_unsaid", lambda *_: notes)
    page = make_report(plan, [store], views=False).decode()
    shown, folded = page.split('<ul class="warnings">')[1].split("<details>")[:2]
    assert shown.count("<li>") == 7  # the last one holds the others
    assert [note for note in notes if f"<li>{note}</li>" not in shown + folded] == []
    assert re.search(r"<summary>\d+ more notes</summary>", folded)


def test_what_has_no_interval_is_drawn_without(tmp_path: Path) -> None:
    """With one episode, no attribute holds nan or inf."""
    plan, store = wide_study(tmp_path, wide_text(2, 1, 1))
    page = make_report(plan, [store], views=False).decode()
    assert not re.search(r'"[^"<>]*\b(nan|inf)\b[^"<>]*"', page.split("<main>")[1].split(
        "</main>")[0])


@needs_browser
def test_in_a_browser(tmp_path: Path, whole_page: bytes, study: tuple[Plan, Store]) -> None:
    """Loads, sorts by click and by key, draws and turns a body; asks for nothing, says nothing."""
    file = tmp_path / "report.html"
    file.write_bytes(whole_page)
    with browser() as driver:
        driver.get(file.as_uri())
        column = ("return [...document.querySelectorAll('#board tbody tr')]"
                  ".map(row => row.cells[0].textContent)")
        assert driver.execute_script(column) == ["1", "2", "3"]
        heading = driver.find_element("css selector", "#board thead th button")
        for expected in (["1", "2", "3"], ["3", "2", "1"]):
            heading.send_keys("\n")
            assert driver.execute_script(column) == expected
        assert driver.execute_script(
            "return document.querySelector('#board th').getAttribute('aria-sort')") == "descending"

        stage = driver.find_element("id", "stage")
        driver.execute_script("arguments[0].scrollIntoView()", stage)
        before = pixels(driver, "stage")
        drawn = before[:, 3] > 0
        assert 0.02 < drawn.mean() < 0.9
        blue = before[drawn][:, 2] - before[drawn][:, 0]
        assert (blue > 20).mean() > 0.1  # the recovered body
        assert (blue < -80).sum() > 100  # contacts
        stage.send_keys("\ue014" * 5)  # arrow right
        assert (pixels(driver, "stage") != before).any()
        buttons = driver.find_elements("css selector", "button[data-episode]")
        assert len(buttons) == 9 + len(study[0].study.objects)  # the gallery is of objects
        buttons[4].click()
        assert buttons[4].get_attribute("aria-pressed") == "true"
        assert "median" in driver.find_element("id", "about").text
        for name in ("recovered", "true", "contacts"):
            driver.find_element("id", f"show-{name}").click()
        assert not pixels(driver, "stage").any()
        assert driver.execute_script("return document.body.scrollWidth <= innerWidth")
        folded = ("return [...document.querySelectorAll('details:not([open])')]"
                  ".map(part => part.querySelector('pre') !== null)")
        shut = driver.execute_script(folded)
        driver.execute_script("dispatchEvent(new Event('beforeprint'))")
        assert driver.execute_script(folded) == [True] * sum(shut)  # on paper all but listings
        driver.execute_script("dispatchEvent(new Event('afterprint'))")
        assert driver.execute_script(folded) == shut
        driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
        driver.set_window_size(1040, 720)  # A4 across, less its margins, at 96 to the inch
        assert driver.execute_script(
            "return [...document.querySelectorAll('table')].every("
            "table => table.getBoundingClientRect().right <= innerWidth)")
        assert said(driver) == []
        assert asked_for(driver) == [file.as_uri()]


@needs_browser
@pytest.mark.slow
def test_a_large_report_is_small_and_quick(tmp_path: Path, quick_views: None) -> None:
    """20 strategies x 10 objects: at most 6 MB, interactive in less than 3 s."""
    plan, store = wide_study(tmp_path / "wide", wide_text(20, 10, 16))
    content = make_report(plan, [store])
    assert len(content) <= 6e6
    file = tmp_path / "report.html"
    file.write_bytes(content)
    with browser() as driver:
        driver.get(file.as_uri())
        ready = driver.execute_script(
            "const t = performance.getEntriesByType('navigation')[0];"
            "return t.domContentLoadedEventEnd - t.startTime")
        print(f"{len(content) / 1e6:.2f} MB, interactive after {ready:.0f} ms")
        assert ready < 3000
        assert said(driver) == []


@pytest.mark.slow
def test_a_report_says_nothing_of_what_the_machine_lacks(tmp_path: Path) -> None:
    """The blocks of the episodes bring Warp to the process that writes the page, too."""
    wide_study(tmp_path, wide_text(1, 1, 1))
    done = subprocess.run(
        [sys.executable, "-m", "sweeps.cli.main", "report", str(tmp_path), "-o",
         f"{tmp_path}/r.html"],
        capture_output=True, text=True, check=True)
    # The strategy's best, median and worst, and the object's own.
    assert done.stderr.splitlines() == [f"episode {n} of 4 for the 3-D views"
                                        for n in (1, 2, 3, 4)]


@pytest.mark.slow
def test_views_are_of_the_episodes_that_the_sweep_ran(tmp_path: Path) -> None:
    from sweeps.run.local_engine import Options, run
    from sweeps.run.progress import Progress

    plan, store = wide_study(tmp_path, wide_text(1, 1, 3))
    for file in store.units.iterdir():
        file.unlink()
    with Progress(plan.unit_count, tmp_path / "note") as progress:
        run(plan, store, Options(), progress)
    picked = pick_episodes(plan, [store])
    views = make_views(plan, picked)
    assert views.notes == []
    assert [e["chamfer_mm"] for e in views.episodes] == [round(p.chamfer_mm, 3) for p in picked]
    assert not re.search(r"NaN|Infinity", str(views.episodes))
