# type: ignore  # Warp functions, which type checkers cannot follow
"""Scores in kernels: distances between surface elements, shares of points inside."""


import warp as wp

from sweeps.episode.scores_lanes import (
    NEAR,
    PATCH,
    PROJECTIONS,
    SETTLED,
    distances_in_lanes,
    signed_distances_in_lanes,
)
from warpgrasp.core.dtypes import ONE, TWO, ZERO, real, transform, vec2, vec3, vec4
from warpgrasp.core.lanes import LANES
from warpgrasp.geometry.sdf_superquadric import (
    SuperquadricShape,
    deformed_gradient,
    sdf_superquadric_bound_grad,
    straighten,
    superquadric_gauge,
    superquadric_is_plain,
    taper_and_bend,
)

_PATCH = wp.constant(PATCH)
_LANES = wp.constant(LANES)
_MOST = wp.constant(24)
_Patches = wp.types.vector(length=24, dtype=int)
_FAR = wp.constant(wp.float32(1e6))  # [m]
_ROUNDING = wp.constant(real(2e-7))  # of a place in single precision [m]
_NO_LENGTH = wp.constant(real(1e-18))
_PROJECTIONS = wp.constant(PROJECTIONS)
_NEAR = wp.constant(real(NEAR))
_SETTLED = wp.constant(real(SETTLED))


@wp.func
def _ball_of(ball: wp.array2d[wp.float32], g: int):
    """Middle and radius."""
    return vec4(real(ball[0, g]), real(ball[1, g]), real(ball[2, g]), real(ball[3, g]))


@wp.func
def _nearest_ball(p: vec3, ball: wp.array2d[wp.float32]):
    """Which ball's middle is nearest."""
    nearest = int(0)
    least = real(1e18)
    for g in range(ball.shape[1]):
        b = _ball_of(ball, g)
        square = wp.length_sq(p - vec3(b[0], b[1], b[2]))
        if square < least:
            least = square
            nearest = int(g)
    return nearest


@wp.func
def _rounded(aside: real, height: real, bend: real):
    """Distance to a circle of curvature `bend` from a place so far aside and above its tangent."""
    along = ONE + bend * height
    if along <= ZERO:
        return wp.sqrt(aside + height * height)
    return wp.abs((TWO * height + bend * (height * height + aside))
                  / (ONE + wp.sqrt(along * along + bend * bend * aside)))


@wp.func
def _from_place(p: vec3, place: vec3, outward: vec3, s: SuperquadricShape):
    """The distance of a point to the surface, from a place on it near the nearest one and the
    normal there, in the body's frame.

    The next place is where the point lies over the tangent plane, moved onto the surface along its
    ray from the centre. The last step aside goes along a circle, whose curvature is that between
    the last two places: as if the surface went on so.
    """
    before = place
    n_before = outward
    foot = p - outward * wp.dot(p - place, outward)
    best = wp.length(p - place)
    for _ in range(_PROJECTIONS):
        q = straighten(foot, s)
        g = superquadric_gauge(q.point, s.size, s.e1, s.e2)
        if not wp.isfinite(g[3]) or g[3] <= ZERO:
            return best
        on = taper_and_bend(q.point / g[3], s)
        v = p - on
        away = wp.length(v)
        slope = deformed_gradient(g, on, straighten(on, s), s)
        n = vec3(slope[0], slope[1], slope[2])
        length = wp.length(n)
        if not wp.isfinite(length) or length <= ZERO:
            return wp.min(best, away)
        n = n / length
        best = wp.min(best, away)
        height = wp.dot(v, n)
        aside = v - n * height
        left = wp.dot(aside, aside)
        if left < _SETTLED * away:
            return best
        step = on - before
        gone = wp.dot(step, step)
        if left < _NEAR * gone:
            bend = wp.dot(n - n_before, step) / gone
            if bend >= ZERO and bend * bend * left < _NEAR:
                return wp.min(best, _rounded(left, height, bend))
        before = on
        n_before = n
        foot = on + aside
    return best


@wp.kernel(enable_backward=False)
def _element_distance_kernel(
    first: int,
    lanes: wp.bool,
    # Recovered surface in:
    element: wp.array2d[vec3],
    normal: wp.array2d[vec3],
    rough: wp.array2d[wp.vec3f],
    ball: wp.array3d[wp.float32],
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    # True surface in, points group by group:
    point: wp.array[vec3],
    begin: wp.array[int],
    end: wp.array[int],
    # Distance out:
    distance: wp.array2d[real],
):
    """Distances to the body, each found from its nearest element.

    `ball` holds the middles of a patch of elements; a group of points, `begin` to `end`, shares the
    choice of patches that may be nearest. `shape` and `pose` are the body's.
    """
    w, i = wp.tid()
    w += first
    if lanes and superquadric_is_plain(shape[w], pose[w]):
        distances_in_lanes(w, begin[i], end[i], element, normal, rough, ball, shape[w], pose[w],
                           point,
distance)
        return
    middle = point[(begin[i] + end[i]) / 2]
    wide = real(0.0)
    for k in range(begin[i], end[i]):
        wide = wp.max(wide, wp.length(point[k] - middle))
    found = int(0)
    nearest = _nearest_ball(middle, ball[w])
    best = real(1e18)
    for m in range(nearest * _PATCH, wp.min((nearest + 1) * _PATCH, element.shape[1])):
        best = wp.min(best, wp.length_sq(middle - element[w, m]))
    bound = wp.sqrt(best) + TWO * wide
    near = _Patches()
    count = int(0)
    for g in range(ball.shape[2]):
        b = _ball_of(ball[w], g)
        reach = bound + b[3]
        if wp.length_sq(middle - vec3(b[0], b[1], b[2])) < reach * reach:
            if count < _MOST:
                near[count] = g
            count += 1
    shared = count <= _MOST
    if not shared:
        count = ball.shape[2]
    to_body = wp.transform_inverse(pose[w])
    found = nearest * _PATCH
    for k in range(begin[i], end[i]):
        p = point[k]
        best = wp.length_sq(p - element[w, found])
        away = wp.sqrt(best)
        for c in range(count):
            g = int(c)
            if shared:
                g = near[c]
            b = _ball_of(ball[w], g)
            reach = away + b[3]
            if wp.length_sq(p - vec3(b[0], b[1], b[2])) < reach * reach:
                for m in range(g * _PATCH, wp.min((g + 1) * _PATCH, element.shape[1])):
                    square = wp.length_sq(p - element[w, m])
                    if square < best:
                        best = square
                        found = int(m)
                away = wp.sqrt(best)
        distance[w, k] = _from_place(
            wp.transform_point(to_body, p), wp.transform_point(to_body, element[w, found]),
            wp.transform_vector(to_body, normal[w, found]), shape[w])


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
    # In single precision out:
    rough: wp.array2d[wp.vec3f],
    ball: wp.array3d[wp.float32],
):
    """A ball (centre, radius) around every patch of elements that follow each other; those of no
    elements, which fill the last lanes, are far."""
    w, g = wp.tid()
    w += first
    ball[w, 0, g] = _FAR
    ball[w, 3, g] = wp.float32(0.0)
    stop = wp.min((g + 1) * _PATCH, element.shape[1])
    if g * _PATCH >= stop:
        return
    centre = vec3(ZERO, ZERO, ZERO)
    for k in range(g * _PATCH, stop):
        centre += element[w, k]
        rough[w, k] = wp.vec3f(element[w, k])
    centre = centre / real(stop - g * _PATCH)
    reach = real(0.0)
    for k in range(g * _PATCH, stop):
        reach = wp.max(reach, wp.length(element[w, k] - centre))
    for axis in range(3):
        ball[w, axis, g] = wp.float32(centre[axis])
    ball[w, 3, g] = wp.float32(reach + _ROUNDING)


@wp.func
def _signed_distance(p: vec3, s: SuperquadricShape, enough: real):
    """To first order; far inside, of an unknown size beyond `enough`: a body of exponents up to 1
    holds the ellipsoid in its box, and no power is taken there."""
    if wp.max(s.e1, s.e2) <= ONE:
        q = straighten(p, s).point
        r = wp.length(wp.cw_div(q, s.size))
        least = wp.min(s.size[0], wp.min(s.size[1], s.size[2]))
        least *= ONE - wp.max(wp.abs(s.kx), wp.abs(s.ky))
        if (ONE - r) * least > enough:
            return -enough
    return sdf_superquadric_bound_grad(p, s)[3]


@wp.kernel(enable_backward=False)
def _signed_distance_kernel(
    first: int,
    lanes: wp.bool,
    # Recovered body in:
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    # Points in, in which order, and beyond which distance none need be known:
    point: wp.array[vec3],
    order: wp.array[int],
    enough: real,
    # Signed distance to first order out:
    distance: wp.array2d[real],
):
    """Of `LANES` points that follow each other in that order."""
    w, i = wp.tid()
    w += first
    s = shape[w]
    begin = i * _LANES
    end = wp.min(begin + _LANES, point.shape[0])
    if lanes and superquadric_is_plain(s, pose[w]):
        signed_distances_in_lanes(w, begin, end, s, pose[w], point, order, enough, distance)
        return
    to_body = wp.transform_inverse(pose[w])
    for k in range(begin, end):
        p = wp.transform_point(to_body, point[order[k]])
        distance[w, order[k]] = _signed_distance(p, s, enough)
