"""How the report reads and lies on a screen: headline, columns in sight, nothing too wide."""

from pathlib import Path
from typing import Any

import pytest
from browser import browser, needs_browser, said
from curved_episodes import wide_study, wide_text
from quick_views import drawn_views

import sweeps.report.page
from sweeps.report.page import make_report

NAME = "a-ring-of-poses-with-a-name-that-says-all-of-its-settings-number-"
OUTSIDE = """
return [...document.querySelectorAll(arguments[0])].filter(
  part => part.scrollWidth > part.clientWidth + 1).map(part => part.outerHTML.slice(0, 80));"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A report with long names, and views of the right size."""
    folder = tmp_path_factory.mktemp("long")
    text = wide_text(3, 2, 4)
    for n, short in enumerate(('"sxx"', '"sx"', '"s"')):
        text = text.replace(short, f'"{NAME}{n}"')
    plan, store = wide_study(folder / "study", text)
    file = folder / "report.html"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sweeps.report.page, "make_views", drawn_views)
        file.write_bytes(make_report(plan, [store]))
    return file


def test_the_headline_shows_an_interval_that_is_known() -> None:
    of = sweeps.report.page._interval
    row = {"chamfer_mm_ci_low": "NA", "chamfer_mm_ci_high": "NA", "chamfer_mm_these_low": "1.000",
           "chamfer_mm_these_high": "2.000"}
    assert of(row, "like-these") == "95 % interval of these objects 1.000 to 2.000"
    assert of(row, "these") == "95 % interval of these objects 1.000 to 2.000"
    row |= {"chamfer_mm_ci_low": "0.500", "chamfer_mm_ci_high": "3.000"}
    assert of(row, "like-these") == "95 % interval of objects like these 0.500 to 3.000"
    assert of(dict.fromkeys(row, "NA"), "like-these") == "no interval is known"


def test_words_say_what_is_seen(tmp_path: Path) -> None:
    """A strong tint is light on a dark page; a single other is no plural; columns by their names.
    """
    plan, store = wide_study(tmp_path, wide_text(2, 2, 4))
    text = make_report(plan, [store], views=False).decode()
    assert "darker" not in text
    assert "Of the 1 other, " in text
    assert "_ci_ " not in text
    assert "&quot;ci&quot; are of objects like these" in text


@needs_browser
@pytest.mark.parametrize("width", [360, 1600])
def test_nothing_is_too_wide_for_the_screen(page: Path, tmp_path: Path, width: int) -> None:
    with browser() as driver:
        _set_width(driver, width)
        driver.get(page.as_uri())
        assert driver.execute_script(
            "return document.documentElement.scrollWidth <= innerWidth")
        assert driver.execute_script(OUTSIDE, ".episodes") == []  # best, median and worst in sight
        if width == 1600:
            assert driver.execute_script(OUTSIDE, "#board .scroll, #pairs .scroll") == []
        assert said(driver) == []


@needs_browser
def test_a_prior_in_the_place_of_a_body_is_named(page: Path, tmp_path: Path) -> None:
    words = "Nothing was recovered"
    file = tmp_path / "report.html"
    file.write_text(page.read_text().replace('"place":"worst"', '"place":"worst","prior":true'))
    with browser() as driver:
        driver.get(file.as_uri())
        about = driver.find_element("id", "about")
        assert words not in about.text
        driver.find_elements("css selector", "button[data-episode]")[2].click()
        assert words in about.text
        assert words in driver.find_element("id", "stage").get_attribute("aria-label")


def _set_width(driver: Any, width: int) -> None:
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
        "width": width, "height": 800, "deviceScaleFactor": 1, "mobile": False})
