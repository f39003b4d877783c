"""Points of a body for its scorer: inside, on the surface, and its volume, from distances alone.

Low-discrepancy (Sobol, unscrambled) points fill the body's box; those inside sample the volume. Of
a body that fills little of its box, as a slanted rod, they fill the cells that it may reach. Lines
through the box, as evenly spread, cross the surface and sample its area (`surface_crossings`). The
same body always gives the same points.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from itertools import product

import numpy as np
from scipy.spatial import KDTree

from warpgrasp.core.array_checks import check_range
from warpgrasp.geometry.body import Body, BodyError, distances_of
from warpgrasp.geometry.scene import Join
from warpgrasp.geometry.surface_crossings import Crossings, surface_crossings

_LOG2_POINTS = 18
_FEW = 4096
"""Points inside below which cells are filled: a count of so many errs by less than 1 %."""
_PAD = 0.03  # of the box's longest side, by which points go beyond it on each side
_CELLS = 48  # along each side of the box
_EVEN = 1.2207440846057596 ** -np.arange(1.0, 4.0)
"""Multiples of this spread evenly over the unit cube (Roberts 2018; a root of x^4 = x + 1)."""
GROUP = 16
_MOST = np.iinfo(np.int32).max
_LOG2_LINES = 13  # along each axis; as many as even points, where more are asked
_THIN_SHARE = 0.25
"""Of half a wall, the ramp's most: ramps that meet within a wall count more than it holds [est]."""
LEAST_RAMP_M = 1e-9
_ON_M = 1e-5  # points of the surface are so near to it
_OUTSIDE_M = 2e-4


@dataclass(frozen=True)
class BodySample:
    """Points of one body in its own frame [m]."""

    surface_m: np.ndarray
    """Places of the surface, shape (surface, 3); by the side of a box that they face, then along
    Morton's curve."""
    surface_normal: np.ndarray
    """Outward, unit, shape (surface, 3)."""
    surface_share: np.ndarray
    """Of the area, what each of them stands for, shape (surface,)."""
    spacing_m: float
    """Root of the area for which a point of the surface stands in the mean."""
    about_m: np.ndarray
    """Even over the volume and a layer of `ramp_m` around it, shape (inside, 3)."""
    distance_m: np.ndarray
    """Signed distances of `about_m` to the surface, shape (inside,)."""
    ramp_m: float
    """Half the spacing of `about_m`, or less where the body has thin walls."""
    volume_m3: float

    @cached_property
    def groups(self) -> tuple[np.ndarray, np.ndarray]:
        """First and one past the last of points of the surface that follow each other, lie side by
        side and face about the same way, (group,) each."""
        begin, first, wide = [], 0, 9.0 * self.spacing_m
        while first < len(self.surface_m):
            begin.append(first)
            after = slice(first + 1, first + GROUP)
            apart = np.abs(self.surface_m[after] - self.surface_m[first]).max(1) > wide
            apart |= self.surface_normal[after] @ self.surface_normal[first] < 0.5
            first += 1 + int(apart.argmax() if apart.any() else len(apart))
        return np.array(begin), np.array([*begin[1:], len(self.surface_m)])

    @cached_property
    def about_order(self) -> np.ndarray:
        """Points of `about_m` along Morton's curve, (inside,): near ones follow each other."""
        return _along_curve(self.about_m).astype(np.int32)

    def common_volume(self, distance_m: np.ndarray, thick_m: np.ndarray) -> np.ndarray:
        """Volumes [m^3], (body,), that bodies share with this one; `distance_m` (body, inside) are
        signed distances of `about_m` to them, and `thick_m` (body,) their volumes over their areas.

        A point that a surface passes counts in part: by a ramp from 1 to 0 between -`ramp_m` and
        `ramp_m`, or nearer ones where the other body has thin walls.
        """
        ramp = np.minimum(self.ramp_m, np.maximum(_THIN_SHARE * thick_m, LEAST_RAMP_M))[:, None]
        both, own = (np.clip(0.5 - 0.5 / ramp * distance, 0.0, 1.0).sum(-1) for distance in (
            np.maximum(distance_m, self.distance_m), self.distance_m))
        return self.volume_m3 * both / own

    @property
    def inside_m(self) -> np.ndarray:
        """Those of `about_m` that lie inside, (point, 3)."""
        return self.about_m[self.distance_m < 0.0]

    @cached_property
    def tree(self) -> KDTree:
        """Finds the points of the surface that are nearest to others."""
        return KDTree(self.surface_m)

    @cached_property
    def reach_m(self) -> np.ndarray:
        """From each point of the surface to its third neighbour, shape (surface,): discs so wide
        leave hardly a gap."""
        return self.tree.query(self.surface_m, 4)[0][:, 3]


def sample_body(
    body: Body, *, surface: int | None = 1024, inside: int = 4096
) -> BodySample:
    """Sample a body, its surface by so many points, even over the area, or by every crossing that
    was found (None). Of as many points as crossings, quantiles of distances are three to ten times
    as near by the crossings and their shares. Raises ValueError for no points, BodyError where the
    body has (almost) no volume or surface in its box, or reaches out of it.
    """
    check_range("surface", 1 if surface is None else surface, 1, _MOST)
    check_range("inside", inside, 1, _MOST)
    return _sample(keyed_body(body), surface, inside)


def keyed_body(body: Body) -> "KeyedBody":
    """The body, to be known again by its shape and box."""
    return KeyedBody((body.content, body.low_m, body.high_m), body)


@dataclass(frozen=True)
class KeyedBody:
    """A body as the key of a cache."""

    key: tuple[str, tuple[float, ...], tuple[float, ...]]
    """What the sample depends on: the shape, and the box that it is taken in."""
    body: Body

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, KeyedBody) and self.key == other.key


@lru_cache(maxsize=64)
def _sample(keyed: KeyedBody, surface: int | None, inside: int) -> BodySample:
    lines = _LOG2_LINES if surface is None else max(_LOG2_LINES, (surface - 1).bit_length())
    on, points, distance, volume = _dense(keyed, lines)
    skin = _along_curve(on.point)
    share = on.area[skin] / on.area.sum()
    if surface is not None:
        skin, share = _strata(skin, share, surface), np.full(surface, 1.0 / surface)
    side = np.abs(on.normal[skin]).argmax(1)
    side = 2 * side + (np.take_along_axis(on.normal[skin], side[:, None], 1)[:, 0] > 0.0)
    order = np.argsort(side, kind="stable")
    skin, share = skin[order], share[order]
    spacing = float(np.sqrt(on.area.sum() / len(skin)))
    ramp = min(0.5 * (volume / inside) ** (1 / 3),
               _THIN_SHARE * volume / float(on.area.sum()))
    # Any start of a Sobol sequence is even over the volume; a stride would not be.
    core = np.flatnonzero(distance < ramp)
    core = core[np.arange(inside) % len(core)]
    return BodySample(on.point[skin], on.normal[skin], share, spacing, points[core],
                      distance[core], ramp, volume)


@lru_cache(maxsize=2)  # megabytes, for samples of several sizes that are taken one after the other
def _dense(
    keyed: KeyedBody, log2_lines: int
) -> tuple[Crossings, np.ndarray, np.ndarray, float]:
    """All points where lines, so many along each axis, cross a body's surface; points of its box
    with their distances; its volume."""
    body = keyed.body
    points, distance, _, box = _box_distances(body)
    inside = int((distance < 0.0).sum())
    if inside < 64:
        raise BodyError(f"{body.name}: almost no volume: do its parts cut each other away?")
    out = ((points < body.low_m) | (points > body.high_m)).any(1)
    if -distance[out].min() > 0.5 * _PAD * float(np.ptp([body.low_m, body.high_m], 0).max()):
        raise BodyError(f"{body.name}: reaches out of its box from {body.low_m} to {body.high_m} "
                        "[m]; low_m and high_m should be corners of one that holds it")
    if inside < _FEW:
        points, distance, box = _cell_distances(body, 0.5 * (box * inside / len(points)) ** (1 / 3))
        inside = int((distance < 0.0).sum())
    volume = box * inside / len(points)
    distances = distances_of(body)
    low, high = _box(body)
    on = surface_crossings(distances, low, high, sobol_points(log2_lines)[:, :2])
    # Where parts meet face to face is no surface.
    facing = distances(on.point + _OUTSIDE_M * on.normal)[0] > 0.0
    if not facing.any():
        raise BodyError(f"{body.name}: almost no surface: do its parts cut each other away?")
    on = Crossings(*(field[facing] for field in on))
    return on, points, distance, float(volume)


def _along_curve(points: np.ndarray) -> np.ndarray:
    """The order of points (point, 3) along Morton's curve."""
    low, high = points.min(0), points.max(0)
    grid = ((points - low) / (high - low).max() * 1023.0).astype(np.int64)
    code = sum(((grid[:, axis] >> bit) & 1) << (3 * bit + axis)
               for bit in range(10) for axis in range(3))
    return np.argsort(code, kind="stable")


def _strata(order: np.ndarray, share: np.ndarray, count: int) -> np.ndarray:
    """Which of the points along Morton's curve, `order` (point,), stand for all, (count,): the
    middle one of each stretch, stretches of the same area; `share` is that of each.

    Stretches are compact: a mean over these points is two to three times as near to that over all
    as of as many Sobol points. Where in its stretch a point lies has nothing to do with the body's
    edges: points in the middle of their surroundings would leave edges out.
    """
    reached = np.cumsum(share)
    return order[np.searchsorted(reached, (np.arange(count) + 0.5) * (reached[-1] / count))]


def _box(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Corners of the body's box and a little more."""
    low, high = np.asarray(body.low_m), np.asarray(body.high_m)
    pad = _PAD * (high - low).max()
    return low - pad, high + pad


def _box_distances(body: Body) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    low, high = _box(body)
    points = low + sobol_points(_LOG2_POINTS) * (high - low)
    return points, *distances_of(body)(points), float(np.prod(high - low))


def _cell_distances(body: Body, layer_m: float) -> tuple[np.ndarray, np.ndarray, float]:
    """Points of the cells of a body's box that lie within `layer_m` of it, or may, with their
    distances, and the volume of these cells. Each group of points that follow each other has one in
    every cell."""
    low, high = _box(body)
    side = (high - low) / _CELLS
    distances = distances_of(body)
    corner = low + side * np.indices((_CELLS,) * 3).reshape(3, -1).T
    distance, _ = distances(corner + 0.5 * side)
    # No distance reaches beyond the surface, so that nothing is left out.
    corner = corner[distance < 0.5 * np.linalg.norm(side) + layer_m]
    each = max(0, _LOG2_POINTS - int(np.log2(len(corner))))
    # Moved in each cell: a rod may pass many cells in the same way.
    moved = np.arange(len(corner))[:, None] * _EVEN
    points = (corner + side * ((sobol_points(each)[:, None] + moved) % 1.0)).reshape(-1, 3)
    return points, distances(points)[0], float(np.prod(side)) * len(corner)


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
    distances = distances_of(body)
    for _ in range(6):
        d, g = distances(on)
        on = on - d[:, None] * g
    d, g = distances(on)
    is_on = np.abs(d) < _ON_M
    if any(part.join != Join.UNION for part in body.parts):
        # Where a tool is flush with a face that it cuts away, the formula is zero beside no solid.
        beside = [on - 2.0 * _ON_M * g, *(on + 2.0 * _ON_M * np.array(way)
                                          for way in product((-1.0, 1.0), repeat=3))]
        is_on &= np.any([distances(places)[0] < 0.0 for places in beside], axis=0)
    on = on[is_on]
    low, high = on.min(0), on.max(0)
    shift = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    parts = tuple(
        replace(p, place=(*(float(v) for v in np.asarray(p.place[:3]) - shift), *p.place[3:]))
        for p in body.parts)
    low, high = low - shift, high - shift
    return replace(body, parts=parts, low_m=(float(low[0]), float(low[1]), 0.0),
                   high_m=(float(high[0]), float(high[1]), float(high[2])))
