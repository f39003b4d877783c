"""Charts of the report, as SVG that takes its colours from the page: dark, light or printed."""

from collections.abc import Sequence
from html import escape

import numpy as np

from sweeps.analysis.bootstrap import Estimate
from sweeps.figures.style import MARKERS

WIDTH, HEIGHT = 640, 320
LEFT, RIGHT, TOP, BOTTOM = 56, 12, 10, 44
COLOURED = 8
_SHAPES = {"o": "M-4 0a4 4 0 1 0 8 0a4 4 0 1 0-8 0", "s": "M-4-4h8v8h-8z", "^": "M0-5l5 9h-10z",
           "D": "M0-5l5 5l-5 5l-5-5z", "v": "M0 5l5-9h-10z",
           "P": "M-2-5h4v3h3v4h-3v3h-4v-3h-3v-4h3z",
           "X": "M-5-3l2-2l3 3l3-3l2 2l-3 3l3 3l-2 2l-3-3l-3 3l-2-2l3-3z", "<": "M-5 0l9-5v10z"}


class Chart:
    """Axes from data to pixels, and the marks on them."""

    def __init__(self, title: str, x_label: str, y_label: str, x: tuple[float, float],
                 y: tuple[float, float]) -> None:
        self.x, self.y = x, y
        self.parts = [
            f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{escape(title)}" '
            f'class="chart"><title>{escape(title)}</title>']
        for at in nice_ticks(*x):
            px = self._px(at)
            self.parts.append(f'<path class="grid" d="M{px:.1f} {TOP}V{HEIGHT - BOTTOM}"/>'
                              f'<text x="{px:.1f}" y="{HEIGHT - BOTTOM + 16}" '
                              f'text-anchor="middle">{at:.6g}</text>')
        for at in nice_ticks(*y):
            py = self._py(at)
            self.parts.append(f'<path class="grid" d="M{LEFT} {py:.1f}H{WIDTH - RIGHT}"/>'
                              f'<text x="{LEFT - 6}" y="{py + 4:.1f}" text-anchor="end">'
                              f'{at:.6g}</text>')
        middle = (TOP + HEIGHT - BOTTOM) / 2
        self.parts.append(
            f'<text x="{(LEFT + WIDTH - RIGHT) / 2}" y="{HEIGHT - 8}" text-anchor="middle">'
            f'{escape(x_label)}</text><text x="14" y="{middle}" text-anchor="middle" '
            f'transform="rotate(-90 14 {middle})">{escape(y_label)}</text>')

    def _px(self, x: float) -> float:
        low, high = self.x
        return LEFT + (WIDTH - RIGHT - LEFT) * (x - low) / (high - low)

    def _py(self, y: float) -> float:
        low, high = self.y
        return HEIGHT - BOTTOM - (HEIGHT - BOTTOM - TOP) * (y - low) / (high - low)

    def steps(self, x: np.ndarray, found: Estimate, tone: int, label: str, stop: float,
              band: bool) -> None:
        """A step function up to `stop`, with its band; values that are not known are left out."""
        known = np.isfinite(found.value)
        if not known.any():
            return
        x, value, low, high = x[known], found.value[known], found.low[known], found.high[known]
        end = np.append(x[1:], stop)
        if band and tone < COLOURED and np.isfinite([low, high]).all():
            edge = [(a, v) for a, b, h in zip(x, end, high, strict=True) for a, v in
                    ((a, h), (b, h))]
            back = [(a, v) for a, b, w in zip(x, end, low, strict=True) for a, v in
                    ((a, w), (b, w))]
            points = " ".join(f"{self._px(a):.1f},{self._py(v):.1f}" for a, v in edge + back[::-1])
            self.parts.append(f'<polygon class="band t{tone}" points="{points}"/>')
        path = f"M{self._px(x[0]):.1f} {self._py(value[0]):.1f}" + "".join(
            f"V{self._py(v):.1f}H{self._px(b):.1f}" for v, b in zip(value, end, strict=True))
        self.parts.append(f'<path class="line {_tone(tone)}" d="{path}">'
                          f"<title>{escape(label)}</title></path>")

    def bar(self, x: float, found: tuple[float, float, float], tone: int, label: str) -> None:
        """A marker with a standing interval; `found` is (value, low, high)."""
        if np.isfinite(found).all():
            self.point((x, x, x), found, tone, label)

    def point(self, x: tuple[float, float, float], y: tuple[float, float, float], tone: int,
              label: str) -> None:
        """A marker with intervals both ways, where known; `x`, `y` are (value, low, high)."""
        px, x0, x1 = (self._px(v if np.isfinite(v) else x[0]) for v in x)
        py, y0, y1 = (self._py(v if np.isfinite(v) else y[0]) for v in y)
        bars = (f'<path class="line whisker {_tone(tone)}" '
                f'd="M{x0:.1f} {py:.1f}H{x1:.1f}M{px:.1f} {y0:.1f}')
        shape = _SHAPES[MARKERS[tone % len(MARKERS)]] if tone < COLOURED else _SHAPES["o"]
        self.parts.append(f'{bars}V{y1:.1f}"/><path class="mark {_tone(tone)}" '
                          f'transform="translate({px:.1f} {py:.1f})" d="{shape}">'
                          f"<title>{escape(label)}</title></path>")

    def svg(self) -> str:
        """The chart as markup."""
        return "".join(self.parts) + "</svg>"


def _tone(tone: int) -> str:
    return f"t{tone}" if tone < COLOURED else "other"


def legend(labels: Sequence[str], more: int, marks: bool = False) -> str:
    """What each tone stands for; `more` others are grey."""
    keys = []
    every = [*labels, *([f"{more} others"] if more else [])]
    for tone, label in enumerate(every):
        grey = more and tone == len(labels)
        name = "other" if grey else f"t{tone}"
        shape = _SHAPES["o" if grey else MARKERS[tone % len(MARKERS)]]
        mark = (f'<path class="mark {name}" transform="translate(14 6)" d="{shape}"/>' if marks
                else f'<path class="line {name}" d="M0 6H28"/>')
        keys.append(f'<li><svg viewBox="0 0 28 12" class="key" aria-hidden="true">{mark}</svg>'
                    f"{escape(label)}</li>")
    return f'<ul class="legend">{"".join(keys)}</ul>'


def interval_bar(found: tuple[float, float, float], scale: tuple[float, float]) -> str:
    """A small picture of a value and its interval, for a cell of a table."""
    if not np.isfinite(found).all() or scale[1] <= scale[0]:
        return ""
    at, low, high = (4 + 112 * (v - scale[0]) / (scale[1] - scale[0]) for v in found)
    return (f'<svg viewBox="0 0 120 12" class="bar" aria-hidden="true"><path class="line t0" '
            f'd="M{low:.1f} 6H{high:.1f}"/><circle class="mark t0" cx="{at:.1f}" cy="6" r="3"/>'
            "</svg>")


def nice_ticks(low: float, high: float, count: int = 6) -> list[float]:
    """Round numbers from `low` to `high`, about `count` of them."""
    raw = (high - low) / count
    if not np.isfinite(raw) or raw <= 0:
        return []
    size = 10.0 ** np.floor(np.log10(raw))
    step = next(m * size for m in (1.0, 2.0, 5.0, 10.0) if m * size >= raw * (1 - 1e-9))
    first = int(np.ceil(low / step - 1e-9))
    return [float(f"{n * step:.10g}") for n in range(first, int(np.floor(high / step + 1e-9)) + 1)]
