"""Every measured figure of README and docs is one that a command wrote."""

import importlib.util
import json
import re
from pathlib import Path

import pytest
from places import ROOT

DOCS = ROOT / "docs"
spec = importlib.util.spec_from_file_location("measured", DOCS / "measured.py")
assert spec is not None
assert spec.loader is not None
measured = importlib.util.module_from_spec(spec)
spec.loader.exec_module(measured)

BY_HAND = re.compile(
    r"(?<![\w.])\d[\d,.]*(?: to \d[\d,.]*)? ?(?:/s\b|(?:closings|touches|fits|episodes|sets|scores)"
    r" (?:a|per) second|(?:closings|touches|fits|episodes)/s|times (?:as|faster|MuJoCo|scipy)"
    r"|(?:seconds?|s|ms|minutes) (?:on two|on one|warm|cold))|"
    r"\b(?:IoU|iou|chamfer)(?: of)? \d\.\d|"
    r"(?:median|p10|p90|p95)[ :=]+\d")
"""What only a measurement can say: rates, speed-ups, start-up times, scores."""
NOTES = DOCS / "design_notes"


def test_the_collected_figures_are_those_of_the_files() -> None:
    assert json.loads(measured.FIGURES.read_text()) == measured.collect()


@pytest.mark.parametrize("page", measured.pages(), ids=lambda page: page.stem)
def test_a_page_says_what_was_measured(page: Path) -> None:
    text = page.read_text()
    assert measured.filled(text, json.loads(measured.FIGURES.read_text())) == text, (
        f"{page}: a figure disagrees; run `make figures`")


@pytest.mark.parametrize("page", [page for page in measured.pages() if NOTES not in page.parents],
                         ids=lambda page: page.stem)
def test_no_figure_is_written_by_hand(page: Path) -> None:
    text = measured.TABLE.sub("", measured.FIGURE.sub("", page.read_text()))
    found = [line.strip() for line in text.splitlines()
             if BY_HAND.search(line) and not line.lstrip().startswith("#")]
    assert found == [], f"{page}: mark these, as docs/measured.py says, or move them to a note"


def test_a_wrong_figure_is_found() -> None:
    figures = {"bench.a.1.per_s": 1234.0, "bench.b.1.per_s": 99.0}
    assert measured.filled("<!--=bench.a.1.per_s ,.0f-->7<!--=-->", figures) == (
        "<!--=bench.a.1.per_s ,.0f-->1,234<!--=-->")
    assert "99 to 1,234" in measured.filled("<!--=bench.*.1.per_s ,.0f--><!--=-->", figures)
    with pytest.raises(KeyError):
        measured.filled("<!--=bench.c ,.0f--><!--=-->", figures)
