"""Parts of a body that touch neither the table nor another part, which no object on a table has."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import find_objects, label

from warpgrasp.geometry.body import Body, scene_of, signed_distance_to_bodies

_CELLS = 64
"""Along the longest side of a body's box; gaps narrower than four of them may pass for none."""
_NEAR = 1.0
"""Cells from a body up to which nodes count as its own: so the thinnest wire is in one piece."""


@dataclass(frozen=True)
class FloatingPart:
    """A part that nothing holds, by the box it fills, in the body's frame [m]."""

    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]


def floating_parts(body: Body) -> tuple[FloatingPart, ...]:
    """The parts of a body, which stands on z = 0, that float; none in most bodies."""
    low, high = np.asarray(body.low_m), np.asarray(body.high_m)
    cell = float((high - low).max()) / _CELLS
    count = np.ceil((high - low) / cell).astype(int) + 1
    nodes = low + cell * np.stack(np.meshgrid(*map(np.arange, count), indexing="ij"), -1)
    distance = signed_distance_to_bodies(
        scene_of([body], "cpu"), np.zeros(1, int), nodes.reshape(1, -1, 3))[0].reshape(count)
    part = np.zeros(count, np.int32)
    label(distance < _NEAR * cell, np.ones((3, 3, 3)), output=part)
    found = []
    for number, box in enumerate(find_objects(part), 1):
        inside = (part[box] == number) & (distance[box] < 0.0)
        if not inside.any():
            continue
        # A ball about each node lies within the body.
        deep, middle = -distance[box][inside][:, None], nodes[box][inside]
        low_m, high_m = (middle - deep).min(0), (middle + deep).max(0)
        if low_m[2] > 2.0 * cell:
            found.append(FloatingPart(tuple(low_m.tolist()), tuple(high_m.tolist())))
    return tuple(found)
