"""The outline of a body seen from above: how far it reaches in every level direction.

The farthest of points sampled on a surface lies short of where the body ends, by up to the distance
between samples. From there the place goes on: a step outwards and back to the nearest place of the
surface, which never lies less far out.
"""

from functools import lru_cache

import numpy as np

from warpgrasp.geometry.body import Body, distances_of
from warpgrasp.geometry.body_sampling import KeyedBody, keyed_body, sample_body

DIRECTIONS = 256
"""A circle is wider than the polygon of so many places by less than 1e-4 of its radius."""
_STEPS = 12
_NEWTON = 8
_ON_M = 1e-6  # a place of the surface is so near to it
_WITHIN_M = 2e-5
"""So far inwards of a place there is solid."""


def outline_of(body: Body) -> np.ndarray:
    """Places of the body (direction, 2) [m] that lie farthest out in each of `DIRECTIONS` level
    directions, in its frame. Raises BodyError as `sample_body`."""
    return _outline(keyed_body(body))


def radius_around(body: Body) -> float:
    """Radius of the cylinder about the z axis of a body's frame that just holds it [m]."""
    return float(np.hypot(*outline_of(body).T).max())


@lru_cache(maxsize=64)
def _outline(keyed: KeyedBody) -> np.ndarray:
    body = keyed.body
    distance = distances_of(body)
    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    way = np.stack([np.cos(angle), np.sin(angle), np.zeros(DIRECTIONS)], 1)
    surface = sample_body(body, surface=None).surface_m
    place = surface[(way @ surface.T).argmax(1)]
    size = float(np.max(np.subtract(body.high_m, body.low_m)))
    # Long steps are the best where distances are true; where they are estimates, short ones come
    # back to the surface.
    for step in size * 0.5 ** np.arange(_STEPS):
        out = place + step * way
        back = out
        for _ in range(_NEWTON):
            off, slope = distance(back)
            back = back - off[:, None] * slope
        inwards = back - out
        inwards = inwards / np.maximum(np.linalg.norm(inwards, axis=1, keepdims=True), 1e-12)
        # Where a tool is flush with a face that it cuts away, the formula is zero beside no solid.
        solid = distance(back + _WITHIN_M * inwards)[0] < 0.25 * _WITHIN_M
        farther = ((back - place) * way).sum(1) > 0.0
        better = farther & solid & (np.abs(distance(back)[0]) < _ON_M)
        place = np.where(better[:, None], back, place)
    return np.ascontiguousarray(place[:, :2])
