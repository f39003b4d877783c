"""What the page draws of a state, in a headless Chromium: intervals with their ends, step curves.
"""

import json
import re
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from browser import browser, needs_browser, said
from studies import fill, plan_of

from sweeps.watch.server import Watcher
from sweeps.watch.state import Row, State
from sweeps.watch.terminal import _ends

SPEC = """\
schema = 1
seed = 7
episodes_per_cell = 4
objects = ["block"]
[[strategy]]
name = "ant"
waypoints = { kind = "ring", count = 6 }
"""
LOOK = """
const ends = (row, name) => [...row.querySelectorAll("td.plot svg " + name)];
return {
  rows: [...document.querySelectorAll("#rows tr")].map(row => ({
    ticks: ends(row, "line[class^=c-][stroke-width='2']").map(tick => +tick.getAttribute("x1")),
    bars: ends(row, "line[stroke-width='3']").length, arrows: ends(row, "polygon").length})),
  axis: [...document.querySelectorAll("#head text")].map(text => +text.textContent),
  lines: [...document.querySelectorAll("#error path")].map(line => line.getAttribute("d")),
  strokes: [...document.querySelectorAll("#error path")].map(line => getComputedStyle(line).stroke),
  names: [...document.querySelectorAll("#legend li")].map(item => item.textContent),
};"""


def drawn(folder: Path, monkeypatch: pytest.MonkeyPatch, rows: list[Row],
          curves: tuple[Any, ...] = ()) -> dict[str, Any]:
    """What stands on the page of a sweep with these rows."""
    state = State("sweep", "s", False, "h", (), 1.0, "chamfer_mm", "a", tuple(rows), 0, (), curves)
    return looked_at(folder, monkeypatch, state, LOOK)


def looked_at(folder: Path, monkeypatch: pytest.MonkeyPatch, state: State, look: str,
              width: int = 1280, scheme: str = "light") -> dict[str, Any]:
    """What a script finds on the page of a state."""
    fill(folder / "out", plan_of(folder / "spec", SPEC))
    with Watcher(folder / "out", 0, "chamfer_mm") as server:
        monkeypatch.setattr(server.view, "json", lambda: json.dumps(
            {"version": 1, **state.plain()}))
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            with browser(loopback=True) as driver:
                driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
                    "width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False})
                driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {
                    "features": [{"name": "prefers-color-scheme", "value": scheme}]})
                driver.get(server.address)
                for _ in range(100):
                    if driver.find_elements("css selector", "#name .pill"):
                        break
                    time.sleep(0.1)
                found = driver.execute_script(look)
                assert said(driver) == []
        finally:
            server.shutdown()
    return found


def row(label: str, mean: float, low: float | None, high: float | None, verdict: str = "") -> Row:
    return Row(label, mean, low, high, 0.0, verdict, 6, 1, 20.0 + mean)


@needs_browser
@pytest.mark.parametrize("others", [(), (row("bee", 5.7, 5.6, 5.8),)])
def test_the_interval_of_the_first_is_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
                                            others: tuple[Row, ...]) -> None:
    found = drawn(tmp_path, monkeypatch, [row("ant", 5.6, 0.7, 10.5, "best"), *others])
    first = found["rows"][0]
    assert (first["bars"], first["arrows"], len(first["ticks"])) == (1, 0, 2)
    assert first["ticks"][0] > 4.0  # of 272, in which the scale goes from 4 to 268
    assert first["ticks"][1] < 268.0
    assert found["axis"] == [5, 10] or found["axis"] == [2, 4, 6, 8, 10]


@needs_browser
def test_what_is_cut_has_an_arrow_and_what_is_unknown_no_bar(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = drawn(tmp_path, monkeypatch, [
        row("ant", 5.6, 5.5, 5.7, "best"), row("bee", 5.8, 1e-3, 900.0),
        row("cow", 5.9, None, None)])
    assert [(one["bars"], one["arrows"], len(one["ticks"])) for one in found["rows"]] == [
        (1, 0, 2), (1, 2, 0), (0, 0, 0)]


@needs_browser
def test_curves_are_steps_of_different_colours_with_a_legend(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    curves = tuple((name, [(8.0, 9.0), (400.0, 6.4), (411.0, 5.6)]) for name in "abcdef")
    rows = [row(name, 5.6, 5.0, 6.0, "" if n else "best") for n, name in enumerate("abcdefg")]
    found = drawn(tmp_path, monkeypatch, rows, curves)
    assert all(re.fullmatch(r"M[\d.]+ [\d.]+(H[\d.]+V[\d.]+){2}", line) for line in found["lines"])
    assert len(set(found["strokes"])) == len(found["lines"]) == 6
    assert found["names"] == [*"abcdef", "others"]


SHAPE = """
const middle = part => { const box = part.getBoundingClientRect(); return box.x + box.width / 2; };
const canvas = document.createElement("canvas").getContext("2d", {willReadFrequently: true});
const light = colour => {
  canvas.fillStyle = colour;
  canvas.fillRect(0, 0, 1, 1);
  const [r, g, b] = [...canvas.getImageData(0, 0, 1, 1).data].slice(0, 3).map(v => v / 255)
    .map(v => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const ground = part => {
  for (let at = part; at; at = at.parentElement) {
    const colour = getComputedStyle(at).backgroundColor;
    if (colour !== "rgba(0, 0, 0, 0)") return colour;
  }
};
return {
  wide: document.documentElement.scrollWidth - innerWidth,
  axis: [...document.querySelectorAll("#head text")].map(middle),
  lines: [...document.querySelectorAll("#rows tr")].map(
    row => [...row.querySelectorAll(".zero")].map(middle)),
  contrast: [...document.querySelectorAll(".tag, .pill")].map(part => {
    const both = [light(getComputedStyle(part).color), light(ground(part))].sort((a, b) => b - a);
    return [part.textContent, (both[0] + 0.05) / (both[1] + 0.05)];
  }),
  failures: document.getElementById("failures").innerText.split("\\n").map(s => s.trim()),
};"""


def race(rows: tuple[Row, ...], failures: tuple[tuple[str, int], ...] = (),
         running: bool = True) -> State:
    rungs = ((8, 6), (11, 2)) if rows else ()
    return State("race", "r", running, "h", (), -1.0, "chamfer_mm", "a", rows, 0, rungs, (),
                 failures)


ROWS = (row("ant", 5.6, 5.0, 9.0, "best"), row("bee", 8.0, 5.2, 8.0, "tied"),
        row("cow", 9.0, 8.2, 9.0, "worse"), row("dog", 9.0, 4.2, 9.0, "open"))


@needs_browser
@pytest.mark.parametrize("width", [360, 1600])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_is_readable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, width: int,
                              scheme: str) -> None:
    """Nothing is wider than the screen, lines of all rows stand below the axis' numbers, and words
    on a colour have the contrast of 4.5 that WCAG asks for."""
    found = looked_at(tmp_path, monkeypatch, race(ROWS, (("fit_failed", 2),)), SHAPE, width, scheme)
    assert found["wide"] <= 0
    assert len(found["axis"]) >= 2
    for lines in found["lines"]:
        assert lines == pytest.approx(found["axis"], abs=0.5)
    assert {text for text, _ in found["contrast"]} == {
        "best", "not better", "worse", "open", "race, running"}
    assert [pair for pair in found["contrast"] if pair[1] < 4.5] == []


@needs_browser
@pytest.mark.parametrize(("rows", "failures", "says"), [
    ((), (), "Not known yet."), (ROWS, (), "No episode failed so far."),
    (ROWS, (("fit_failed", 1),), "1 episode"), (ROWS, (("fit_failed", 1200),), "1,200 episodes")])
def test_failures_are_said_when_they_are_known(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rows: tuple[Row, ...],
        failures: tuple[tuple[str, int], ...], says: str) -> None:
    fault = "strategy ant failed: <b>no</b>"
    state = replace(race(rows, failures), faults=(fault,) if failures else ())
    found = looked_at(tmp_path, monkeypatch, state, SHAPE)["failures"]
    if failures:
        assert found.pop() == fault
    assert found[-1].removeprefix("fit_failed").strip() == says
    words = {"Not known yet.": "not known yet", "No episode failed so far.": "none"}
    assert f"failed episodes: {words.get(says, says.split()[0] + ' fit_failed')}" in _ends(state)
