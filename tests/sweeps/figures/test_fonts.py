"""Names in other scripts than the font of figures has; names of formats in capitals."""

from collections.abc import Iterator

import pytest

from sweeps.figures import style
from sweeps.figures.style import drawing, encode, figure

NOWHERE = "\U000f0000"
"""A letter of private use, which fonts have not."""


@pytest.fixture(autouse=True)
def fresh() -> Iterator[None]:
    style._fonts.cache_clear()
    style._note_boxes.cache_clear()
    yield
    style._fonts.cache_clear()
    style._note_boxes.cache_clear()


@pytest.mark.parametrize(("name", "notes"), [("ring6", 0), (f"ring {NOWHERE}", 1)])
def test_letters_that_no_font_has_are_noted_once(
        name: str, notes: int, capsys: pytest.CaptureFixture[str]) -> None:
    for file_format in ("svg", "png", "PNG"):
        with drawing():
            drawn = figure(1.0)
            drawn.text(0.1, 0.5, name)
        assert encode(drawn, file_format)
    assert capsys.readouterr().err.count("figures show them as boxes") == notes


def test_fonts_of_other_scripts_are_taken_where_they_are_installed(
        monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(style, "FALLBACKS", ("No Such Font", "DejaVu Serif"))
    assert style._fonts() == ["DejaVu Sans", "DejaVu Serif"]
    with drawing():
        drawn = figure(1.0)
        assert drawn.text(0.1, 0.5, "ring6").get_fontfamily() == ["DejaVu Sans", "DejaVu Serif"]
