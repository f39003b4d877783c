"""Primitives on tactile images, batched: the set of Allen and Michelman (1990), section III.

Images are arrays [n, row, column] of counts (16 x 16 for a pad, any size works). Filters repeat the
border taxels. Nothing here knows of robots: use it on images of your own.
"""

from dataclasses import dataclass

import numpy as np

from warpgrasp.core.array_checks import check_range

_SOBEL = np.array([[-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0], [-1.0, 0.0, 1.0]])


@dataclass(frozen=True)
class Moments:
    """Moments of images, taxels as the unit. Shapes start with (n,); an empty image gives NaN."""

    mass: np.ndarray
    """Sum of all counts."""
    area: np.ndarray
    """Taxels above the level."""
    centroid: np.ndarray
    """(row, column), (n, 2)."""
    second: np.ndarray
    """Central second moments over mass: row-row, row-column, column-column, (n, 3)."""
    eccentricity: np.ndarray
    """Of the ellipse with the same second moments: 0 a circle, 1 a line."""
    axis_rad: np.ndarray
    """Principal axis, from the row axis towards the column axis, in (-pi/2, pi/2]."""


def _stack(images: np.ndarray) -> np.ndarray:
    images = np.asarray(images, float)
    if images.ndim != 3 or 0 in images.shape[1:]:
        raise ValueError(f"images of shape {images.shape}; (n, row, column) is wanted")
    return images


def _odd(size: int) -> int:
    if size < 1 or size % 2 == 0:
        raise ValueError(f"window {size}: an odd number from 1 on is wanted")
    return size


def mean_filter(images: np.ndarray, size: int = 3) -> np.ndarray:
    """Mean of each `size` x `size` neighbourhood, (n, row, column)."""
    from scipy.ndimage import correlate1d  # a running sum would leave traces where all is zero

    weight = np.full(_odd(size), 1.0 / size)
    along_rows = correlate1d(_stack(images), weight, 1, mode="nearest")
    return correlate1d(along_rows, weight, 2, mode="nearest")


def median_filter(images: np.ndarray, size: int = 3) -> np.ndarray:
    """Median of each `size` x `size` neighbourhood, (n, row, column)."""
    from scipy import ndimage

    return ndimage.median_filter(_stack(images), (1, _odd(size), size), mode="nearest")


def moments(images: np.ndarray, level: float = 0.0) -> Moments:
    """Moments of the counts above `level` (others count as nothing)."""
    images = _stack(images)
    weight = np.where(images > level, images, 0.0)
    row = np.arange(images.shape[1])[None, :, None]
    column = np.arange(images.shape[2])[None, None, :]
    mass = weight.sum((1, 2))
    with np.errstate(invalid="ignore", divide="ignore"):
        centroid = np.stack([(weight * row).sum((1, 2)), (weight * column).sum((1, 2))],
                            1) / mass[:, None]
        dr = row - centroid[:, 0, None, None]
        dc = column - centroid[:, 1, None, None]
        rr, rc, cc = ((weight * product).sum((1, 2)) / mass
                      for product in (dr * dr, dr * dc, dc * dc))
        apart = np.hypot(rr - cc, 2 * rc)
        large, small = rr + cc + apart, np.maximum(rr + cc - apart, 0.0)
        eccentricity = np.where(large > 0, np.sqrt(np.maximum(1 - small / large, 0.0)), 0.0)
    eccentricity = np.where(mass > 0, eccentricity, np.nan)
    return Moments(mass, (images > level).sum((1, 2)), centroid, np.stack([rr, rc, cc], 1),
                   eccentricity, 0.5 * np.arctan2(2 * rc, rr - cc))


def sobel(images: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slope along rows and along columns by Sobel's operator, each (n, row, column)."""
    from scipy.ndimage import correlate

    images = _stack(images)  # `ndimage.sobel` would also smooth from image to image
    return (correlate(images, _SOBEL.T[None], mode="nearest"),
            correlate(images, _SOBEL[None], mode="nearest"))


def sobel_edges(images: np.ndarray, level: float) -> np.ndarray:
    """Taxels whose Sobel slope has at least the size `level`, bool (n, row, column)."""
    along_row, along_column = sobel(images)
    return np.hypot(along_row, along_column) >= level


def laplacian_of_gaussian(images: np.ndarray, sigma: float = 1.0) -> np.ndarray:
    """Laplacian of the image smoothed by a Gaussian of `sigma` taxels, (n, row, column).

    The sampled kernels reach four sigma; the Gaussian sums to one, the second derivative to none,
    which that of `ndimage.gaussian_laplace` does not.
    """
    from scipy.ndimage import correlate1d

    if not sigma > 0.0:
        raise ValueError(f"sigma {sigma}: a positive number of taxels is wanted")
    reach = int(4.0 * sigma + 0.5)
    x = np.arange(-reach, reach + 1) / sigma
    smooth = np.exp(-0.5 * x * x)
    smooth /= smooth.sum()
    curve = smooth * (x * x - smooth @ (x * x)) / sigma**2
    images = _stack(images)

    def along(row_kernel: np.ndarray, column_kernel: np.ndarray) -> np.ndarray:
        rows = correlate1d(images, row_kernel, 1, mode="nearest")
        return correlate1d(rows, column_kernel, 2, mode="nearest")

    return along(curve, smooth) + along(smooth, curve)


def zero_crossings(response: np.ndarray, level: float = 0.0) -> np.ndarray:
    """Taxels where a response changes sign towards the next row or column by more than `level`."""
    response = _stack(response)
    crossing = np.zeros(response.shape, bool)
    for axis in (1, 2):
        here = np.take(response, range(response.shape[axis] - 1), axis)
        there = np.take(response, range(1, response.shape[axis]), axis)
        change = ((here < 0) != (there < 0)) & (np.abs(here - there) > level)
        view = crossing[:, :-1] if axis == 1 else crossing[:, :, :-1]
        view |= change
    return crossing


@dataclass(frozen=True)
class Lines:
    """Straight lines in images: row cos(angle) + column sin(angle) = offset. Shapes (n, line)."""

    angle_rad: np.ndarray
    """In [0, pi)."""
    offset: np.ndarray
    """[taxels]."""
    votes: np.ndarray
    """Edge taxels on the line; 0 where an image has no further line."""


def hough_lines(
    edges: np.ndarray, *, count: int = 1, angles: int = 180, cell: float = 1.0, fewest: int = 3
) -> Lines:
    """The `count` strongest lines through edge taxels, bool (n, row, column), by Hough's transform.

    Votes go to cells of pi/`angles` by `cell` taxels. A line found takes its taxels (within a
    cell of it) with it before the next is sought; fewer votes than `fewest` make no line. Raises
    ValueError for a cell of no width, and counts that are none.
    """
    for name, number, least in (("count", count, 0), ("angles", angles, 1), ("fewest", fewest, 1)):
        check_range(name, number, least, np.iinfo(np.int32).max)
    if not 0.0 < cell < np.inf:
        raise ValueError(f"cell {cell}: should be above 0 and finite")
    edges = np.array(edges, bool)
    n, rows, columns = _stack(edges).shape
    theta = np.arange(angles) * np.pi / angles
    reach = int(np.ceil(np.hypot(rows, columns) / cell)) + 1
    row, column = np.mgrid[:rows, :columns]
    found = np.zeros((3, n, count))
    for k in range(count):
        image, r, c = np.nonzero(edges)
        distance = r[:, None] * np.cos(theta) + c[:, None] * np.sin(theta)
        slot = np.rint(distance / cell).astype(int) + reach
        votes = np.zeros((n, angles, 2 * reach + 1), int)
        np.add.at(votes, (image[:, None], np.arange(angles)[None], slot), 1)
        best = votes.reshape(n, angles * (2 * reach + 1)).argmax(1)
        at, slot = np.divmod(best, 2 * reach + 1)
        strongest = votes[np.arange(n), at, slot]
        enough = strongest >= fewest
        angle, offset = theta[at], (slot - reach) * cell
        found[:, :, k] = (np.where(enough, angle, np.nan), np.where(enough, offset, np.nan),
                          np.where(enough, strongest, 0))
        away = (row * np.cos(angle)[:, None, None] + column * np.sin(angle)[:, None, None]
                - offset[:, None, None])
        edges &= (np.abs(away) >= cell) | ~enough[:, None, None]
    return Lines(found[0], found[1], found[2].astype(int))
