"""What a hand touches with: every link as a few parallel capsules, its skin.

A link whose shapes are capsules, and few, keeps them. Otherwise the convex hull of its shapes is
boxed in the frame of the largest of them, and a row of capsules as thick as that box fills it, with
slits between them where the box is much wider than thick. Its edges become round by half its
thickness: a skin is round, and distances from a capsule are those from its axis. The palm's shapes
are filled one by one.

What is as large, or as long, to rounding goes by the order of the file, never by the frame of the
link: a hand that is said in other frames has the same skin.
"""

from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np
from scipy.spatial import ConvexHull

from warpgrasp.hands.hand_frames import matrix_of
from warpgrasp.hands.hand_model import (
    STILL,
    Box,
    Capsule,
    Finger,
    HandModel,
    Shape,
    Vector,
    vector_of,
)

SIDE_BY_SIDE = 3
"""Capsules in a link at most; a link of at most as many capsules keeps them."""
MOST = 12
"""Capsules of a whole finger."""
_APART = 1.0
"""Their axes lie apart by about this times their radius, as far as they may be so many: grooves are
then a seventh of it deep."""
_THINNEST_M = 1e-3
_BALL_M = 1e-9
"""Half an axis; what is shorter is a ball."""
_DIGITS, _DIGITS_M3 = 9, 15
"""To which lengths [m] and volumes [m3] are compared."""
_APART_M = 1e-6
"""Places that are nearer have no direction from one to the other."""
_DIRECTIONS = 1000
"""Of points on a ball whose hull is weighed: it is lighter by less than one percent."""
_PLACES = 64
"""Places of a link whose directions are tried, at most: it would take long."""


@dataclass(frozen=True)
class Bulk:
    """What a link weighs by: the volume [m3] of the hull of its shapes, and its centre [m]."""

    volume_m3: float
    centre_m: Vector
    """In the joint's frame."""


def touch_model(model: HandModel) -> HandModel:
    """The hand with capsules for all its shapes."""
    return replace(
        model, fingers=tuple(_finger(finger) for finger in model.fingers),
        palm=tuple(c for shape in model.palm for c in _skin((shape,), SIDE_BY_SIDE)))


def skins_of(model: HandModel) -> list[tuple[str, tuple[Shape, ...], tuple[Capsule, ...]]]:
    """Of each shape of the palm and each link: its name, its shapes, and the capsules for them."""
    links = [(f"joint {joint.name}", joint.shapes,
              tuple(c for c in touched.shapes if isinstance(c, Capsule)))
             for joint, touched in zip(model.joints, touch_model(model).joints, strict=True)]
    return [(f"palm[{n}]", (shape,), _skin((shape,), SIDE_BY_SIDE))
            for n, shape in enumerate(model.palm)] + [link for link in links if link[1]]


def _finger(finger: Finger) -> Finger:
    """With as many capsules a link as a finger has room for: its joints are six at most."""
    for most in (SIDE_BY_SIDE, 2, 1):
        joints = tuple(replace(joint, shapes=_skin(joint.shapes, most)) for joint in finger.joints)
        if sum(len(joint.shapes) for joint in joints) <= MOST:
            break
    return replace(finger, joints=joints)


def bulk_of(shapes: tuple[Shape, ...]) -> Bulk:
    """Volume and centre of the convex hull of shapes; of a single capsule exactly, of none none."""
    if not shapes:
        return Bulk(0.0, STILL[:3])
    if len(shapes) == 1 and isinstance(shapes[0], Capsule):
        c = shapes[0]
        start, end = np.array(c.start), np.array(c.end)
        length = float(np.linalg.norm(end - start))
        return Bulk(np.pi * c.radius**2 * (length + 4 / 3 * c.radius),
                    vector_of((start + end) / 2))
    hull = ConvexHull(np.concatenate([_points(shape) for shape in shapes]))
    inside = hull.points[hull.vertices].mean(0)
    corners = hull.points[hull.simplices] - inside
    volumes = np.abs(np.linalg.det(corners)) / 6
    centre = inside + (volumes[:, None] * corners.mean(1) * 3 / 4).sum(0) / volumes.sum()
    return Bulk(float(volumes.sum()), vector_of(centre))


def _skin(shapes: tuple[Shape, ...], most: int) -> tuple[Capsule, ...]:
    capsules = [shape for shape in shapes if isinstance(shape, Capsule)]
    if len(capsules) == len(shapes) and len(shapes) <= most:
        return tuple(capsules)
    turn = _frame(shapes)
    return _row(turn, *_extent(shapes, turn), most)


def _frame(shapes: tuple[Shape, ...]) -> np.ndarray:
    """Axes of the largest shape as columns (3, 3): a box's own, or a capsule's axis and two across.

    A ball has no axis: those from each place of the link's shapes to each other are tried. What
    is open, also between shapes as large, is chosen so that the box about all is the smallest.
    """
    sizes = [round(bulk_of((shape,)).volume_m3, _DIGITS_M3) for shape in shapes]
    places = np.array([at for s in shapes for at in (
        [s.place[:3]] if isinstance(s, Box) else [s.start, s.end])])
    axes = [axis for s in shapes if isinstance(s, Box) for axis in matrix_of(s.place)[:3, :3].T]
    turns: list[np.ndarray] = []
    for shape, size in zip(shapes, sizes, strict=True):
        if size < max(sizes):
            continue
        if isinstance(shape, Box):
            turns.append(matrix_of(shape.place)[:3, :3])
            continue
        start = np.array(shape.start)
        ways = [(start, shape.end - start)]
        if np.linalg.norm(ways[0][1]) < _APART_M:
            ways = [(a, b - a) for a, b in combinations(places[:_PLACES], 2)]
            ways += [(start, axis) for axis in axes]
        turns += [turn for at, way in ways if np.linalg.norm(way) > _APART_M
                  for turn in _turns(at, way, places, axes)]

    def volume_m3(turn: np.ndarray) -> float:
        low, high = _extent(shapes, turn)
        return round(float((high - low).prod()), _DIGITS_M3)

    return min(turns, key=volume_m3, default=np.eye(3))


def _turns(at: np.ndarray, way: np.ndarray, places: np.ndarray, axes: list[np.ndarray]
           ) -> list[np.ndarray]:
    """Frames (3, 3) whose first column points along a way, their second to the place that is
    farthest off it, or along one of `axes`; where there is none all is round about the way."""
    first = way / np.linalg.norm(way)
    off = places - at
    off = off - np.outer(off @ first, first)
    farthest = off[np.linalg.norm(off, axis=1).round(_DIGITS).argmax()]
    sides = [axis - (axis @ first) * first for axis in (farthest, *axes)]
    sides = [side for side in sides if np.linalg.norm(side) > _APART_M] or [
        np.cross(first, np.eye(3)[np.abs(first).argmin()])]
    units = [side / np.linalg.norm(side) for side in sides]
    return [np.stack([first, unit, np.cross(first, unit)], 1) for unit in units]


def _extent(shapes: tuple[Shape, ...], turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far shapes reach along the columns of `turn`, lowest and highest (3,)."""
    low, high = [], []
    for shape in shapes:
        along = (_corners(shape) if isinstance(shape, Box) else
                 np.array([shape.start, shape.end])) @ turn
        radius = 0.0 if isinstance(shape, Box) else shape.radius
        low.append(along.min(0) - radius)
        high.append(along.max(0) + radius)
    return np.min(low, 0), np.max(high, 0)


def _row(turn: np.ndarray, low: np.ndarray, high: np.ndarray, most: int
         ) -> tuple[Capsule, ...]:
    """Parallel capsules inside a box, along its longest side, as thick as its shortest."""
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, _THINNEST_M)
    thin, wide, long = np.argsort(half.round(_DIGITS), kind="stable")
    radius = float(half[thin])
    out = half[wide] - radius
    count = min(most, 1 + round(float(2 * out / (_APART * radius))))
    found = []
    for across in np.linspace(-out, out, count) if count > 1 else [0.0]:
        ends = np.tile(middle, (2, 1))
        ends[:, wide] += across
        ends[:, long] += np.array([-1, 1]) * (half[long] - radius)
        start, end = ((float(x), float(y), float(z)) for x, y, z in ends @ turn.T)
        if half[long] - radius < _BALL_M:  # a cube's ends differ by rounding alone
            end = start
        found.append(Capsule(start, end, radius))
    return tuple(found)


def _corners(box: Box) -> np.ndarray:
    matrix = matrix_of(box.place)
    signs = np.array(list(product((-0.5, 0.5), repeat=3)))
    return signs * np.array(box.size) @ matrix[:3, :3].T + matrix[:3, 3]


def _points(shape: Shape) -> np.ndarray:
    """Points whose hull is about a shape: a box's corners, a capsule's surface."""
    if isinstance(shape, Box):
        return _corners(shape)
    n = np.arange(_DIRECTIONS) + 0.5
    z, turn = 1.0 - 2.0 * n / _DIRECTIONS, np.pi * (3.0 - np.sqrt(5.0)) * n  # a spiral
    across = np.sqrt(1.0 - z**2)
    directions = np.stack([across * np.cos(turn), across * np.sin(turn), z], 1)
    ends = np.array([shape.start, shape.end])
    return (ends[:, None] + shape.radius * directions).reshape(-1, 3)


def palmar_directions(moved_m: np.ndarray, along_m: np.ndarray) -> np.ndarray:
    """Directions that capsules close towards, across their axes: unit vectors (capsule, 3).

    `moved_m` (capsule, 3) is how each moves in a closing and `along_m` (capsule, 3) its axis, both
    in its link's frame; where it does not move the direction is any across the axis.
    """
    size = np.linalg.norm(along_m, axis=1, keepdims=True)
    unit = np.divide(along_m, size, out=np.zeros_like(along_m), where=size > 0.0)
    across = moved_m - (moved_m * unit).sum(1, keepdims=True) * unit
    still = np.linalg.norm(across, axis=1) < 1e-9
    other = np.cross(unit, np.eye(3)[np.abs(unit).argmin(1)])
    other = np.where(np.linalg.norm(other, axis=1, keepdims=True) > 0.0, other, [1.0, 0.0, 0.0])
    across = np.where(still[:, None], other, across)
    return across / np.linalg.norm(across, axis=1, keepdims=True)
