"""What the page draws of a state, in a headless Chromium: intervals with their ends, step curves.
"""

import json
import re
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from browser import browser, needs_browser, said
from studies import fill, plan_of

from sweeps.watch.server import Watcher
from sweeps.watch.state import Row, State

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
    fill(folder / "out", plan_of(folder / "spec", SPEC))
    with Watcher(folder / "out", 0, "chamfer_mm") as server:
        monkeypatch.setattr(server.view, "json", lambda: json.dumps(
            {"version": 1, **state.plain()}))
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            with browser(folder / "profile", loopback=True) as driver:
                driver.get(server.address)
                for _ in range(100):
                    if driver.find_elements("css selector", "#rows tr"):
                        break
                    time.sleep(0.1)
                found = driver.execute_script(LOOK)
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
