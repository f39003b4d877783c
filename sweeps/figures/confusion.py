"""The confusion matrix of one entry: a row for each object felt, a column for each answer."""

from typing import TYPE_CHECKING

import numpy as np

from sweeps.analysis.confusion import Confusion
from sweeps.analysis.entries import LeaderboardError
from sweeps.figures.style import COLUMN_IN, cut, drawing, figure, heat_map
from sweeps.spec.errors import choose

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_confusion(found: Confusion, label: str | None = None) -> "Figure":
    """The matrix of the entry `label`, by default of the one that is right most often.

    Raises LeaderboardError for an unknown entry, and where none names the object.
    """
    if not found.labels:
        raise LeaderboardError("confusion: no strategy of this study names what it felt")
    if label is None:
        label = max(found.labels, key=lambda name: sum(
            found.counts[name, body][body] for body in found.objects))
    if label not in found.labels:
        raise LeaderboardError(f"--strategy: no strategy {label!r}; {choose(label, found.labels)}")
    counts = np.array([[found.counts[label, body][answer] for answer in found.answers]
                       for body in found.objects], float)
    share = counts / counts.sum(axis=1, keepdims=True)
    right = np.mean([found.counts[label, body][body] / found.counts[label, body].total()
                     for body in found.objects])
    with drawing():
        drawn = figure(COLUMN_IN * (0.45 + 0.07 * len(found.objects)))
        axes = drawn.add_subplot()
        text = [[f"{100 * value:.0f}" if value > 0 else "" for value in row] for row in share]
        cells = heat_map(axes, share, "Blues", (0.0, 1.0), text, share > 0.5)
        axes.set_xticks(range(len(found.answers)), [cut(name, 18) for name in found.answers],
                        rotation=60, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(len(found.objects)), [cut(name, 18) for name in found.objects])
        axes.set(xlabel="recognized as", ylabel="object felt")
        axes.set_title(f"{cut(label, 50)}\n{100 * right:.1f} % right")
        drawn.colorbar(cells, label="share of episodes [1]", fraction=0.05)
    return drawn
