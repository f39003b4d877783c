# type: ignore  # Warp functions, which type checkers cannot follow
"""A grid of beliefs about an object: what raises and lowers them, and what touches are worth.

A cell holds the probability that a ball of a link's radius, centred in it, touches the object. What
touches say raises `hit`; where links have been, `cap` bounds it. Worlds have grids of as many
cells; each has its own corner and cell.
"""

import warp as wp

from warpgrasp.core.dtypes import (
    HALF,
    ONE,
    ZERO,
    greater,
    lesser,
    real,
    transform,
    vec3,
)

wp.set_module_options({"max_unroll": 1})
_FREE_REACH = wp.constant(real(0.012))  # [m] from a free ball, a ball is unhindered no more
_TRUSTED = wp.constant(real(0.025))  # [m] how far a touch tells of the surface beside it
_SPREAD = wp.constant(real(0.003))  # [m] of the surface where it was touched
_TILT = wp.constant(real(0.35))  # growth of that a metre aside
_BARRED = wp.constant(real(0.75))
_LEAST = wp.constant(real(0.0005))
_SLACK = wp.constant(real(1.000001))  # what rounding may do to a bound that only saves time


@wp.func
def _cell(p: vec3, corner: vec3, size: real, n: wp.vec3i):
    """Number of the cell that holds `p`, -1 outside the grid."""
    i = int(wp.floor((p[0] - corner[0]) / size))
    j = int(wp.floor((p[1] - corner[1]) / size))
    k = int(wp.floor((p[2] - corner[2]) / size))
    if i < 0 or j < 0 or k < 0 or i >= n[0] or j >= n[1] or k >= n[2]:
        return int(-1)
    return (i * n[1] + j) * n[2] + k


@wp.func
def _low(x: real, corner: real, size: real):
    return wp.max(int(wp.floor((x - corner) / size)), int(0))


@wp.func
def _high(x: real, corner: real, size: real, n: int):
    return wp.min(int(wp.floor((x - corner) / size)), n - 1)


@wp.kernel(enable_backward=False)
def learn_kernel(
    first: int,
    corner: wp.array[vec3],
    cell: wp.array[real],
    n: wp.vec3i,
    radius: real,
    # What was felt since the last time:
    contact: wp.array2d[vec3],
    normal: wp.array2d[vec3],
    weight: wp.array2d[real],
    # Beliefs, in and out:
    hit: wp.array2d[wp.float32],
):
    """Contacts, where `weight` is positive: below the plane through each a ball touches, above it
    none does, the less surely the farther aside."""
    w = wp.tid() + first
    c, size = corner[w], cell[w]
    for t in range(contact.shape[1]):
        much = weight[w, t]
        if much > ZERO:
            p = contact[w, t]
            up = normal[w, t]
            reach = _TRUSTED * real(1.6)
            for i in range(_low(p[0] - reach, c[0], size),
                           _high(p[0] + reach, c[0], size, n[0]) + 1):
                for j in range(_low(p[1] - reach, c[1], size),
                               _high(p[1] + reach, c[1], size, n[1]) + 1):
                    for k in range(_low(p[2] - reach, c[2], size),
                                   _high(p[2] + reach, c[2], size, n[2]) + 1):
                        x = c + vec3(real(i) + HALF, real(j) + HALF, real(k) + HALF) * size
                        d = x - p
                        above = wp.dot(d, up)
                        aside = wp.length(d - up * above)
                        share = ONE / (ONE + wp.exp(
                            real(1.7) * (above - radius) / (_SPREAD + _TILT * aside)))
                        trust = much * wp.exp(-wp.length_sq(d) / (_TRUSTED * _TRUSTED))
                        at = (i * n[1] + j) * n[2] + k
                        old = real(hit[w, at])
                        hit[w, at] = wp.float32(old + trust * (share - old))


@wp.func
def _free(w: int, p: vec3, c: vec3, size: real, n: wp.vec3i, cap: wp.array2d[wp.float32]):
    """A ball of a link has been at `p`: what it bounds, it does the less the farther away."""
    # Roots are taken only where they may matter, which is seldom: balls lie close together.
    half = HALF * size
    most = (_FREE_REACH + half) * _SLACK
    for i in range(_low(p[0] - _FREE_REACH, c[0], size),
                   _high(p[0] + _FREE_REACH, c[0], size, n[0]) + 1):
        x = c[0] + (real(i) + HALF) * size - p[0]
        for j in range(_low(p[1] - _FREE_REACH, c[1], size),
                       _high(p[1] + _FREE_REACH, c[1], size, n[1]) + 1):
            y = c[1] + (real(j) + HALF) * size - p[1]
            level = x * x + y * y
            if level < most * most:
                for k in range(_low(p[2] - _FREE_REACH, c[2], size),
                               _high(p[2] + _FREE_REACH, c[2], size, n[2]) + 1):
                    z = c[2] + (real(k) + HALF) * size - p[2]
                    at = (i * n[1] + j) * n[2] + k
                    bound = (real(cap[w, at]) * _FREE_REACH + half) * _SLACK
                    if level + z * z < bound * bound:
                        # The middle of the cell that holds it is at most 0.87 of a cell away.
                        away = wp.sqrt(level + z * z) - half
                        far = wp.float32(greater(away, ZERO) / _FREE_REACH)
                        if far < cap[w, at]:
                            cap[w, at] = far


@wp.kernel(enable_backward=False)
def swept_kernel(
    first: int,
    corner: wp.array[vec3],
    cell: wp.array[real],
    n: wp.vec3i,
    open_ball: wp.array[vec3],
    swept_ball: wp.array3d[vec3],
    hand_pose: wp.array2d[transform],
    came: wp.array2d[wp.bool],
    until: wp.array3d[int],
    cap: wp.array2d[wp.float32],
):
    """What was free: the open hand at poses at which it `came` in, and there the fingers at the
    places of their paths before `until`."""
    w = wp.tid() + first
    c, size = corner[w], cell[w]
    for p in range(hand_pose.shape[1]):
        if came[w, p]:
            pose = hand_pose[w, p]
            for b in range(open_ball.shape[0]):
                _free(w, wp.transform_point(pose, open_ball[b]), c, size, n, cap)
            for f in range(swept_ball.shape[0]):
                for s in range(until[w, p, f]):
                    for b in range(swept_ball.shape[2]):
                        _free(w, wp.transform_point(pose, swept_ball[f, s, b]), c, size, n, cap)


@wp.func
def _believed(w: int, at: int, hit: wp.array2d[wp.float32], cap: wp.array2d[wp.float32]):
    return real(wp.min(hit[w, at], cap[w, at]))


@wp.kernel(enable_backward=False)
def barred_kernel(
    first: int,
    corner: wp.array[vec3],
    cell: wp.array[real],
    n: wp.vec3i,
    open_ball: wp.array[vec3],
    hand_pose: wp.array2d[transform],
    barred: wp.array2d[wp.bool],
    share: real,
    hit: wp.array2d[wp.float32],
    cap: wp.array2d[wp.float32],
):
    """Where the open hand struck something: its likeliest cells are occupied, and the others are
    likelier, as Bayes' rule has it: the more, the less it was foreseen. `share` is that of `Looks`.
    """
    w = wp.tid() + first
    c, size = corner[w], cell[w]
    for p in range(hand_pose.shape[1]):
        if barred[w, p]:
            most = _LEAST
            free = ONE
            for b in range(open_ball.shape[0]):
                at = _cell(wp.transform_point(hand_pose[w, p], open_ball[b]), c, size, n)
                if at >= 0:
                    now = _believed(w, at, hit, cap)
                    most = greater(most, now)
                    free = free * (ONE - now)
            foreseen = greater(ONE - wp.pow(free, share), most)
            factor = _BARRED / most
            if factor > ONE:
                # A cell is met by many balls, and raised once: until all are, it is negative.
                for b in range(open_ball.shape[0]):
                    at = _cell(wp.transform_point(hand_pose[w, p], open_ball[b]), c, size, n)
                    if at >= 0 and hit[w, at] >= 0.0:
                        now = _believed(w, at, hit, cap)
                        risen = lesser(now / foreseen, HALF * most)
                        if now > HALF * most:
                            risen = lesser(now * factor, _BARRED)
                        hit[w, at] = -wp.float32(risen)
                for b in range(open_ball.shape[0]):
                    at = _cell(wp.transform_point(hand_pose[w, p], open_ball[b]), c, size, n)
                    if at >= 0 and hit[w, at] < 0.0:
                        hit[w, at] = -hit[w, at]
                        cap[w, at] = wp.max(cap[w, at], hit[w, at])
