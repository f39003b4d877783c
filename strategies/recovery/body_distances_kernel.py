# type: ignore  # Warp functions, which type checkers cannot follow
"""Distances from points to recovered bodies, and normals, in kernels."""

import warp as wp

from strategies.contacts.placing_posterior import world_radius
from warpgrasp.core.dtypes import ONE, ZERO, real, transform, vec2, vec3
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape

_LEAST_SLOPE = wp.constant(real(1e-3))  # [1/m]
_LEAST_RADIUS = wp.constant(real(1e-3))  # scaled
_INFINITY = wp.constant(real(float("inf")))
_NO_LENGTH = wp.constant(real(1e-18))  # [m^2]: two nodes at one place


@wp.kernel(enable_backward=False)
def _distance_kernel(
    first: int,
    # Bodies in:
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    # Points in:
    point: wp.array2d[vec3],
    kept: wp.array2d[wp.bool],
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
