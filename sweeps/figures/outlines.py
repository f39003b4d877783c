"""Outlines of bodies seen along an axis: of the whole body, concavities and holes included."""

from typing import Any

import numpy as np

PIXELS = 384
"""Of the longer side of the picture that an outline is traced in."""
_EDGE = 4
"""Pixels around the body, so that its outline closes."""
_SMOOTH = 1.0
"""Standard deviation [pixels] of the blur that makes an outline of steps a curve."""


def silhouette(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which places the faces of a body cover, its faces (face, corner, 2) seen along an axis.

    Coordinates of columns and of rows, and the covered share (row, column) from 0 to 1.
    """
    from PIL import Image, ImageDraw
    from scipy.ndimage import gaussian_filter

    low, high = faces.reshape(-1, 2).min(0), faces.reshape(-1, 2).max(0)
    step = float((high - low).max()) / PIXELS
    count = np.ceil((high - low) / step).astype(int) + 1 + 2 * _EDGE
    picture = Image.new("L", (int(count[0]), int(count[1])))
    pen = ImageDraw.Draw(picture)
    for corners in (faces - low) / step + _EDGE:
        pen.polygon([(float(x), float(y)) for x, y in corners], fill=255, outline=255)
    covered = gaussian_filter(np.asarray(picture, float) / 255, _SMOOTH)
    x, y = (low[k] + step * (np.arange(count[k]) - _EDGE) for k in (0, 1))
    return x, y, covered


def draw_outline(axes: Any, faces: np.ndarray, colour: str, style: str, label: str) -> None:
    """Draws the outline of a body, its faces (face, corner, 2) seen along an axis."""
    x, y, covered = silhouette(faces)
    axes.contour(x, y, covered, levels=[0.5], colors=[colour], linestyles=[style],
                 linewidths=1.2)
    axes.plot([], [], style, color=colour, lw=1.2, label=label)  # contours have no legend
