"""Where lines along the axes cross a body's surface, and the area that each crossing stands for.

Lines along one axis, even over a face of the body's box, meet an area in proportion to the share
of it that they see, |n| along the axis. Those of all three axes together meet it in proportion to
|nx| + |ny| + |nz|, whose inverse is a crossing's weight (Crofton). Edges get what is theirs: points
of a shell that are moved onto the surface gather at them.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

Distances = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Signed distances (point,) [m] and gradients (point, 3) at points (point, 3) [m]."""

STEPS = 48
"""Pieces of a line; those that may hold two crossings are cut into `FINER` again."""
FINER = 8
_HALVINGS = 12  # of a piece: to less than a micrometre
_OUTSIDE_M = 1e-5  # where normals are taken; more than rounding, far less than edges are rounded


class Crossings(NamedTuple):
    """Points on a surface."""

    point: np.ndarray
    """[m], (crossing, 3)."""
    normal: np.ndarray
    """Outward, unit, (crossing, 3)."""
    area: np.ndarray
    """[m^2], (crossing,); its sum estimates the body's."""


def surface_crossings(
    distances: Distances, low_m: np.ndarray, high_m: np.ndarray, places: np.ndarray
) -> Crossings:
    """Crossings of lines through a box from `low_m` to `high_m` (3,), whose corners are outside.

    `places` (line, 2) are the lines' places on a face of the box, in [0, 1), for each axis.
    """
    found = [_along(distances, low_m, high_m, places, axis) for axis in range(3)]
    return Crossings(*(np.concatenate(part) for part in zip(*found, strict=True)))


def _along(distances: Distances, low: np.ndarray, high: np.ndarray, places: np.ndarray,
           axis: int) -> Crossings:
    across = [(axis + 1) % 3, (axis + 2) % 3]
    start = np.empty((len(places), 3))
    start[:, axis] = low[axis]
    start[:, across] = low[across] + places * (high - low)[across]
    step = (high - low)[axis] / STEPS
    begin = start[:, axis, None] + step * np.arange(STEPS)
    line = np.repeat(np.arange(len(places)), STEPS)
    ends = np.concatenate([begin, begin[:, -1:] + step], axis=1)
    value = _at(distances, start, np.repeat(np.arange(len(places)), STEPS + 1), ends.ravel(), axis)
    value = value.reshape(ends.shape)
    before, after = value[:, :-1].ravel(), value[:, 1:].ravel()
    crossed, doubtful = (before < 0.0) != (after < 0.0), np.abs(before) + np.abs(after) < step
    single, cut = crossed & ~doubtful, doubtful
    # No distance reaches beyond the surface, so that elsewhere nothing is missed.
    finer = begin.ravel()[cut, None] + step / FINER * np.arange(FINER + 1)
    inner = _at(distances, start, np.repeat(line[cut], FINER + 1), finer.ravel(), axis)
    inner = inner.reshape(finer.shape)
    row, piece = np.nonzero((inner[:, :-1] < 0.0) != (inner[:, 1:] < 0.0))
    line = np.concatenate([line[single], line[cut][row]])
    near = np.concatenate([begin.ravel()[single], finer[row, piece]])
    width = np.concatenate([np.full(single.sum(), step), np.full(len(row), step / FINER)])
    leaving = np.concatenate([before[single], inner[row, piece]]) < 0.0
    for _ in range(_HALVINGS):
        width = 0.5 * width
        inside = _at(distances, start, line, near + width, axis) < 0.0
        near = np.where(inside == leaving, near + width, near)
    point = start[line]
    point[:, axis] = near + 0.5 * width
    # On the surface itself gradients may be rounding alone.
    beyond = point.copy()
    beyond[:, axis] += np.where(leaving, _OUTSIDE_M, -_OUTSIDE_M)
    normal = distances(beyond)[1]
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    face = float(np.prod((high - low)[across]))
    return Crossings(point, normal, face / len(places) / np.abs(normal).sum(1))


def _at(distances: Distances, start: np.ndarray, line: np.ndarray, height: np.ndarray,
        axis: int) -> np.ndarray:
    """Distances at heights along lines, (point,)."""
    points = start[line]
    points[:, axis] = height
    return distances(points)[0]
