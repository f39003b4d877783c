"""What is wrong with silhouettes that are cut out of a camera's image.

In turn: gaps, where the object looks like what is behind it; things of the background that look
like the object; lines that are no edges of the object (a shadow, a label, a shelf), which cut it
where they cross it and add to it elsewhere; single pixels taken for the other side. Sizes are
shares of an image's width [est]. The two cameras see different backgrounds.
"""

import numpy as np
from scipy import ndimage

from warpgrasp.core.random import Purpose, counter_key, counter_uniform
from warpgrasp.parameters import StereoTable

GAP_RADIUS = 0.03
CLUTTER_WIDTH, CLUTTER_HEIGHT = (0.04, 0.12), (0.08, 0.30)
LINE_LENGTH, LINE_WIDTH = (0.10, 0.30), 0.012
_GAPS, _CLUTTER, _LINES, _PIXELS = range(1, 5)  # normals of `camera_noise` begin at 16


def faulty_silhouettes(seen: np.ndarray, key: np.ndarray, table: StereoTable) -> np.ndarray:
    """Silhouettes with the faults that `table` asks for, bool like `seen`.

    `seen` (world, camera, row, column) bool, `key` (world,) uint64. Without faults it is `seen`.
    """
    out = seen.copy()
    stream = counter_key(key[:, None], int(Purpose.CAMERA), 0, np.arange(seen.shape[1]))
    for place in np.ndindex(seen.shape[:2]):
        image, own = out[place], stream[place]
        if table.missing_edges > 0.0:
            image &= ~_gaps(image, counter_key(own, _GAPS), table.missing_edges)
        for number in range(table.clutter):
            image |= _thing(len(image), counter_key(own, _CLUTTER, number))
        for number in range(table.spurious_edges):
            image ^= _line(len(image), counter_key(own, _LINES, number))
    if table.flipped_pixels > 0.0:
        rows, columns = seen.shape[2:]
        pixel = np.arange(rows * columns).reshape(rows, columns)
        draw = counter_uniform(counter_key(stream[..., None, None], _PIXELS, pixel))
        out ^= draw < table.flipped_pixels
    return out


def silhouette_edges(seen: np.ndarray) -> np.ndarray:
    """Seen pixels with an unseen neighbour beside, above or below, bool (..., row, column)."""
    padded = np.pad(seen, [(0, 0)] * (seen.ndim - 2) + [(1, 1), (1, 1)], mode="edge")
    inner = (padded[..., :-2, 1:-1] & padded[..., 2:, 1:-1] & padded[..., 1:-1, :-2]
             & padded[..., 1:-1, 2:])
    return seen & ~inner


def _draws(key: np.ndarray, count: int) -> np.ndarray:
    return counter_uniform(counter_key(key, np.arange(count)))


def _gaps(image: np.ndarray, key: np.ndarray, share: float) -> np.ndarray:
    """Discs about places on the edge, until about `share` of it lies in one."""
    edge = np.argwhere(silhouette_edges(image))
    radius = GAP_RADIUS * len(image)
    inside = np.zeros(len(edge), bool)
    found = np.zeros_like(image)
    rows, columns = np.ogrid[:len(image), :len(image)]
    for number in range(len(edge)):
        if inside.mean() >= share:
            break
        row, column = edge[int(_draws(counter_key(key, number), 1)[0] * len(edge))]
        inside |= np.hypot(*(edge - [row, column]).T) <= radius
        found |= (rows - row) ** 2 + (columns - column) ** 2 <= radius**2
    return found


def _thing(pixels: int, key: np.ndarray) -> np.ndarray:
    """An upright rectangle somewhere in the image."""
    draw = _draws(key, 4)
    size = [pixels * np.interp(u, [0, 1], ends)
            for u, ends in zip(draw[:2], (CLUTTER_HEIGHT, CLUTTER_WIDTH), strict=True)]
    rows, columns = np.ogrid[:pixels, :pixels]
    away = [np.abs(at - u * pixels) <= 0.5 * long
            for at, u, long in zip((rows, columns), draw[2:], size, strict=True)]
    return away[0] & away[1]


def _line(pixels: int, key: np.ndarray) -> np.ndarray:
    """A straight line somewhere in the image."""
    length, angle, row, column = _draws(key, 4)
    way = np.array([np.cos(np.pi * angle), np.sin(np.pi * angle)])
    at = np.moveaxis(np.mgrid[:pixels, :pixels], 0, -1) - pixels * np.array([row, column])
    along, across = at @ way, at @ [-way[1], way[0]]
    half = 0.5 * pixels * np.interp(length, [0, 1], LINE_LENGTH)
    return (np.abs(along) <= half) & (np.abs(across) <= 0.5 * max(LINE_WIDTH * pixels, 1.0))


def object_regions(seen: np.ndarray) -> np.ndarray:
    """What of each image is taken for the object the camera is turned to, bool like `seen`.

    `seen` (n, row, column). Single pixels are decided by their neighbourhood; lines as thin as
    `LINE_WIDTH` are taken away, then cuts as thin are closed. Of the regions left the one with the
    most pixels near the middle counts, its holes filled.
    """
    pixels = seen.shape[-1]
    square = 2.0 * (np.arange(pixels) + 0.5 - pixels / 2) / pixels
    near = np.exp(-4.0 * (square[:, None] ** 2 + square**2))
    thin = max(int(np.ceil(LINE_WIDTH * pixels / 2)), 1)
    rows, columns = np.ogrid[-thin:thin + 1, -thin:thin + 1]
    disc = rows**2 + columns**2 <= thin**2 + 1
    found = np.zeros_like(seen)
    for k, image in enumerate(seen):
        thick = ndimage.binary_opening(_smoothed(image), disc)
        regions, count = ndimage.label(_closed(thick, disc))  # type: ignore
        if count:
            weight = ndimage.sum_labels(near, regions, np.arange(1, count + 1))
            found[k] = ndimage.binary_fill_holes(regions == 1 + int(np.argmax(weight)))
    return found


def _smoothed(image: np.ndarray) -> np.ndarray:
    """The majority of each pixel and its eight neighbours."""
    return ndimage.uniform_filter(image.astype(np.float32), 3, mode="nearest") > 0.5


def _closed(image: np.ndarray, disc: np.ndarray) -> np.ndarray:
    """Without cuts narrower than the disc; what lies at the border of the image stays."""
    wide = np.pad(image, len(disc), mode="edge")
    inner = slice(len(disc), -len(disc))
    return ndimage.binary_closing(wide, disc)[inner, inner]
