# type: ignore  # Warp functions, which type checkers cannot follow
"""Where the fingers of a hand would first meet a believed superquadric, in kernels.

A hand is capsules: of its fingers' links at every command, of its palm, and of its wrist
(`SweptLink`). Free motion alone: a finger follows its commands until a link touches body or table,
and rests there. Steps are skipped while a bound of the distance exceeds what the link can have
moved (conservative advancement), from coarse to fine: the box around the body first, whose distance
costs no powers, then places along the link against the body itself.
"""

import warp as wp

from strategies.foresight.capsule_lanes import (
    COARSE_M,
    PLACES,
    capsule_distance_in_lanes,
    nearest_share_in_lanes,
)
from warpgrasp.core.dtypes import (
    HALF,
    ONE,
    ZERO,
    greater,
    lesser,
    real,
    struct,
    transform,
    vec2,
    vec3,
    vec4,
)
from warpgrasp.geometry.sdf_superquadric import (
    SuperquadricShape,
    sdf_superquadric_bound_grad,
    superquadric_is_plain,
)
from warpgrasp.mechanism.arm_motion_kernel import RETREAT_M

wp.set_module_options({"max_unroll": 1})
_NAN = wp.constant(real(float("nan")))
_FAR = wp.constant(real(1e3))  # [m]
_RETREAT = wp.constant(real(RETREAT_M))
_STRAIGHT = wp.constant(real(1e-6))  # curvatures below are no bend [1/m]
_PLACES = wp.constant(PLACES)
_COARSE = wp.constant(real(COARSE_M))
_SHORTEST = wp.constant(real(1e-3))  # way marched at once on an approach [m]
_MARCHES = wp.constant(int(RETREAT_M / 1e-3) + 2)
_GRAZING = wp.constant(real(0.4))  # of its motion, against what it meets: less slips past [est]


@struct
class SweptLink:
    """A capsule's axis at a step of a closing path that touches nothing, in its finger's frame [m].

    `steps` is the number of steps per metre at its fastest from here on [1/m].
    """

    start: vec3
    end: vec3
    steps: real


@wp.func
def _box_distance(p: vec3, s: SuperquadricShape):
    """Distance to the box around a tapered body, negative within; no bound of a bent one."""
    x = wp.abs(p[0]) - s.size[0] * (ONE + wp.abs(s.kx))
    y = wp.abs(p[1]) - s.size[1] * (ONE + wp.abs(s.ky))
    z = wp.abs(p[2]) - s.size[2]
    if s.bend > _STRAIGHT:
        return -_FAR
    within = lesser(greater(x, greater(y, z)), ZERO)
    return within + wp.length(vec3(greater(x, ZERO), greater(y, ZERO), greater(z, ZERO)))


@wp.func
def _foot(p: vec3, s: SuperquadricShape):
    """The place of the body's surface that a place outside it leads to, and how far that is: as
    far as the formula says along its gradient, which falls short, and from there once more."""
    grad = sdf_superquadric_bound_grad(p, s)
    n = vec3(grad[0], grad[1], grad[2])
    if grad[3] <= ZERO:
        foot = p - n * grad[3]
        return vec4(foot[0], foot[1], foot[2], grad[3])
    half_way = p - n * grad[3]
    rest = sdf_superquadric_bound_grad(half_way, s)
    foot = half_way - vec3(rest[0], rest[1], rest[2]) * rest[3]
    return vec4(foot[0], foot[1], foot[2], wp.length(foot - p))


@wp.func
def _place(a: vec3, b: vec3, k: int):
    """Place number `k` along a segment."""
    return a + (b - a) * (real(k) / real(_PLACES - 1))


@wp.func
def _capsule_distance(s: SuperquadricShape, lanes: bool, a: vec3, b: vec3, radius: real,
                      enough: real):
    """About the least distance of a capsule from the body; a bound of it above `enough`, or
    `_COARSE`."""
    half = wp.length(b - a) * HALF
    far = _box_distance((a + b) * HALF, s) - half - radius
    if far > lesser(enough, _COARSE):
        return far
    if lanes:
        return capsule_distance_in_lanes(s, a, b, radius, enough)
    first = int(0)
    far = _FAR
    for k in range(_PLACES):
        bound = _box_distance(_place(a, b, k), s)
        if bound < far:
            far = bound
            first = int(k)
    far -= radius
    if far > enough:
        return far
    far -= half / real(_PLACES - 1)
    if far > _COARSE:
        return far
    # Both fall short: the greater is the better bound. The place that is nearest to the box is
    # likely the nearest to the body.
    p = _place(a, b, first)
    least = greater(sdf_superquadric_bound_grad(p, s)[3], _box_distance(p, s))
    nearest = int(first)
    for k in range(_PLACES):
        p = _place(a, b, k)
        outside = _box_distance(p, s)
        if k != first and outside < least:
            bound = greater(sdf_superquadric_bound_grad(p, s)[3], outside)
            if bound < least:
                least = bound
                nearest = int(k)
    if least > radius:
        return least - radius
    return _foot(_place(a, b, nearest), s)[3] - radius


@wp.func
def _nearest_share(s: SuperquadricShape, lanes: bool, a: vec3, b: vec3):
    """Where along a segment the body is nearest, from 0 to 1: the lowest of some places, moved to
    the foot of the parabola through it and its neighbours."""
    if lanes:
        return nearest_share_in_lanes(s, a, b)
    spacing = ONE / real(_PLACES - 1)
    best = int(0)
    least = _FAR
    for k in range(_PLACES):
        d = sdf_superquadric_bound_grad(a + (b - a) * (spacing * real(k)), s)[3]
        if d < least:
            least = d
            best = int(k)
    t = spacing * real(best)
    if best > 0 and best < _PLACES - 1:
        before = sdf_superquadric_bound_grad(a + (b - a) * (t - spacing), s)[3]
        after = sdf_superquadric_bound_grad(a + (b - a) * (t + spacing), s)[3]
        bend = before + after - least - least
        if bend > ZERO:
            t += spacing * HALF * (before - after) / bend
    return t


@wp.func
def _comes(s: SuperquadricShape, lanes: bool, a: vec3, b: vec3, radius: real, height: vec2,
           way: vec3, sinks: real, whole: real, scale: real):
    """Whether a capsule comes clear of body and table to where its axis is from `a` to `b` in the
    body's frame, at `height` over the table; `whole` is how far it comes along `way`, of which it
    loses `sinks` of height. Looked at from its end back: there it is likeliest to strike."""
    back = ZERO
    for _ in range(_MARCHES):
        table = lesser(height[0], height[1]) + sinks * back - radius
        off = way * back
        clear = lesser(table, _capsule_distance(s, lanes, a - off, b - off, radius, table))
        if clear < ZERO:
            return False
        if back >= whole:
            return True
        back = lesser(back + greater(clear * scale, _SHORTEST), whole)
    return True


@wp.kernel(enable_backward=False)
def approach_kernel(
    first: int,
    has_lanes: wp.bool,
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    wanted: wp.array2d[wp.bool],
    hand_pose: wp.array2d[transform],
    base: wp.array[transform],
    links: wp.array4d[SweptLink],
    link_count: wp.array[int],
    radius: wp.array2d[real],
    bar: wp.array2d[vec3],
    bar_radius: wp.array[real],
    free: wp.array3d[wp.bool],
):
    """Whether the open hand comes to a pose, each closing's open hand in turn."""
    w, p, g = wp.tid()
    w += first
    free[w, p, g] = False
    if not wanted[w, p]:
        return
    s = shape[w]
    lanes = has_lanes and superquadric_is_plain(s, pose[w])
    at = hand_pose[w, p]
    to_body = wp.transform_inverse(pose[w])
    z = wp.transform_vector(at, vec3(ZERO, ZERO, ONE))
    way = wp.transform_vector(to_body, z)
    scale = wp.where(greater(wp.abs(s.kx), wp.abs(s.ky)) + s.bend > ZERO, HALF, ONE)
    whole = ZERO
    if g == 0:
        whole = _RETREAT
    for i in range(bar.shape[0]):
        a = wp.transform_point(at, bar[i, 0])
        b = wp.transform_point(at, bar[i, 1])
        if not _comes(s, lanes, wp.transform_point(to_body, a), wp.transform_point(to_body, b),
                      bar_radius[i], vec2(a[2], b[2]), way, -z[2], whole, scale):
            return
    for finger in range(link_count.shape[0]):
        there = wp.transform_multiply(at, base[finger])
        for link in range(link_count[finger]):
            a = wp.transform_point(there, links[g, finger, link, 0].start)
            b = wp.transform_point(there, links[g, finger, link, 0].end)
            if not _comes(s, lanes, wp.transform_point(to_body, a), wp.transform_point(to_body, b),
                          radius[finger, link], vec2(a[2], b[2]), way, -z[2], whole, scale):
                return
    free[w, p, g] = True


@wp.kernel(enable_backward=False)
def first_touch_kernel(
    first: int,
    has_lanes: wp.bool,
    shape: wp.array[SuperquadricShape],
    pose: wp.array[transform],
    free: wp.array3d[wp.bool],
    hand_pose: wp.array2d[transform],
    base: wp.array[transform],
    links: wp.array4d[SweptLink],
    link_count: wp.array[int],
    radius: wp.array2d[real],
    feels: wp.array2d[wp.bool],
    command_count: wp.array[int],
    point: wp.array4d[vec3],
):
    """Where a finger first meets the body, base frame.

    NaN where it meets nothing, or the table first, or with a link that feels nothing, or grazes the
    body: one that hardly moves against the surface slips past it.
    """
    w, probe, g, finger = wp.tid()
    w += first
    point[w, probe, g, finger] = vec3(_NAN, _NAN, _NAN)
    if not free[w, probe, 0] or not free[w, probe, g]:
        return
    s = shape[w]
    lanes = has_lanes and superquadric_is_plain(s, pose[w])
    own = wp.transform_multiply(hand_pose[w, probe], base[finger])
    to_body = wp.transform_multiply(wp.transform_inverse(pose[w]), own)
    scale = wp.where(greater(wp.abs(s.kx), wp.abs(s.ky)) + s.bend > ZERO, HALF, ONE)
    end = command_count[g]
    touched = int(-1)
    for inward in range(link_count[finger]):
        link = link_count[finger] - 1 - inward
        thick = radius[finger, link]
        step = int(0)
        while step < end:
            at = links[g, finger, link, step]
            table = lesser(wp.transform_point(own, at.start)[2],
                           wp.transform_point(own, at.end)[2]) - thick
            body = _capsule_distance(
                s, lanes, wp.transform_point(to_body, at.start),
                wp.transform_point(to_body, at.end), thick, greater(table, ZERO))
            clear = lesser(table, body)
            if clear <= ZERO:
                end = int(step)
                touched = wp.where(body <= table, link, int(-1))
            step += 1 + int(lesser(greater(clear, ZERO) * scale * at.steps, real(end)))
    if touched < 0 or not feels[finger, wp.max(touched, 0)]:
        return
    at = links[g, finger, touched, end]
    a = wp.transform_point(to_body, at.start)
    b = wp.transform_point(to_body, at.end)
    share = _nearest_share(s, lanes, a, b)
    p = a + (b - a) * share
    grad = sdf_superquadric_bound_grad(p, s)
    n = vec3(grad[0], grad[1], grad[2])
    after = links[g, finger, touched, wp.min(end + 1, command_count[g] - 1)]
    way = wp.transform_vector(to_body, after.start - at.start
                              + (after.end - at.end - after.start + at.start) * share)
    if wp.dot(way, n) > -_GRAZING * wp.length(way):
        return
    foot = _foot(p, s)
    point[w, probe, g, finger] = wp.transform_point(pose[w], vec3(foot[0], foot[1], foot[2]))
