"""Scores of recovered bodies against true ones, for a whole batch.

Points of the true surface and volume come from `warpgrasp.body_sample`, points of the recovered
surface from `fit.superquadric_shape` or `fit.revolution_shape`. Distances from the recovered
surface to the true one are those of `sweeps.true_surface`, exact for bodies of one primitive; those
from the true surface to the recovered body are to the nearest of some hundred surface elements,
each a disc of the element's own area. All is done in the true body's frame, so that its points are
the same in every world.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp

from fit.revolution_shape import (
    RevolutionBody,
    revolution_inside,
    revolution_surface,
    revolution_volume,
)
from fit.rotation import matrix_of_quaternion, quaternion_of_matrix
from fit.rows import joined, rows_of, with_rows
from fit.superquadric_shape import Superquadric, SuperquadricLike, superquadric_volume
from strategies.body_query import bodies_on
from strategies.recovered import Recovered, Shape, same_bodies
from sweeps.surface_elements import TILE, surface_elements
from sweeps.true_surface import distance_to_surface
from warpgrasp.body import Body
from warpgrasp.body_sample import BodySample, sample_body
from warpgrasp.launch import launch
from warpgrasp.real import ONE, ZERO, real, transform, vec3, vec4
from warpgrasp.sdf_superquadric import SuperquadricShape, straighten, superquadric_gauge

SURFACE_POINTS = 512
ELEMENTS = 864
INSIDE_POINTS = 2048
COVERAGE_M = 0.005
WORLDS_AT_ONCE = 512
"""More at once leave the caches: 16,384 took 2 GiB and a third more time each."""

PATCH = TILE[0] * TILE[1]
"""Elements that follow each other lie side by side: so many share a ball."""
_PATCH = wp.constant(PATCH)
_ROUNDING = wp.constant(real(1e-9))


@dataclass(frozen=True)
class Scores:
    """Scores, shape (world,) each."""

    chamfer_m: np.ndarray
    """Mean of the two mean distances, surface to surface."""
    hausdorff95_m: np.ndarray
    """Larger of the two 95 % quantiles of distance, surface to surface."""
    iou: np.ndarray
    """Volume of the intersection over that of the union."""
    volume_ratio: np.ndarray
    """Recovered volume over true volume."""
    coverage: np.ndarray
    """Share of the true surface within 5 mm of the recovered one."""


@wp.kernel(enable_backward=False)
def _element_distance_kernel(
    first: int,
    # Recovered surface in:
    element: wp.array2d[vec3],
    normal: wp.array2d[vec3],
    radius: wp.array2d[real],
    ball: wp.array2d[vec4],
    # True surface in:
    point: wp.array[vec3],
    # Distance out:
    distance: wp.array2d[real],
):
    """Distance to the nearest element; `ball` holds a patch of elements, discs and all."""
    w, i = wp.tid()
    w += first
    p = point[i]
    nearest = int(0)
    least = real(1e18)
    for g in range(ball.shape[1]):
        b = ball[w, g]
        v = p - vec3(b[0], b[1], b[2])
        if wp.dot(v, v) < least:
            least = wp.dot(v, v)
            nearest = int(g)
    best = real(1e9)
    for turn in range(ball.shape[1] + 1):
        g = turn - 1
        if turn == 0:
            g = nearest
        b = ball[w, g]
        v = p - vec3(b[0], b[1], b[2])
        reach = best + b[3]
        if wp.dot(v, v) < reach * reach and (turn == 0 or g != nearest):
            for k in range(g * _PATCH, wp.min((g + 1) * _PATCH, element.shape[1])):
                v = p - element[w, k]
                square = wp.dot(v, v)
                reach = best + radius[w, k]
                if square < reach * reach:
                    height = wp.dot(v, normal[w, k])
                    aside = wp.max(
                        wp.sqrt(wp.max(square - height * height, ZERO)) - radius[w, k], ZERO)
                    best = wp.min(best, wp.sqrt(height * height + aside * aside))
    distance[w, i] = best


@wp.kernel(enable_backward=False)
def _ball_kernel(
    first: int,
    # Recovered surface in:
    element: wp.array2d[vec3],
    radius: wp.array2d[real],
    # Balls out:
    ball: wp.array2d[vec4],
):
    """A ball (centre, radius) around every patch of elements that follow each other."""
    w, g = wp.tid()
    w += first
    stop = wp.min((g + 1) * _PATCH, element.shape[1])
    centre = vec3(ZERO, ZERO, ZERO)
    for k in range(g * _PATCH, stop):
        centre += element[w, k]
    centre = centre / real(stop - g * _PATCH)
    reach = real(0.0)
    for k in range(g * _PATCH, stop):
        reach = wp.max(reach, wp.length(element[w, k] - centre) + radius[w, k])
    ball[w, g] = vec4(centre[0], centre[1], centre[2], reach)


@wp.func
def _is_inside(p: vec3, s: SuperquadricShape):
    """Whether the gauge is below one; without its powers where simpler bodies tell.

    A superquadric lies in its box, and holds the box's ellipsoid where its exponents are up to 1.
    """
    q = straighten(p, s).point
    u = wp.abs(q[0]) / s.size[0]
    v = wp.abs(q[1]) / s.size[1]
    w = wp.abs(q[2]) / s.size[2]
    if wp.max(wp.max(u, v), w) > ONE + _ROUNDING:
        return int(0)
    if wp.max(s.e1, s.e2) <= ONE and u * u + v * v + w * w < ONE - _ROUNDING:
        return int(1)
    if superquadric_gauge(q, s.size, s.e1, s.e2)[3] < ONE:
        return int(1)
    return int(0)


@wp.kernel(enable_backward=False)
def _inside_kernel(
    first: int,
    # Recovered body in:
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    # True volume in:
    point: wp.array[vec3],
    # Whether a point is in both out:
    inside: wp.array2d[int],
):
    w, i = wp.tid()
    w += first
    inside[w, i] = _is_inside(
        wp.transform_point(wp.transform_inverse(pose[w]), point[i]), shape[w])


@dataclass(frozen=True)
class _Surface:
    """Recovered surfaces in the true body's frame, their volumes, and what they share with it."""

    element: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    volume: np.ndarray
    common: np.ndarray
    """Share of the true body's inside points that lie inside, (world,)."""


def score_superquadrics(
    fits: SuperquadricLike, body: Body, body_pose: np.ndarray, *, device: str = "cpu"
) -> Scores:
    """Score one superquadric a world against `body`, which stands at `body_pose` (world, 7)."""
    sample = sample_body(body, surface=SURFACE_POINTS, inside=INSIDE_POINTS)
    return _in_turn(lambda rows: _score(
        _superquadrics(rows_of(fits, rows), sample, body_pose[rows], device),
        body, sample, device), len(body_pose))


def score_recovered(
    recovered: Recovered, body: Body, body_pose: np.ndarray, *, device: str = "cpu"
) -> Scores:
    """Score what each world ended with, superquadric or contour, against `body`."""
    sample = sample_body(body, surface=SURFACE_POINTS, inside=INSIDE_POINTS)
    return _in_turn(lambda rows: _score(
        _recovered(rows_of(recovered, rows), sample, body_pose[rows], device),
        body, sample, device), len(body_pose))


def _in_turn(score: Callable[[slice], Scores], worlds: int) -> Scores:
    """The scores of all worlds, so many of them after the other."""
    return joined([score(slice(first, first + WORLDS_AT_ONCE))
                   for first in range(0, max(worlds, 1), WORLDS_AT_ONCE)])


def _recovered(
    recovered: Recovered, sample: BodySample, body_pose: np.ndarray, device: str
) -> _Surface:
    round_ = (recovered.shape == Shape.REVOLUTION) & (recovered.revolution is not None)
    turned, others = np.flatnonzero(round_), np.flatnonzero(~round_)
    parts: list[_Surface] = []
    if len(others) or not len(turned):
        parts.append(_superquadrics(rows_of(recovered.superquadric, others), sample,
                                    body_pose[others], device))
    if len(turned) and recovered.revolution is not None:
        parts.append(_revolutions(recovered.revolution[turned], sample, body_pose[turned]))
    order = np.argsort(np.concatenate([others, turned]), kind="stable")
    return rows_of(joined(parts), order)


def scores_again(
    recovered: Recovered, before: Recovered, scores: Scores, body: Body, body_pose: np.ndarray, *,
    device: str = "cpu"
) -> Scores:
    """`score_recovered`, given the `scores` of the bodies `before`: only what changed is scored."""
    rows = np.flatnonzero(~same_bodies(recovered, before))
    if len(rows) == 0:
        return scores
    part = score_recovered(rows_of(recovered, rows), body, body_pose[rows], device=device)
    return with_rows(scores, rows, part)


def _superquadrics(
    fits: SuperquadricLike, sample: BodySample, body_pose: np.ndarray, device: str
) -> _Surface:
    turn = matrix_of_quaternion(body_pose[:, 3:])
    seen = Superquadric(
        fits.size_m, fits.exponents,
        ((fits.position_m - body_pose[:, :3])[:, None] @ turn)[:, 0],
        quaternion_of_matrix(turn.transpose(0, 2, 1) @ matrix_of_quaternion(fits.quaternion_xyzw)),
        fits.taper, fits.bend)
    return _Surface(*surface_elements(seen, ELEMENTS, device=device), superquadric_volume(fits),
                    _share_inside(seen, sample.inside_m, device))


def _revolutions(
    bodies: RevolutionBody, sample: BodySample, body_pose: np.ndarray
) -> _Surface:
    turn, place = matrix_of_quaternion(body_pose[:, 3:]), body_pose[:, None, :3]
    element, normal, area = revolution_surface(bodies)
    inside = revolution_inside(bodies, sample.inside_m @ turn.transpose(0, 2, 1) + place)
    return _Surface((element - place) @ turn, normal @ turn, area, revolution_volume(bodies),
                    inside.mean(1))


def _score(found: _Surface, body: Body, sample: BodySample, device: str) -> Scores:
    to_fit = _distance_to_elements(sample.surface_m, found, device)
    to_body = distance_to_surface(body, found.element, device=device)
    share = found.area / found.area.sum(1, keepdims=True)
    mean_to_body = (to_body * share).sum(1)
    chamfer = 0.5 * (to_fit.mean(1) + mean_to_body)
    hausdorff = np.maximum(np.quantile(to_fit, 0.95, axis=1), _quantile(to_body, share, 0.95))
    common = sample.volume_m3 * found.common
    return Scores(
        chamfer_m=chamfer,
        hausdorff95_m=hausdorff,
        iou=common / (found.volume + sample.volume_m3 - common),
        volume_ratio=found.volume / sample.volume_m3,
        coverage=(to_fit <= COVERAGE_M).mean(1),
    )


def _quantile(values: np.ndarray, share: np.ndarray, q: float) -> np.ndarray:
    """Weighted quantile of each row."""
    order = np.argsort(values, axis=1, kind="stable")
    cumulative = np.cumsum(np.take_along_axis(share, order, 1), axis=1)
    at = np.minimum((cumulative < q).sum(1), values.shape[1] - 1)
    return np.take_along_axis(values, order, 1)[np.arange(len(values)), at]


def _distance_to_elements(points: np.ndarray, found: _Surface, device: str) -> np.ndarray:
    """From each point (point, 3) to each world's surface, (world, point)."""
    worlds, elements = found.area.shape
    patches = -(-elements // PATCH)
    surface = {
        "element": wp.array(found.element, dtype=vec3, device=device),
        "radius": wp.array(np.sqrt(found.area / np.pi), dtype=real, device=device)}
    shapes = {"element": "world element", "radius": "world element", "ball": "world patch"}
    ball = wp.empty((worlds, patches), dtype=vec4, device=device)
    launch(_ball_kernel, {"world": worlds, "patch": patches}, shapes,
           {**surface, "ball": ball}, device=device)
    out = wp.empty((worlds, len(points)), dtype=real, device=device)
    launch(_element_distance_kernel, {"world": worlds, "point": len(points)}, {
        **shapes, "normal": "world element", "point": "point", "distance": "world point"}, {
        **surface, "ball": ball, "normal": wp.array(found.normal, dtype=vec3, device=device),
        "point": wp.array(points, dtype=vec3, device=device), "distance": out}, device=device)
    return out.numpy().copy()


def _share_inside(fits: SuperquadricLike, points: np.ndarray, device: str) -> np.ndarray:
    """Share of points (point, 3) that lie in each world's body, (world,)."""
    shape, pose = bodies_on(fits, device)
    out = wp.empty((len(fits.size_m), len(points)), dtype=int, device=device)
    launch(_inside_kernel, {"world": len(fits.size_m), "point": len(points)}, {
        "shape": "world", "pose": "world", "point": "point", "inside": "world point"}, {
        "shape": shape, "pose": pose,
        "point": wp.array(points, dtype=vec3, device=device), "inside": out}, device=device)
    return out.numpy().mean(1)
