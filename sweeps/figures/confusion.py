"""The confusion matrix of one entry's recognition: rows what it was, columns the answer."""

from typing import TYPE_CHECKING

import numpy as np

from sweeps.analysis.confusion import Confusion
from sweeps.analysis.entries import LeaderboardError
from sweeps.figures.style import COLUMN_IN, cut, drawing, figure
from sweeps.spec.errors import choose

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_confusion(found: Confusion, label: str | None = None) -> "Figure":
    """The entry `label`; by default the one that is right most often."""
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
        image = axes.imshow(share, cmap="Blues", vmin=0, vmax=1, aspect="auto")
        axes.set_xticks(range(len(found.answers)), [cut(name, 18) for name in found.answers],
                        rotation=60, ha="right", rotation_mode="anchor")
        axes.set_yticks(range(len(found.objects)), [cut(name, 18) for name in found.objects])
        for (row, column), value in np.ndenumerate(share):
            if value > 0:
                axes.text(column, row, f"{100 * value:.0f}", ha="center", va="center",
                          fontsize=5.5, color="white" if value > 0.5 else "black")
        axes.tick_params(length=0)
        axes.spines[:].set_visible(False)
        axes.set(xlabel="recognized as", ylabel="object felt")
        axes.set_title(f"{cut(label, 50)}\n{100 * right:.1f} % right")
        drawn.colorbar(image, label="share of episodes [1]", fraction=0.05)
    return drawn
