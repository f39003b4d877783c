"""Where the text of a figure is drawn: on the page, and none over another."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from sweeps.figures.style import COLUMN_IN


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
