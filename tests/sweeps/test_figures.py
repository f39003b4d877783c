"""Figures: the same bytes twice, and no text over another or off the page."""

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from curved_episodes import wide_study, wide_text
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image
from test_tables import SWEPT

from sweeps import cli, figures
from sweeps.figure_style import COLUMN_IN, encode
from sweeps.figures import KINDS, Asked
from sweeps.plan import Plan
from sweeps.store import Store

STUDY_KINDS = [kind for kind in KINDS if kind not in ("contacts", "settings")]


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Store]:
    return wide_study(tmp_path_factory.mktemp("wide"), wide_text(10, 10, 8))


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> tuple[Plan, Store]:
    return wide_study(tmp_path_factory.mktemp("swept"), SWEPT)


def texts(drawn: Figure) -> list[tuple[str, np.ndarray]]:
    """What is written, with the corners (x0, y0, x1, y1) of where, in pixels."""
    drawn_texts: list[Text] = []
    draw = Text.draw

    def noted(self: Text, *given: object, **named: object) -> None:
        drawn_texts.append(self)
        draw(self, *given, **named)

    canvas = FigureCanvasAgg(drawn)
    canvas.draw()  # lays it out
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Text, "draw", noted)
        canvas.draw()
    return [(text.get_text(), text.get_window_extent().extents) for text in drawn_texts
            if text.get_text().strip() and text.get_visible() and not text.get_rotation() % 90]


def looks_right(drawn: Figure) -> None:
    assert drawn.get_figwidth() == COLUMN_IN
    width, height = drawn.get_size_inches() * drawn.dpi
    written = texts(drawn)
    assert written
    for text, (x0, y0, x1, y1) in written:
        assert min(x0, y0, width - x1, height - y1) >= -1, text
    for (a, p), (b, q) in combinations(written, 2):
        apart = p[2] <= q[0] + 1 or q[2] <= p[0] + 1 or p[3] <= q[1] + 1 or q[3] <= p[1] + 1
        assert apart, f"{a!r} is over {b!r}"


@pytest.mark.parametrize("kind", STUDY_KINDS)
def test_text_is_on_the_page_and_apart(study: tuple[Plan, Store], kind: str) -> None:
    looks_right(KINDS[kind](Asked(study[0], [study[1]])))


def test_a_heat_map_of_settings(swept: tuple[Plan, Store]) -> None:
    looks_right(KINDS["settings"](Asked(swept[0], [swept[1]])))


@pytest.mark.parametrize("ending", ["svg", "pdf", "png"])
def test_the_same_study_gives_the_same_bytes(
        study: tuple[Plan, Store], tmp_path: Path, ending: str) -> None:
    folder = str(study[1].folder)
    for name in ("a", "b"):
        assert cli.run(["figure", folder, "forest", "-o", str(tmp_path / f"{name}.{ending}")]) == 0
    content = (tmp_path / f"a.{ending}").read_bytes()
    assert content == (tmp_path / f"b.{ending}").read_bytes()
    assert b"2026-" not in content
    if ending == "png":
        with Image.open(tmp_path / "a.png") as image:
            assert image.width == pytest.approx(85 / 25.4 * 300, abs=1)


def test_better_is_first_and_lower_for_errors(study: tuple[Plan, Store]) -> None:
    drawn = KINDS["forest"](Asked(study[0], [study[1]]))
    labels = [text.get_text() for text in drawn.axes[0].get_yticklabels()]
    assert labels == sorted(labels, key=len)  # the stand-ins are worse the longer their names
    assert drawn.axes[0].yaxis_inverted()


@pytest.mark.parametrize(("arguments", "says"), [
    (["DIR", "forest", "-o", "a.jpg"], "cannot be written as 'jpg'"),
    (["DIR", "forrest", "-o", "a.svg"], "did you mean forest?"),
    (["DIR", "confusion", "-o", "a.svg", "--strategy", "no"], "no strategy 'no'"),
    (["DIR", "contacts", "-o", "a.svg", "--object", "blok"], "did you mean block?"),
    (["DIR", "contacts", "-o", "a.svg", "--episode", "8"], "whole number from 0 to 7"),
])
def test_bad_usage(study: tuple[Plan, Store], arguments: list[str], says: str,
                   capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["figure", *(a.replace("DIR", str(study[1].folder)) for a in arguments)]) == 2
    assert says in capsys.readouterr().err


@pytest.mark.slow
def test_contacts_of_an_episode_run_again(tmp_path: Path) -> None:
    plan, store = wide_study(tmp_path, wide_text(1, 1, 2))
    first, second = (figures.KINDS["contacts"](Asked(plan, [store])) for _ in range(2))
    assert encode(first, "svg") == encode(second, "svg")
    looks_right(first)
