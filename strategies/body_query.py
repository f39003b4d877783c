"""Recovered bodies asked at points, in kernels: how far it is to them, and which way."""

from typing import Any

import numpy as np
import warp as wp

from fit.revolution_shape import RevolutionBody
from fit.superquadric_shape import SuperquadricLike
from warpgrasp.launch import launch
from warpgrasp.real import ONE, ZERO, real, transform, vec2, vec3, vec4
from warpgrasp.sdf_superquadric import SuperquadricShape, superquadric_deformed_gauge

AHEAD_M = 1e-5
"""Step outwards whose slope a distance is divided by [m]."""
_LEAST_SLOPE = wp.constant(real(1e-3))  # [1/m]
_LEAST_RADIUS = wp.constant(real(1e-3))  # scaled
_INFINITY = wp.constant(real(float("inf")))
_NO_LENGTH = wp.constant(real(1e-18))  # [m^2]: two nodes at one place


@wp.func
def world_radius(p: vec3, shape: SuperquadricShape, pose: transform):
    """Gradient and value of the scaled radius at a point of the world."""
    g = superquadric_deformed_gauge(wp.transform_point(wp.transform_inverse(pose), p), shape)
    turned = wp.quat_rotate(wp.transform_get_rotation(pose), vec3(g[0], g[1], g[2]))
    return vec4(turned[0], turned[1], turned[2], g[3])


@wp.kernel(enable_backward=False)
def _distance_kernel(
    first: int,
    # Bodies in:
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    # Points in:
    point: wp.array2d[vec3],
    kept: wp.array2d[wp.bool],
    ahead: real,
    # Distance out:
    distance: wp.array2d[real],
    normal: wp.array2d[vec3],
):
    w, i = wp.tid()
    w += first
    distance[w, i] = ONE
    normal[w, i] = vec3(ZERO, ZERO, ZERO)
    if not kept[w, i]:
        return
    g = world_radius(point[w, i], shape[w], pose[w])
    slope = wp.length(vec3(g[0], g[1], g[2]))
    outwards = vec3(g[0], g[1], g[2]) / slope
    if ahead > ZERO:
        step = ahead * outwards
        slope = (world_radius(point[w, i] + step, shape[w], pose[w])[3] - g[3]) / ahead
    away = (g[3] - ONE) / wp.max(slope, _LEAST_SLOPE)
    if wp.isfinite(away):
        distance[w, i] = away
        normal[w, i] = outwards


@wp.kernel(enable_backward=False)
def _radial_kernel(
    first: int,
    # Bodies in:
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    # Points in:
    point: wp.array2d[vec3],
    kept: wp.array2d[wp.bool],
    # Distance out:
    distance: wp.array2d[real],
):
    w, i = wp.tid()
    w += first
    distance[w, i] = _INFINITY
    if kept[w, i]:
        radius = world_radius(point[w, i], shape[w], pose[w])[3]
        away = wp.length(point[w, i] - wp.transform_get_translation(pose[w]))
        radial = (ONE - ONE / wp.max(radius, _LEAST_RADIUS)) * away
        if wp.isfinite(radial):
            distance[w, i] = radial


@wp.func
def segment_distance(p: vec2, start: vec2, end: vec2):
    """Distance of a point to a segment."""
    way = end - start
    t = wp.clamp(wp.dot(p - start, way) / wp.max(wp.dot(way, way), _NO_LENGTH), ZERO, ONE)
    return wp.length(p - start - t * way)


@wp.kernel(enable_backward=False)
def _contour_kernel(
    first: int,
    # Bodies in:
    foot: wp.array[vec3],
    axis: wp.array[vec3],
    height: wp.array2d[real],
    radius: wp.array2d[real],
    # Points in:
    point: wp.array2d[vec3],
    kept: wp.array2d[wp.bool],
    # Distance out:
    distance: wp.array2d[real],
):
    w, i = wp.tid()
    w += first
    least = real(_INFINITY)
    if kept[w, i]:
        arm = point[w, i] - foot[w]
        along = wp.dot(arm, axis[w])
        p = vec2(along, wp.length(arm - along * axis[w]))
        last = vec2(ZERO, ZERO)
        nodes = int(0)
        for k in range(height.shape[1]):
            node = vec2(height[w, k], radius[w, k])
            if wp.isfinite(node[0]) and wp.isfinite(node[1]):
                if nodes == 0:
                    last = vec2(node[0], ZERO)  # the lower end is a disc
                least = wp.min(least, segment_distance(p, last, node))
                last = node
                nodes += 1
        if nodes > 0:
            least = wp.min(least, segment_distance(p, last, vec2(last[0], ZERO)))
    distance[w, i] = least


def surface_distances(
    body: SuperquadricLike, points_m: np.ndarray, kept: np.ndarray, *, ahead_m: float = AHEAD_M,
    device: str = "cpu"
) -> tuple[np.ndarray, np.ndarray]:
    """First-order signed distances [m] of points (world, point, 3), (world, point), and the unit
    normals outwards there, (world, point, 3).

    The scaled radius beyond one over its slope: over a step of `ahead_m` outwards, or where that is
    0 its gradient. 1 m and a normal of no length where not `kept` and where a body has no gradient.
    Raises ShapeError where shapes disagree.
    """
    distance = wp.empty(points_m.shape[:2], dtype=real, device=device)
    normal = wp.empty(points_m.shape[:2], dtype=vec3, device=device)
    _ask(_distance_kernel, body, points_m, kept,
         {"ahead": ahead_m, "distance": distance, "normal": normal}, device)
    return distance.numpy(), normal.numpy()


def radial_distances(
    body: SuperquadricLike, points_m: np.ndarray, kept: np.ndarray, *, device: str = "cpu"
) -> np.ndarray:
    """Signed distances [m] of points (world, point, 3) along the rays from the bodies' centres,
    (world, point); inf where not `kept`. Raises ShapeError where shapes disagree."""
    distance = wp.empty(points_m.shape[:2], dtype=real, device=device)
    _ask(_radial_kernel, body, points_m, kept, {"distance": distance}, device)
    return distance.numpy()


def contour_distances(
    body: RevolutionBody, points_m: np.ndarray, kept: np.ndarray, *, device: str = "cpu"
) -> np.ndarray:
    """Unsigned distances [m] of points (world, point, 3) to bodies of revolution, ends and all,
    (world, point); inf where not `kept` and where a body has no contour.

    Those of `fit.revolution_shape.revolution_distance`. Raises ShapeError where shapes disagree.
    """
    distance = wp.empty(points_m.shape[:2], dtype=real, device=device)
    launch(_contour_kernel, {"world": len(points_m), "point": points_m.shape[1]}, {
        **dict.fromkeys(("foot", "axis"), "world"),
        **dict.fromkeys(("height", "radius"), "world node"),
        **dict.fromkeys(("point", "kept", "distance"), "world point")}, {
        "foot": wp.array(body.foot_m, dtype=vec3, device=device),
        "axis": wp.array(body.axis, dtype=vec3, device=device),
        "height": wp.array(body.height_m, dtype=real, device=device),
        "radius": wp.array(body.radius_m, dtype=real, device=device),
        "point": wp.array(points_m, dtype=vec3, device=device),
        "kept": wp.array(kept, dtype=wp.bool, device=device), "distance": distance},
        device=device)
    return distance.numpy()


def _ask(
    kernel: wp.Kernel, body: SuperquadricLike, points_m: np.ndarray, kept: np.ndarray,
    others: dict[str, Any], device: str
) -> None:
    shape, pose = bodies_on(body, device)
    launch(kernel, {"world": len(points_m), "point": points_m.shape[1]}, {
        "shape": "world", "pose": "world",
        **dict.fromkeys(("point", "kept", "distance", "normal"), "world point")}, {
        "shape": shape, "pose": pose, "point": wp.array(points_m, dtype=vec3, device=device),
        "kept": wp.array(kept, dtype=wp.bool, device=device), **others}, device=device)


def bodies_on(body: SuperquadricLike, device: str) -> tuple[wp.array, wp.array]:
    """The kernels' shapes and poses of recovered bodies."""
    rows = np.zeros(len(body.size_m), dtype=SuperquadricShape.numpy_dtype())
    rows["size"] = body.size_m
    rows["e1"], rows["e2"] = body.exponents.T
    rows["kx"], rows["ky"] = body.taper.T
    rows["bend"], rows["bend_angle"] = body.bend.T
    pose = np.concatenate([body.position_m, body.quaternion_xyzw], axis=1)
    return (wp.array(rows, dtype=SuperquadricShape, device=device),
            wp.array(pose, dtype=transform, device=device))
