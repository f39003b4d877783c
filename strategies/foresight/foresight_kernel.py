# type: ignore  # Warp functions, which type checkers cannot follow
"""Where the fingers of a hand would first meet a believed superquadric, in kernels.

A hand is capsules: of its fingers' links at every command, of its palm, and of its wrist
(`SweptLink`). Free motion alone: a finger follows its commands until a link touches body or table,
and rests there. Steps are skipped while a bound of the distance exceeds what the link can have
moved (conservative advancement), from coarse to fine: the box around the body first, whose distance
costs no powers, then places along the link against the body itself. What is nearest also tells a
plane between link and body. Straight superquadrics are convex: the plane parts the two until the
link has come to it, and only there the body is asked again.
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
    TINY,
    ZERO,
    greater,
    lesser,
    real,
    struct,
    transform,
    vec2,
    vec3,
    vec4,
    vec5,
)
from warpgrasp.geometry.sdf_primitive import sign_of
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
def _past_box(p: vec3, s: SuperquadricShape):
    """How far past each pair of faces of the box around a tapered body."""
    return vec3(wp.abs(p[0]) - s.size[0] * (ONE + wp.abs(s.kx)),
                wp.abs(p[1]) - s.size[1] * (ONE + wp.abs(s.ky)), wp.abs(p[2]) - s.size[2])


@wp.func
def _box_distance(p: vec3, s: SuperquadricShape):
    """Distance to the box around a tapered body, negative within; no bound of a bent one."""
    past = _past_box(p, s)
    if s.bend > _STRAIGHT:
        return -_FAR
    within = lesser(greater(past[0], greater(past[1], past[2])), ZERO)
    return within + wp.length(vec3(greater(past[0], ZERO), greater(past[1], ZERO),
                                   greater(past[2], ZERO)))


@wp.func
def _parted_by_box(p: vec3, s: SuperquadricShape, clear: real):
    """The plane between a place outside the box and the box, and `clear`."""
    past = _past_box(p, s)
    out = vec3(greater(past[0], ZERO) * sign_of(p[0]), greater(past[1], ZERO) * sign_of(p[1]),
               greater(past[2], ZERO) * sign_of(p[2]))
    far = greater(wp.length(out), TINY)
    n = out / far
    return vec5(n[0], n[1], n[2], wp.dot(n, p) - far, clear)


@wp.func
def _parted(p: vec3, bound: vec4, s: SuperquadricShape, clear: real):
    """The plane between a place and the body that the body's `bound` there tells, and `clear`.

    No plane (one that nothing is above) of a bent body. One that tapers is not quite convex, and
    its formula no bound from afar: its plane is higher by a share of the distance [est]."""
    n = vec3(bound[0], bound[1], bound[2])
    tapers = greater(wp.abs(s.kx), wp.abs(s.ky))
    level = wp.dot(n, p) - bound[3] + tapers * greater(clear, ZERO)
    if s.bend > _STRAIGHT:
        level = _FAR
    return vec5(n[0], n[1], n[2], level, clear)


@wp.func
def _half_way(p: vec3, bound: vec4):
    """As far towards the body as the formula says."""
    return p - vec3(bound[0], bound[1], bound[2]) * bound[3]


@wp.func
def _foot(p: vec3, bound: vec4, half_way: vec3, rest: vec4):
    """The place of the body's surface that a place leads to, and how far that is: as far as the
    formula says along its gradient, which falls short, and from there once more."""
    if bound[3] <= ZERO:
        return vec4(half_way[0], half_way[1], half_way[2], bound[3])
    foot = _half_way(half_way, rest)
    return vec4(foot[0], foot[1], foot[2], wp.length(foot - p))


@wp.func
def _place(a: vec3, b: vec3, k: int):
    """Place number `k` along a segment."""
    return a + (b - a) * (real(k) / real(_PLACES - 1))


@wp.func
def _capsule_distance(s: SuperquadricShape, lanes: bool, a: vec3, b: vec3, radius: real,
                      enough: real):
    """A plane between a capsule's axis and the body, and about the least distance of the capsule
    from the body; a bound of it above `enough`, or `_COARSE`."""
    half = wp.length(b - a) * HALF
    far = _box_distance((a + b) * HALF, s) - half - radius
    if far > lesser(enough, _COARSE):
        return _parted_by_box((a + b) * HALF, s, far)
    if lanes:
        return capsule_distance_in_lanes(s, a, b, radius, enough)
    first = int(0)
    far = _FAR
    for k in range(_PLACES):
        outside = _box_distance(_place(a, b, k), s)
        if outside < far:
            far = outside
            first = int(k)
    far -= radius
    if far > enough:
        return _parted_by_box(_place(a, b, first), s, far)
    far -= half / real(_PLACES - 1)
    if far > _COARSE:
        return _parted_by_box(_place(a, b, first), s, far)
    # Both fall short: the greater is the better bound. The place that is nearest to the box is
    # likely the nearest to the body.
    nearest = _place(a, b, first)
    bound = sdf_superquadric_bound_grad(nearest, s)
    least = greater(bound[3], _box_distance(nearest, s))
    for k in range(_PLACES):
        p = _place(a, b, k)
        outside = _box_distance(p, s)
        if k != first and outside < least:
            there = sdf_superquadric_bound_grad(p, s)
            if greater(there[3], outside) < least:
                least = greater(there[3], outside)
                nearest = p
                bound = there
    if least > radius:
        if least > bound[3]:
            return _parted_by_box(nearest, s, least - radius)
        return _parted(nearest, bound, s, least - radius)
    half_way = _half_way(nearest, bound)
    rest = sdf_superquadric_bound_grad(half_way, s)
    return _parted(half_way, rest, s, _foot(nearest, bound, half_way, rest)[3] - radius)


@wp.func
def _above(plane: vec5, a: vec3, b: vec3):
    """How far a segment is above a plane."""
    n = vec3(plane[0], plane[1], plane[2])
    return lesser(wp.dot(n, a), wp.dot(n, b)) - plane[3]


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
def _in_frame_of(from_there: transform, plane: vec5):
    """A plane as it is in the frame that `from_there` leads from."""
    n = vec3(plane[0], plane[1], plane[2])
    there = wp.quat_rotate_inv(wp.transform_get_rotation(from_there), n)
    return vec5(there[0], there[1], there[2],
                plane[3] - wp.dot(n, wp.transform_get_translation(from_there)), plane[4])


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
        plane = _capsule_distance(s, lanes, a - off, b - off, radius, table)
        clear = lesser(table, plane[4])
        if clear < ZERO:
            return False
        if back >= whole:
            return True
        # As far back as it stays above the plane, and above the table.
        until = whole
        approach = wp.dot(vec3(plane[0], plane[1], plane[2]), way)
        above = _above(plane, a - off, b - off) - radius
        if above <= ZERO:
            until = back
        elif approach > ZERO:
            until = lesser(until, back + above / approach)
        if sinks < ZERO:
            until = lesser(until, back - table / sinks)
        back = lesser(greater(back + greater(clear * scale, _SHORTEST), until), whole)
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
            plane = _capsule_distance(
                s, lanes, wp.transform_point(to_body, at.start),
                wp.transform_point(to_body, at.end), thick, greater(table, ZERO))
            clear = lesser(table, plane[4])
            if clear <= ZERO:
                end = int(step)
                touched = wp.where(plane[4] <= table, link, int(-1))
            here = _in_frame_of(to_body, plane)
            while clear > ZERO and step < end:
                step += 1 + int(lesser(clear * scale * at.steps, real(end)))
                at = links[g, finger, link, wp.min(step, end - 1)]
                table = lesser(wp.transform_point(own, at.start)[2],
                               wp.transform_point(own, at.end)[2])
                clear = lesser(table, _above(here, at.start, at.end)) - thick
    if touched < 0 or not feels[finger, wp.max(touched, 0)]:
        return
    at = links[g, finger, touched, end]
    a = wp.transform_point(to_body, at.start)
    b = wp.transform_point(to_body, at.end)
    share = _nearest_share(s, lanes, a, b)
    p = a + (b - a) * share
    bound = sdf_superquadric_bound_grad(p, s)
    n = vec3(bound[0], bound[1], bound[2])
    after = links[g, finger, touched, wp.min(end + 1, command_count[g] - 1)]
    way = wp.transform_vector(to_body, after.start - at.start
                              + (after.end - at.end - after.start + at.start) * share)
    if wp.dot(way, n) > -_GRAZING * wp.length(way):
        return
    half_way = _half_way(p, bound)
    foot = _foot(p, bound, half_way, sdf_superquadric_bound_grad(half_way, s))
    point[w, probe, g, finger] = wp.transform_point(pose[w], vec3(foot[0], foot[1], foot[2]))
