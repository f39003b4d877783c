# type: ignore  # Warp functions, which type checkers cannot follow
"""Distances from points to recovered bodies, and normals, in kernels."""

import warp as wp

from warpgrasp.core.dtypes import ONE, ZERO, real, transform, vec2, vec3, vec4
from warpgrasp.core.lanes import LANES
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape
from warpgrasp.geometry.superquadric_gauges import gauges_at

_LANES = wp.constant(LANES)
_LEAST_SLOPE = wp.constant(real(1e-3))  # [1/m]
_LEAST_RADIUS = wp.constant(real(1e-3))  # scaled
_INFINITY = wp.constant(real(float("inf")))
_NO_LENGTH = wp.constant(real(1e-18))  # [m^2]: two nodes at one place


@wp.func
def _gauges(
    shape: SuperquadricShape, pose: transform, has_lanes: bool, point: wp.array2d[vec3],
    kept: wp.array2d[wp.bool], w: int, begin: int, end: int, gauge: wp.array2d[vec4]
):
    """Gauges at points `begin` to `end` of a world, where any is kept; whether one is."""
    some = bool(False)
    for i in range(begin, end):
        some = some or kept[w, i]
        gauge[w, i] = vec4(point[w, i][0], point[w, i][1], point[w, i][2], ZERO)
    if some:
        gauges_at(shape, pose, has_lanes, gauge, w, begin, end - begin)
    return some


@wp.kernel(enable_backward=False)
def _distance_kernel(
    first: int,
    has_lanes: wp.bool,
    # Bodies in:
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    # Points in:
    point: wp.array2d[vec3],
    kept: wp.array2d[wp.bool],
    # Distance out:
    gauge: wp.array2d[vec4],
    distance: wp.array2d[real],
    normal: wp.array2d[vec3],
):
    w, group = wp.tid()
    w += first
    begin = group * _LANES
    end = wp.min(begin + _LANES, point.shape[1])
    some = _gauges(shape[w], pose[w], has_lanes, point, kept, w, begin, end, gauge)
    for i in range(begin, end):
        distance[w, i] = ONE
        normal[w, i] = vec3(ZERO, ZERO, ZERO)
        if some and kept[w, i]:
            g = gauge[w, i]
            slope = wp.length(vec3(g[0], g[1], g[2]))
            away = (g[3] - ONE) / wp.max(slope, _LEAST_SLOPE)
            if wp.isfinite(away):
                distance[w, i] = away
                normal[w, i] = vec3(g[0], g[1], g[2]) / slope


@wp.kernel(enable_backward=False)
def _radial_kernel(
    first: int,
    has_lanes: wp.bool,
    # Bodies in:
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    # Points in:
    point: wp.array2d[vec3],
    kept: wp.array2d[wp.bool],
    # Distance out:
    gauge: wp.array2d[vec4],
    distance: wp.array2d[real],
):
    w, group = wp.tid()
    w += first
    begin = group * _LANES
    end = wp.min(begin + _LANES, point.shape[1])
    some = _gauges(shape[w], pose[w], has_lanes, point, kept, w, begin, end, gauge)
    for i in range(begin, end):
        distance[w, i] = _INFINITY
        if some and kept[w, i]:
            away = wp.length(point[w, i] - wp.transform_get_translation(pose[w]))
            radial = (ONE - ONE / wp.max(gauge[w, i][3], _LEAST_RADIUS)) * away
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
