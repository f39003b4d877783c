"""The style of figures and their encoding; the same figure gives the same bytes.

Figures are one column of a journal wide (85 mm). Colours suit colour-blind readers (Okabe and Ito
2008); lines also differ in dash, points in marker.
"""

import io
import re
import warnings
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from sweeps.output import note

if TYPE_CHECKING:
    from matplotlib.figure import Figure
COLUMN_IN = 85.0 / 25.4
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C6D1F")
DASHES = ("-", "--", "-.", ":", (0, (5, 1)), (0, (3, 1, 1, 1)), (0, (1, 1)), (0, (7, 2)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<")
MUTED = "#9a9a9a"
VERDICTS = {"best": COLOURS[2], "open": COLOURS[0], "tied": COLOURS[1], "worse": MUTED}
"""What a colour says of an entry, in pictures of races and where studies are watched."""
FARTHEST = 3.0
"""How far a frame reaches for intervals, in largest means: those of few objects may be wider."""
MARGIN = 0.04
"""Of a frame, beyond the outermost of what is drawn."""
FORMATS = ("svg", "png", "pdf")
DPI = 300
PACKED = 3
"""zlib's level for PNG: files a tenth larger than at level 6, in two thirds of the time."""
UNITS = {
    "chamfer_mm": "chamfer distance [mm]", "hausdorff95_mm": "Hausdorff distance, 95 % [mm]",
    "normalized_chamfer": "normalized chamfer distance [1]",
    "iou": "intersection over union [1]", "coverage5mm": "surface within 5 mm [1]",
    "recognized": "recognized [1]", "touches": "touches", "robot_time_s": "robot time [s]",
    "arm_path_m": "arm path [m]", "fit_rms_mm": "rms of the fit [mm]",
}
FALLBACKS = ("Noto Sans CJK JP", "Noto Sans CJK SC", "Noto Sans JP", "Noto Sans SC",
             "Noto Sans KR", "WenQuanYi Zen Hei", "WenQuanYi Micro Hei", "IPAGothic", "IPAexGothic",
             "Droid Sans Fallback", "Hiragino Sans", "Arial Unicode MS", "Yu Gothic",
             "Microsoft YaHei", "Malgun Gothic")
"""Fonts for letters that the font of figures has not, as far as they are installed."""
_BOX = r"Glyph \d+ .* missing from"
_STYLE: dict[str, Any] = {
    "font.size": 7.0, "axes.titlesize": 7.5, "axes.labelsize": 7.0, "legend.fontsize": 6.5,
    "xtick.labelsize": 6.5, "ytick.labelsize": 6.5, "axes.spines.top": False,
    "axes.spines.right": False, "axes.linewidth": 0.6, "lines.linewidth": 1.2,
    "xtick.major.width": 0.6, "ytick.major.width": 0.6, "legend.frameon": False,
    "figure.constrained_layout.use": True, "svg.hashsalt": "warpgrasp", "savefig.dpi": DPI,
    "figure.facecolor": "white", "axes.unicode_minus": True,
    "text.parse_math": False,  # names are the user's and may hold dollar signs
}


@dataclass(frozen=True)
class Look:
    """By what an entry is known in every figure of a study."""

    colour: str
    dash: Any
    marker: str


def looks_of(errors: np.ndarray, labels: Sequence[str]) -> list[Look]:
    """Each entry's look by its place in the leaderboard of `errors`, (entry,), the least first.

    The best eight differ in colour; then colours come again, with other dashes and markers.
    """
    looks = [Look("", "", "")] * len(labels)
    for place, n in enumerate(order_of(errors, labels)):
        other = (place + place // len(COLOURS)) % len(MARKERS)
        looks[n] = Look(COLOURS[place % len(COLOURS)], DASHES[other], MARKERS[other])
    return looks


def order_of(errors: np.ndarray, labels: Sequence[str]) -> list[int]:
    """Entries by their errors, (entry,), the least first, those without one last; equal ones by
    their labels. Figures sum the same rows in different orders, so what differs by rounding alone
    is equal."""
    known = np.where(np.isfinite(errors), errors, np.inf)
    keys = [(float(f"{value:.9g}"), label) for value, label in zip(known, labels, strict=True)]
    return sorted(range(len(keys)), key=keys.__getitem__)


@contextmanager
def drawing() -> Iterator[None]:
    """Matplotlib's settings for our figures; also a decorator of functions that draw.

    It warns of names whose letters its fonts have not, which is noted once, and of axes on which
    all is at one place. Neither is an error of the user's.
    """
    import matplotlib

    style = _STYLE | {"font.family": _fonts()}
    with matplotlib.rc_context(style), warnings.catch_warnings():  # type: ignore
        shown = warnings.showwarning

        def show(message: Warning | str, *rest: Any, **named: Any) -> None:
            if re.search(_BOX, str(message)):
                _note_boxes()
            else:
                shown(message, *rest, **named)

        warnings.filterwarnings("always", _BOX, UserWarning)
        warnings.filterwarnings("ignore", "Attempting to set identical low and high", UserWarning)
        warnings.showwarning = show
        yield


@cache
def _fonts() -> list[str]:
    """The font of figures, then those of other scripts that are installed."""
    from matplotlib.font_manager import fontManager

    there = {entry.name for entry in fontManager.ttflist}
    return ["DejaVu Sans", *(name for name in FALLBACKS if name in there)]


@cache
def _note_boxes() -> None:
    note("no font here has some letters of the names: figures show them as boxes; one such as Noto "
         "Sans CJK is taken where it is installed")


def figure(height_in: float, width_in: float = COLUMN_IN) -> "Figure":
    """An empty figure without pyplot, so that nothing has to be closed."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width_in, height_in))


def encode(drawn: "Figure", file_format: str) -> bytes:
    """The bytes of a figure; `file_format` one of FORMATS, else LeaderboardError."""
    file_format = file_format.lower()
    if file_format not in FORMATS:
        from sweeps.analysis.entries import LeaderboardError
        from sweeps.spec.errors import choose

        raise LeaderboardError(f"--out: a figure cannot be written as {file_format!r}; "
                               f"{choose(file_format, FORMATS)}")
    with drawing():
        if file_format == "png":
            return _png(drawn)
        no_date: dict[str, Any] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
        stream = io.BytesIO()
        drawn.savefig(stream, format=file_format, metadata=no_date[file_format])
        return stream.getvalue()


def _png(drawn: "Figure") -> bytes:
    """The figure drawn once; `savefig` would draw it twice, first for the layout."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    drawn.set_dpi(DPI)
    canvas = FigureCanvasAgg(drawn)
    canvas.draw()
    opaque = Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    stream = io.BytesIO()
    opaque.save(stream, "png", dpi=(DPI, DPI), compress_level=PACKED)
    return stream.getvalue()


def farthest_end(value: np.ndarray, high: np.ndarray) -> float | None:
    """Where a frame is to end that cuts intervals far beyond all means; None if none is."""
    known, ends = value[np.isfinite(value)], high[np.isfinite(high)]
    if not len(known) or not len(ends) or known.max() <= 0.0:
        return None
    most = max(FARTHEST * float(known.max()), 1.0)  # shares have whole intervals
    return most if ends.max() > most else None


def framed(value: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[float, float] | None:
    """The limits of an axis that cuts intervals far beyond all means; None if none is."""
    end = farthest_end(value, high)
    if end is None:
        return None
    least = float(np.nanmin(np.concatenate([value, low])))
    return least - MARGIN * (end - least), end


def slant(columns: int) -> float:
    """Degrees by which so many labels of columns are turned: the more, the steeper."""
    return 25.0 if columns <= 5 else 45.0 if columns <= 9 else 90.0


def text_width_in(text: str, points: float) -> float:
    """How wide a line of text is drawn."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextToPath

    with warnings.catch_warnings(action="ignore"):  # of letters that the font has not
        width, _, _ = TextToPath().get_text_width_height_descent(
            text, FontProperties(size=points), ismath=False)
    return width / 72.0


def cut_to(label: str, width_in: float, points: float = 7.5) -> str:
    """A label that is at most so wide: letters differ by a factor of three."""
    for width in range(len(label), 1, -1):
        if text_width_in(cut(label, width), points) <= width_in:
            return cut(label, width)
    return cut(label, 1)


def titled(name: str, words: str) -> str:
    """A title that names an object and says what is shown: in two lines if one has no room."""
    if text_width_in(f"{name}: {words}", 7.5) <= 0.92 * COLUMN_IN:
        return f"{name}: {words}"
    return f"{cut_to(name, 0.92 * COLUMN_IN)}\n{words}"


def metric_label(metric: str) -> str:
    """An axis label with its unit, and which way is better."""
    from sweeps.analysis.entries import HIGHER_IS_BETTER  # not to draw an episode

    way = "more" if metric in HIGHER_IS_BETTER else "less"
    return f"{UNITS.get(metric, metric)}, {way} is better"


def distinct_labels(labels: Sequence[str], width: int) -> tuple[list[str], str]:
    """Labels of at most `width` characters that still differ, and the keys of their brackets.

    Where all entries sweep the same keys only the values are kept: `ring6 [hand.x=3, y=4]` becomes
    `ring6 [3, 4]`, and the keys are for the legend.
    """
    found = [re.fullmatch(r"(.*?) \[(\S+=.*)\]", label) for label in labels]
    settings = [[part.partition("=") for part in match[2].split(", ")] for match in found if match]
    keys = {tuple(key for key, _, _ in parts) for parts in settings}
    if not labels or len(settings) < len(labels) or len(keys) > 1:
        return cut_apart(labels, width), ""
    values = [" [" + ", ".join(value for _, _, value in parts) + "]" for parts in settings]
    heads = [match[1] for match in found if match]
    short = [cut(head, max(width - len(of), 6)) + of
             for head, of in zip(heads, values, strict=True)]
    if len(set(short)) < len(set(labels)):
        heads = cut_apart(heads, max(width - max(map(len, values)), 6))
        short = [head + of for head, of in zip(heads, values, strict=True)]
    return short, f"[{', '.join(keys.pop())}]"


def cut_apart(labels: Sequence[str], width: int) -> list[str]:
    """Labels of at most `width` characters that differ where the whole ones do: cut at the end, or
    in the middle, or else numbered."""
    ends = width // 2
    short = {label: cut(label, width) for label in labels}
    alike = _alike(short)
    short |= {label: f"{label[:width - 1 - ends]}…{label[-ends:]}" for label in alike
              if len(label) > width}
    for number, label in enumerate(_alike(short), 1):
        tail = f"…{number}"
        short[label] = label[:width - len(tail)] + tail
    return [short[label] for label in labels]


def _alike(short: Mapping[str, str]) -> list[str]:
    """Labels of which another one is shortened to the same."""
    count = Counter(short.values())
    return [label for label, text in short.items() if count[text] > 1]


def cut(label: str, width: int = 30) -> str:
    """A label of at most `width` characters."""
    return label if len(label) <= width else label[:width - 1] + "…"
