"""How an object may lie on the table: its stable poses, by trimesh (Goldberg et al. 1999).

An object that is dropped comes to rest on a face of its convex hull over which its centre of mass
lies. How likely each pose is is reckoned on a coarse hull, on which what is round has a stable pose
on every facet: poses that lie side by side and are as high are one. From there the body rolls to
where it rests on the hull of all its samples.
"""

from dataclasses import replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from warpgrasp.geometry.body import Body, BodyError
from warpgrasp.geometry.body_sampling import (
    KeyedBody,
    body_lowered,
    keyed_body,
    sample_body,
)

LEAST_PROBABILITY = 0.01
"""Poses that are rarer are no choice."""
_DIRECTIONS = 400
"""Of the coarse hull: ten times as many take trimesh ten times as long."""
_BESIDE_RAD = 0.7
_AS_HIGH = 0.02
"""Of the height of the centre of mass."""


class StablePose(NamedTuple):
    """One way to lie."""

    quaternion_xyzw: tuple[float, float, float, float]
    """Turns the body so, the shortest way; lowering it onto the table is left."""
    probability: float
    """That it comes to rest so, dropped at random."""


def stable_poses(body: Body) -> tuple[StablePose, ...]:
    """The poses in which `body` may lie, the likeliest first; its mass is spread evenly.

    Raises BodyError where the body has (almost) no volume.
    """
    return _stable_poses(keyed_body(body))


def body_in_stable_pose(body: Body, number: int) -> Body:
    """`body` turned into its stable pose of that number, 1 the likeliest, and set on the table.

    Raises BodyError for a number that it has not.
    """
    poses = stable_poses(body)
    if not 1 <= number <= len(poses):
        raise BodyError(f"stable_pose = {number}: there are {len(poses)} stable poses, 1 the "
                        "likeliest")
    turn = Rotation.from_quat(poses[number - 1].quaternion_xyzw)
    parts = tuple(replace(part, place=(
        *(float(v) for v in turn.apply(part.place[:3])),
        *(float(v) for v in (turn * Rotation.from_quat(part.place[3:])).as_quat())))
        for part in body.parts)
    corners = np.stack(np.meshgrid(*zip(body.low_m, body.high_m, strict=True)), -1).reshape(-1, 3)
    turned = turn.apply(corners)
    low, high = turned.min(0), turned.max(0)
    return body_lowered(replace(body, parts=parts, low_m=tuple(map(float, low)),
                                high_m=tuple(map(float, high))))


@lru_cache(maxsize=64)
def _stable_poses(keyed: KeyedBody) -> tuple[StablePose, ...]:
    import trimesh  # heavy, and only turned objects need it

    sample = sample_body(keyed.body, surface=None)
    middle = sample.inside_m.mean(0)
    outermost = np.unique((sample.surface_m @ _directions().T).argmax(0))
    hull = trimesh.convex.convex_hull(sample.surface_m[outermost])
    turns, chance = trimesh.poses.compute_stable_poses(hull, center_mass=middle, seed=0)
    up, height = turns[:, 2, :3], turns[:, 2, :3] @ middle + turns[:, 2, 3]
    beside = up @ up.T > np.cos(_BESIDE_RAD)
    beside &= np.abs(height[:, None] - height) < _AS_HIGH * height
    from scipy.sparse.csgraph import connected_components

    count, group = connected_components(beside, directed=False)
    total = np.bincount(group, chance, count) / chance.sum()
    fine = ConvexHull(sample.surface_m)
    rests: list[np.ndarray] = []
    probability: list[float] = []
    for one in np.lexsort((np.arange(count), -np.round(total, 6))):
        likeliest = np.flatnonzero(group == one)[chance[group == one].argmax()]
        rest = _rolled(fine, middle, up[likeliest])
        same = [number for number, other in enumerate(rests) if rest @ other > np.cos(_BESIDE_RAD)
                and abs(_height(fine, middle, rest) - _height(fine, middle, other))
                < _AS_HIGH * _height(fine, middle, other)]
        if same:  # it has rolled on to where another group rests
            probability[same[0]] += total[one]
        else:
            rests.append(rest)
            probability.append(total[one])
    return tuple(StablePose(_turned_up(rests[one]), float(probability[one]))
                 for one in np.argsort(-np.round(probability, 6), kind="stable")
                 if probability[one] >= LEAST_PROBABILITY)


def _height(hull: ConvexHull, middle: np.ndarray, up: np.ndarray) -> float:
    """Of the centre of mass above the table, with `up` upwards."""
    return float(((middle - hull.points[hull.vertices]) @ up).max())


def _rolled(hull: ConvexHull, middle: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Which way is up, a unit vector (3,), where a body that lies nearly with `up` upwards has
    rolled over edges of its hull until its centre of mass `middle` is above the facet it lies on.
    """
    outward = hull.equations[:, :3]
    height = -(hull.equations[:, :3] @ middle + hull.equations[:, 3])
    facet = int((outward @ -up).argmax())
    while True:
        below = middle + outward[facet] * height[facet]
        corners = hull.points[hull.simplices[facet]]
        # Of each corner: how far `below` is from it beyond the opposite edge, towards neighbours.
        edges = np.roll(corners, -2, 0) - np.roll(corners, -1, 0)
        out = np.cross(edges, outward[facet])
        out *= np.sign(((np.roll(corners, -1, 0) - corners) * out).sum(1))[:, None]
        beyond = ((below - np.roll(corners, -1, 0)) * out).sum(1) / np.linalg.norm(out, axis=1)
        onward = int(hull.neighbors[facet, beyond.argmax()])
        if beyond.max() <= 0.0 or height[onward] >= height[facet]:
            return -outward[facet]
        facet = onward


def _directions() -> np.ndarray:
    """Unit vectors, evenly spread: a Fibonacci lattice, (direction, 3)."""
    k = np.arange(_DIRECTIONS) + 0.5
    z, angle = 1.0 - 2.0 * k / _DIRECTIONS, np.pi * (1.0 + 5.0**0.5) * k
    r = np.sqrt(1.0 - z**2)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], 1)


def _turned_up(up: np.ndarray) -> tuple[float, float, float, float]:
    """The shortest turn of a unit vector (3,) to the z axis."""
    axis = np.array([up[1], -up[0], 0.0])  # up x z
    norm = np.linalg.norm(axis)
    if norm < 1e-9:
        axis, norm = np.array([1.0, 0.0, 0.0]), 1.0
    angle = np.arctan2(np.hypot(up[0], up[1]), up[2])
    x, y, z, w = Rotation.from_rotvec(axis / norm * angle).as_quat()
    return float(x), float(y), float(z), float(w)
