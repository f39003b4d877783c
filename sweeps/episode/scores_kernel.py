# type: ignore  # Warp functions, which type checkers cannot follow
"""Scores in kernels: distances between surface elements, shares of points inside."""


import warp as wp

from sweeps.episode.surface_elements import TILE
from warpgrasp.core.dtypes import ONE, ZERO, real, transform, vec3, vec4
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape, straighten, superquadric_gauge

PATCH = TILE[0] * TILE[1]
"""Elements that follow each other lie side by side: so many share a ball."""
_PATCH = wp.constant(PATCH)
_ROUNDING = wp.constant(real(1e-9))


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
