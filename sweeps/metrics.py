"""Scores of recovered bodies against true ones, for a whole batch.

Points of the true surface and volume come from `warpgrasp.body_sample`, points of the recovered
surface from `fit.superquadric_shape` or `fit.revolution_shape`. Distances from the recovered
surface to the true body are exact (its signed distance); those from the true surface to the
recovered body are to the nearest of some thousand surface elements, each a disc of the element's
own area.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import warp as wp
from scipy.spatial.transform import Rotation

from fit.revolution_shape import revolution_inside, revolution_surface, revolution_volume
from fit.superquadric_shape import SuperquadricLike, superquadric_volume
from strategies.body_query import bodies_on
from strategies.recovered import Recovered, Shape
from sweeps.surface_elements import surface_elements
from warpgrasp.body import Body, distance_to_bodies, scene_of
from warpgrasp.body_sample import sample_body
from warpgrasp.launch import launch
from warpgrasp.real import ONE, ZERO, real, transform, vec3, vec4
from warpgrasp.sdf_superquadric import SuperquadricShape, superquadric_deformed_gauge

SURFACE_POINTS = 512
ELEMENTS = 864
INSIDE_POINTS = 2048
COVERAGE_M = 0.005

PATCH = 12
"""Elements that follow each other lie side by side: so many share a ball."""
_PATCH = wp.constant(PATCH)


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
    point: wp.array2d[vec3],
    # Distance out:
    distance: wp.array2d[real],
):
    """Distance to the nearest element; `ball` holds a patch of elements, discs and all."""
    w, i = wp.tid()
    w += first
    p = point[w, i]
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


@wp.kernel(enable_backward=False)
def _inside_kernel(
    first: int,
    # Recovered body in:
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    # True volume in:
    point: wp.array2d[vec3],
    # Share out:
    inside: wp.array2d[int],
):
    w, i = wp.tid()
    w += first
    local = wp.transform_point(wp.transform_inverse(pose[w]), point[w, i])
    inside[w, i] = 0
    if superquadric_deformed_gauge(local, shape[w])[3] < ONE:
        inside[w, i] = 1


@dataclass(frozen=True)
class _Surface:
    """Recovered surfaces as elements, their volumes, and which points lie inside."""

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
    return _score(lambda inside: _superquadrics(fits, inside, device), body, body_pose, device)


def score_recovered(
    recovered: Recovered, body: Body, body_pose: np.ndarray, *, device: str = "cpu"
) -> Scores:
    """Score what each world ended with, superquadric or contour, against `body`."""
    turned = np.flatnonzero(recovered.shape == Shape.REVOLUTION)
    if len(turned) == 0 or recovered.revolution is None:
        return score_superquadrics(recovered.superquadric, body, body_pose, device=device)
    revolution = recovered.revolution[turned]

    def surface(inside: np.ndarray) -> _Surface:
        found = _superquadrics(recovered.superquadric, inside, device)
        element, normal, area = revolution_surface(revolution)
        for whole, part in ((found.element, element), (found.normal, normal), (found.area, area),
                            (found.volume, revolution_volume(revolution)),
                            (found.common, revolution_inside(revolution, inside[turned]).mean(1))):
            whole[turned] = part
        return found

    return _score(surface, body, body_pose, device)


def _superquadrics(fits: SuperquadricLike, inside: np.ndarray, device: str) -> _Surface:
    element, normal, area = surface_elements(fits, ELEMENTS, device=device)
    return _Surface(element, normal, area, superquadric_volume(fits),
                    _share_inside(fits, inside, device))


def _score(recovered: Callable[[np.ndarray], _Surface], body: Body, body_pose: np.ndarray,
           device: str) -> Scores:
    worlds = len(body_pose)
    sample = sample_body(body, surface=SURFACE_POINTS, inside=INSIDE_POINTS)
    turn = Rotation.from_quat(body_pose[:, 3:]).as_matrix()
    true_surface = sample.surface_m @ turn.transpose(0, 2, 1) + body_pose[:, None, :3]
    true_inside = sample.inside_m @ turn.transpose(0, 2, 1) + body_pose[:, None, :3]
    found = recovered(true_inside)
    to_fit = _distance_to_elements(true_surface, found.element, found.normal, found.area, device)
    in_body = (found.element - body_pose[:, None, :3]) @ turn
    signed, _ = distance_to_bodies(scene_of([body], device), np.zeros(1, int), in_body,
                                   device=device)
    to_body = np.abs(signed)
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
        coverage=(to_fit <= COVERAGE_M).mean(1) * np.ones(worlds),
    )


def _quantile(values: np.ndarray, share: np.ndarray, q: float) -> np.ndarray:
    """Weighted quantile of each row."""
    order = np.argsort(values, axis=1, kind="stable")
    cumulative = np.cumsum(np.take_along_axis(share, order, 1), axis=1)
    at = np.minimum((cumulative < q).sum(1), values.shape[1] - 1)
    return np.take_along_axis(values, order, 1)[np.arange(len(values)), at]


def _distance_to_elements(
    points: np.ndarray, element: np.ndarray, normal: np.ndarray, area: np.ndarray, device: str
) -> np.ndarray:
    worlds, elements = area.shape
    patches = -(-elements // PATCH)
    surface = {"element": wp.array(element, dtype=vec3, device=device),
               "radius": wp.array(np.sqrt(area / np.pi), dtype=real, device=device)}
    shapes = {"element": "world element", "radius": "world element", "ball": "world patch"}
    ball = wp.empty((worlds, patches), dtype=vec4, device=device)
    launch(_ball_kernel, {"world": worlds, "patch": patches}, shapes,
           {**surface, "ball": ball}, device=device)
    out = wp.empty(points.shape[:2], dtype=real, device=device)
    launch(_element_distance_kernel, {"world": worlds, "point": points.shape[1]}, {
        **shapes, "normal": "world element", "point": "world point", "distance": "world point"}, {
        **surface, "ball": ball, "normal": wp.array(normal, dtype=vec3, device=device),
        "point": wp.array(points, dtype=vec3, device=device), "distance": out}, device=device)
    return out.numpy().copy()


def _share_inside(fits: SuperquadricLike, points: np.ndarray, device: str) -> np.ndarray:
    shape, pose = bodies_on(fits, device)
    out = wp.empty(points.shape[:2], dtype=int, device=device)
    launch(_inside_kernel, {"world": len(points), "point": points.shape[1]}, {
        "shape": "world", "pose": "world", "point": "world point", "inside": "world point"}, {
        "shape": shape, "pose": pose,
        "point": wp.array(points, dtype=vec3, device=device), "inside": out}, device=device)
    return out.numpy().mean(1)
