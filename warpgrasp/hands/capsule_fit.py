"""Capsules and boxes that stand for meshes and cylinders, with the error of each; and of a hand's
skin.

A capsule's surface is fitted to points of the mesh's convex hull by least squares of their
signed distances; what lies inside a mesh touches nothing. A plate is a box: the nearest capsule to
it is a ball about as wide as the plate. So is a bulky mesh, such as a palm, if a box is nearer.
"""

from dataclasses import replace

import numpy as np
import trimesh
from scipy.optimize import least_squares

from warpgrasp.hands.hand_frames import matrix_of, place_of
from warpgrasp.hands.hand_model import Box, Capsule, HandModel, Shape, vector_of
from warpgrasp.hands.touch_shapes import skins_of

_POINTS = 1500
_SEED = 0
"""Of the points on the hull: a fit is the same every time."""
_PLATE = 0.5
"""What is thinner, as a share of its second longest side, is a plate: so is a cylinder shorter than
its radius."""
_NEAR_M = 0.005
"""A capsule that is off by less at most is near enough [est]."""
_NEARER = 0.8
"""Times as far off as the capsule is, in the root mean square, a box is at most where it stands for
a mesh that is no plate [est]."""
_FLAT_M = 1e-6
"""Points that are nearer to a plane, or to a box that is a mesh's own, lie in it."""
_BALL_M = 1e-4
"""A capsule whose ends are nearer is fitted as a ball: no file need tell them apart."""
_SAID_M = 1e-4
"""Distances of a skin that are less are not said."""
_GRID = 13
"""Points along a side of a box, or along a capsule."""


def distance_to_capsule(points_m: np.ndarray, start: np.ndarray, end: np.ndarray,
                        radius_m: float) -> np.ndarray:
    """Signed distances of points (n, 3) from a capsule's surface [m]."""
    along = end - start
    length2 = float(along @ along)
    share = np.clip((points_m - start) @ along / length2, 0.0, 1.0) if length2 > 0.0 else 0.0
    nearest = start + np.multiply.outer(np.broadcast_to(share, len(points_m)), along)
    return np.linalg.norm(points_m - nearest, axis=1) - radius_m


def fit_shape(vertices_m: np.ndarray) -> Shape:
    """The capsule nearest to the convex hull of points (n, 3) [m], with its largest error.

    Of a hull that is less than half as thick as it is wide a box as thick and of as much volume;
    of one from which the capsule is off by 5 mm and more a box of its volume, if that is nearer.
    Raises ValueError for points in one plane.
    """
    off = vertices_m - vertices_m.mean(0)
    try:
        if np.abs(off @ np.linalg.svd(off, full_matrices=False)[2][-1]).max() < _FLAT_M:
            raise ValueError("no volume")  # Qhull would lift points off their plane by itself
        hull = trimesh.Trimesh(vertices_m, process=False).convex_hull
    except Exception as error:  # Qhull's own error, which SciPy keeps in a private module
        raise ValueError("its points lie in one plane") from error
    points = np.concatenate([hull.vertices, trimesh.sample.sample_surface(
        hull, _POINTS, seed=_SEED)[0]])
    to_box, sides = trimesh.bounds.oriented_bounds(hull)
    thin, wide, _ = np.sort(sides)
    frame, fill = np.linalg.inv(to_box), float(hull.volume / np.prod(sides))
    if thin < _PLATE * wide:
        return _box(points, frame, sides * np.where(sides > sides.min(), np.sqrt(fill), 1.0))
    capsule = _nearest_capsule(points)
    if capsule.fit_error_m > _NEAR_M:
        box = _box(points, frame, sides * np.cbrt(fill))
        off = distance_to_capsule(points, np.array(capsule.start), np.array(capsule.end),
                                  capsule.radius)
        if _rms(_off_box(points, box)) < _NEARER * _rms(off):
            return box
    return capsule


def _box(points: np.ndarray, frame: np.ndarray, size: np.ndarray) -> Box:
    """A box of some sides (3,) in the frame (4, 4) of the one about a hull."""
    box = Box(place_of(frame), vector_of(size))
    error = float(_off_box(points, box).max())
    return replace(box, fit_error_m=error * (error > _FLAT_M))


def _off_box(points: np.ndarray, box: Box) -> np.ndarray:
    """Distances of points (n, 3) from a box's surface [m]."""
    frame = matrix_of(box.place)
    own = np.abs((points - frame[:3, 3]) @ frame[:3, :3]) - np.array(box.size) / 2
    outside = np.linalg.norm(np.maximum(own, 0.0), axis=1)
    return np.where(outside > 0.0, outside, -own.max(1))


def _rms(off: np.ndarray) -> float:
    return float(np.sqrt(np.mean(off**2)))


def _nearest_capsule(points: np.ndarray) -> Capsule:
    middle = points.mean(0)
    axes = np.linalg.svd(points - middle, full_matrices=False)[2]
    best = min((_descend(points, middle, axis) for axis in axes), key=lambda found: found.cost)
    start, end, radius = best.x[:3], best.x[3:6], abs(float(best.x[6]))
    if np.linalg.norm(end - start) < _BALL_M:
        start = end = (start + end) / 2
    error = float(np.abs(distance_to_capsule(points, start, end, radius)).max())
    return Capsule(vector_of(start), vector_of(end), radius, error)


def capsule_of_cylinder(radius_m: float, length_m: float) -> tuple[float, float, float]:
    """Half the length between the ends of the nearest capsule along a cylinder's axis, its radius,
    and its largest error [m]; by least squares over the cylinder's surface."""
    u = (np.arange(_POINTS) + 0.5) / _POINTS
    side = np.stack([np.full(_POINTS, radius_m), u * length_m / 2], 1)
    end = np.stack([np.sqrt(u) * radius_m, np.full(_POINTS, length_m / 2)], 1)
    weight = np.sqrt(np.repeat([length_m, radius_m], _POINTS))  # by the areas of side and ends
    points = np.concatenate([side, end])  # off the axis and along it, of one half

    def off(x: np.ndarray) -> np.ndarray:
        beyond = np.maximum(points[:, 1] - x[0], 0.0)
        return np.hypot(points[:, 0], beyond) - x[1]

    found = least_squares(lambda x: weight * off(x), [max(length_m / 2 - radius_m, 0.0), radius_m],
                          x_scale=length_m + radius_m, bounds=(0.0, np.inf)).x.round(9)
    found[0] *= 2 * found[0] >= _BALL_M
    rim = np.array([[radius_m, 0.0], [radius_m, length_m / 2], [0.0, length_m / 2]])
    points = np.concatenate([points, rim])
    return float(found[0]), float(found[1]), float(np.abs(off(found)).max())


def _descend(points: np.ndarray, middle: np.ndarray, axis: np.ndarray):
    """The least squares from a capsule along `axis`."""
    along = (points - middle) @ axis
    across = np.linalg.norm(points - middle - np.outer(along, axis), axis=1)
    radius = float(np.median(across))
    low, high = along.min() + radius, along.max() - radius
    if low > high:
        low = high = (low + high) / 2
    guess = np.concatenate([middle + low * axis, middle + high * axis, [radius]])
    guess[3:6] += 1e-6 * axis  # a ball's axis has no direction to descend by
    scale = float(np.ptp(points, axis=0).max())
    return least_squares(lambda x: distance_to_capsule(points, x[:3], x[3:6], x[6]), guess,
                         x_scale=scale, max_nfev=200)


def skin_notes(model: HandModel) -> tuple[str, ...]:
    """How far the skin that a hand touches with lies off its shapes at most, and its widest slit, a
    sentence each."""
    off, slits = {}, {}
    for where, shapes, skin in skins_of(model):
        if shapes == skin:
            continue
        outside = [np.min([_distance(c, _surface(shape)) for c in skin], 0) for shape in shapes]
        beyond = [np.min([_distance(shape, _surface(c)) for shape in shapes], 0) for c in skin]
        off[where] = float(np.concatenate([*outside, *beyond]).max())
        if len(skin) > 1:  # all parallel, and as far apart
            start, along = np.array(skin[0].start), np.subtract(skin[0].end, skin[0].start)
            to = skin[1].start - start
            to = to - along * (along @ to) / max(along @ along, 1e-18)
            slits[where] = float(np.linalg.norm(to)) - 2.0 * skin[0].radius
    notes = []
    for found, said in ((off, "its skin of capsules lies off its shapes by at most {:.1f} mm, the "
                              "most of this hand"),
                        (slits, "between its capsules is a slit of {:.1f} mm, the widest of this "
                                "hand; what is narrower passes through")):
        where = max(found, key=lambda name: found[name], default="")
        if where and found[where] >= _SAID_M:
            notes.append(f"{where}: {said.format(1e3 * found[where])}")
    return tuple(notes)


def _surface(shape: Shape) -> np.ndarray:
    """Points on a shape (n, 3); of a capsule also some within."""
    share = np.linspace(0.0, 1.0, _GRID)
    if isinstance(shape, Box):
        unit = np.stack(np.meshgrid(share, share, share), -1).reshape(-1, 3) - 0.5
        frame = matrix_of(shape.place)
        return (unit[np.abs(unit).max(1) == 0.5] * shape.size) @ frame[:3, :3].T + frame[:3, 3]
    ball = trimesh.creation.icosphere(subdivisions=2, radius=shape.radius).vertices
    axis = np.add(shape.start, share[:, None] * np.subtract(shape.end, shape.start))
    return np.asarray(axis[:, None] + ball).reshape(-1, 3)


def _distance(shape: Shape, points_m: np.ndarray) -> np.ndarray:
    """Of points (n, 3) from a shape [m]; 0 or less within it."""
    if isinstance(shape, Capsule):
        return distance_to_capsule(points_m, np.array(shape.start), np.array(shape.end),
                                   shape.radius)
    frame = matrix_of(shape.place)
    own = (points_m - frame[:3, 3]) @ frame[:3, :3]
    return np.linalg.norm(np.maximum(np.abs(own) - np.array(shape.size) / 2, 0.0), axis=1)
