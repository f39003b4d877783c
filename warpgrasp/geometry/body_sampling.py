"""Points of a body for its scorer: inside, on the surface, and its volume, from distances alone.

Low-discrepancy (Sobol, unscrambled) points fill the body's box; those inside sample the volume, and
those of a thin shell, moved along the gradient onto the surface, sample the area evenly. The same
body always gives the same points.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy.spatial import KDTree

from warpgrasp.geometry.body import Body, BodyError, distance_to_bodies, scene_of

_LOG2_POINTS = 18
_OFF_M = 1e-4  # points that Newton's steps left farther from the surface are dropped
_OUTSIDE_M = 2e-4


@dataclass(frozen=True)
class BodySample:
    """Points of one body in its own frame [m]."""

    surface_m: np.ndarray
    """Even over the area, shape (surface, 3)."""
    surface_normal: np.ndarray
    """Outward, unit, shape (surface, 3)."""
    inside_m: np.ndarray
    """Even over the volume, shape (inside, 3)."""
    volume_m3: float

    @cached_property
    def tree(self) -> KDTree:
        """Finds the points of the surface that are nearest to others."""
        return KDTree(self.surface_m)

    @cached_property
    def reach_m(self) -> np.ndarray:
        """From each point of the surface to its third neighbour, shape (surface,): discs so wide
        leave hardly a gap."""
        return self.tree.query(self.surface_m, 4)[0][:, 3]


def sample_body(body: Body, *, surface: int = 1024, inside: int = 4096) -> BodySample:
    """Sample a body. Raises BodyError where it has (almost) no volume or surface in its box."""
    return _sample(_Keyed((body.content, body.low_m, body.high_m), body), surface, inside)


@dataclass(frozen=True)
class _Keyed:
    key: tuple[str, tuple[float, ...], tuple[float, ...]]
    """What the sample depends on: the shape, and the box that it is taken in."""
    body: Body

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Keyed) and self.key == other.key


@lru_cache(maxsize=64)
def _sample(keyed: _Keyed, surface: int, inside: int) -> BodySample:
    on, normal, within, volume = _dense(keyed)
    skin = _strata(on, surface)
    # Any start of a Sobol sequence is even over the volume; a stride would not be.
    core = np.arange(inside) % len(within)
    return BodySample(on[skin], normal[skin], within[core], volume)


@lru_cache(maxsize=2)  # megabytes, for samples of several sizes that are taken one after the other
def _dense(keyed: _Keyed) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """All points on the surface, their normals, all points within, and the volume of a body."""
    body = keyed.body
    points, distance, gradient, box = _box_distances(body)
    within = points[distance < 0.0]
    if len(within) < 64:
        raise BodyError(f"{body.name}: almost no volume: do its parts cut each other away?")
    volume = box * len(within) / len(points)
    shell = 0.012 * box ** (1 / 3)
    near = np.abs(distance) < shell
    scene = scene_of([body], "cpu")
    on = points[near] - distance[near, None] * gradient[near]
    for _ in range(4):
        d, g = distance_to_bodies(scene, np.zeros(1, int), on[None])
        on = on - d[0, :, None] * g[0]
    d, _ = distance_to_bodies(scene, np.zeros(1, int), on[None])
    # On the surface itself gradients may be rounding alone; where parts meet face to face is none.
    beyond, normal = distance_to_bodies(scene, np.zeros(1, int),
                                        (on + _OUTSIDE_M * gradient[near])[None])
    good = (np.abs(d[0]) < _OFF_M) & (beyond[0] > 0.0)
    normal = normal[0][good]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)  # a baked grid's are shorter
    return on[good], normal, within, float(volume)


def _strata(points: np.ndarray, count: int) -> np.ndarray:
    """Which of the points (point, 3) stand for all, (count,): the middle one of each stretch of
    Morton's curve.

    Stretches are compact: a mean over these points is two to three times as near to that over all
    as of as many Sobol points. Where in its stretch a point lies has nothing to do with the body's
    edges: points in the middle of their surroundings would leave edges out.
    """
    low, high = points.min(0), points.max(0)
    grid = ((points - low) / (high - low).max() * 1023.0).astype(np.int64)
    code = sum(((grid[:, axis] >> bit) & 1) << (3 * bit + axis)
               for bit in range(10) for axis in range(3))
    order = np.argsort(code, kind="stable")
    return order[((np.arange(count) + 0.5) * (len(points) / count)).astype(int)]


def _box_distances(body: Body) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    low, high = np.asarray(body.low_m), np.asarray(body.high_m)
    pad = 0.03 * (high - low).max()
    low, high = low - pad, high + pad
    points = low + sobol_points(_LOG2_POINTS) * (high - low)
    d, g = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int), points[None])
    return points, d[0], g[0], float(np.prod(high - low))


def sobol_points(log2_count: int) -> np.ndarray:
    """The first 2^n points of Sobol's sequence in the unit cube, shape (2^n, 3).

    In the order of the Gray code, directions of Joe and Kuo (2008); the same as
    `scipy.stats.qmc.Sobol(3, scramble=False)`, whose import takes longer than an episode.
    """
    directions = [[1] * log2_count, [1], [1, 3]]
    for k in range(1, log2_count):
        before = directions[1][k - 1]
        directions[1].append(2 * before ^ before)
    for k in range(2, log2_count):
        before, earlier = directions[2][k - 1], directions[2][k - 2]
        directions[2].append(2 * before ^ 4 * earlier ^ earlier)
    points = np.zeros((1 << log2_count, 3), np.uint32)
    before = np.zeros(3, np.uint32)
    for bit in range(log2_count):
        # The Gray code of i + 2^bit is that of i with this bit and the one below it turned over.
        direction = np.array([m[bit] << (31 - bit) for m in directions], np.uint32)
        half = 1 << bit
        points[half : 2 * half] = points[:half] ^ direction ^ before
        before = direction
    return points / 2.0**32


def body_lowered(body: Body) -> Body:
    """The body moved so that it stands on z = 0, its box about the z axis.

    Raises BodyError where nothing of it is left.
    """
    points, distance, gradient, _ = _box_distances(body)
    if not (distance < 0.0).any():
        raise BodyError(f"{body.name}: nothing is left of it: do its parts cut each other away?")
    cell = float(np.max(np.subtract(body.high_m, body.low_m))) * 0.03
    near = np.abs(distance) < cell
    on = points[near] - distance[near, None] * gradient[near]
    scene = scene_of([body], "cpu")
    for _ in range(6):
        d, g = distance_to_bodies(scene, np.zeros(1, int), on[None])
        on = on - d[0, :, None] * g[0]
    d, _ = distance_to_bodies(scene, np.zeros(1, int), on[None])
    on = on[np.abs(d[0]) < 1e-5]
    low, high = on.min(0), on.max(0)
    shift = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    parts = tuple(
        replace(p, place=(*(float(v) for v in np.asarray(p.place[:3]) - shift), *p.place[3:]))
        for p in body.parts)
    low, high = low - shift, high - shift
    return replace(body, parts=parts, low_m=(float(low[0]), float(low[1]), 0.0),
                   high_m=(float(high[0]), float(high[1]), float(high[2])))
