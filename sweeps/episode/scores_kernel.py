# type: ignore  # Warp functions, which type checkers cannot follow
"""Scores in kernels: distances between surface elements, shares of points inside."""


import warp as wp

from sweeps.episode.surface_elements import TILE
from warpgrasp.core.dtypes import ONE, ZERO, real, transform, vec2, vec3, vec4
from warpgrasp.geometry.sdf_superquadric import (
    SuperquadricShape,
    deformed_gradient,
    sdf_superquadric_bound_grad,
    straighten,
    superquadric_gauge,
    taper_and_bend,
)

PATCH = TILE[0] * TILE[1]
"""Elements that follow each other lie side by side: so many share a ball."""
_PATCH = wp.constant(PATCH)
_ROUNDING = wp.constant(real(1e-9))
_NO_LENGTH = wp.constant(real(1e-18))
_PROJECTIONS = wp.constant(4)
_SETTLED = wp.constant(real(4e-6))  # [m]: a step aside then gains some two micrometres


@wp.func
def _nearer(p: vec3, foot: vec3, nearest: real, s: SuperquadricShape):
    """The distance of a point to the surface, from a place `foot` near the nearest one, in the
    body's frame; at most `nearest`, which is the distance of a place on it.

    The foot is moved onto the surface along its ray from the centre. Its next place is where the
    point lies over the tangent plane there. Every place on the surface bounds the distance.
    """
    best = nearest
    for _ in range(_PROJECTIONS):
        q = straighten(foot, s)
        g = superquadric_gauge(q.point, s.size, s.e1, s.e2)
        if not wp.isfinite(g[3]) or g[3] <= ZERO:
            return best
        on = taper_and_bend(q.point / g[3], s)
        v = p - on
        best = wp.min(best, wp.length(v))
        outward = deformed_gradient(g, on, straighten(on, s), s)
        n = vec3(outward[0], outward[1], outward[2])
        square = wp.dot(n, n)
        if not wp.isfinite(square) or square <= ZERO:
            return best
        aside = v - n * (wp.dot(v, n) / square)
        if wp.dot(aside, aside) < _SETTLED * best:
            return best
        foot = on + aside
    return best


@wp.kernel(enable_backward=False)
def _element_distance_kernel(
    first: int,
    # Recovered surface in:
    element: wp.array2d[vec3],
    normal: wp.array2d[vec3],
    radius: wp.array2d[real],
    ball: wp.array2d[vec4],
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    # True surface in:
    point: wp.array[vec3],
    # Distance out:
    distance: wp.array2d[real],
):
    """Distance to the body, found from its nearest element.

    `ball` holds a patch of elements, discs and all; `shape` and `pose` are the body's.
    """
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
    found = int(0)
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
                    away = wp.sqrt(height * height + aside * aside)
                    if away < best:
                        best = away
                        found = int(k)
    v = p - element[w, found]
    across = v - normal[w, found] * wp.dot(v, normal[w, found])
    foot = element[w, found] + across * wp.min(
        radius[w, found] / wp.max(wp.length(across), _ROUNDING), ONE)
    to_body = wp.transform_inverse(pose[w])
    distance[w, i] = _nearer(wp.transform_point(to_body, p), wp.transform_point(to_body, foot),
                             wp.length(v), shape[w])


@wp.kernel(enable_backward=False)
def _first_order_kernel(
    first: int,
    # Recovered body in:
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    # True surface in:
    point: wp.array[vec3],
    # Distance out:
    distance: wp.array2d[real],
):
    w, i = wp.tid()
    w += first
    there = wp.transform_point(wp.transform_inverse(pose[w]), point[i])
    distance[w, i] = wp.abs(sdf_superquadric_bound_grad(there, shape[w])[3])


@wp.kernel(enable_backward=False)
def _contour_distance_kernel(
    first: int,
    # Bodies of revolution in: the axis' lower end and direction, nodes (height, radius), closed:
    foot: wp.array[vec3],
    axis: wp.array[vec3],
    node: wp.array2d[vec2],
    # True surface in:
    point: wp.array[vec3],
    # Distance out:
    distance: wp.array2d[real],
):
    """Distance to the nearest piece of a contour, in the half plane of the point."""
    w, i = wp.tid()
    w += first
    arm = point[i] - foot[w]
    along = wp.dot(arm, axis[w])
    p = vec2(along, wp.length(arm - axis[w] * along))
    best = real(1e18)
    for k in range(node.shape[1] - 1):
        way = node[w, k + 1] - node[w, k]
        v = p - node[w, k]
        v -= way * wp.clamp(wp.dot(v, way) / wp.max(wp.dot(way, way), _NO_LENGTH), ZERO, ONE)
        best = wp.min(best, wp.dot(v, v))
    distance[w, i] = wp.sqrt(best)


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
    """Whether the gauge is below one; without powers where simpler bounds decide.

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
