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
    found: list[tuple[str, np.ndarray]] = []
    draw = Text.draw

    def noted(self: Text, *given: object, **named: object) -> None:
        draw(self, *given, **named)
        if self.get_text().strip() and self.get_visible() and not self.get_rotation() % 90:
            # While it is drawn: only then a text of three axes stands where it is projected.
            found.append((self.get_text(), self.get_window_extent().extents))

    canvas = FigureCanvasAgg(drawn)
    canvas.draw()  # lays it out
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Text, "draw", noted)
        canvas.draw()
    return found


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
