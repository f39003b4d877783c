# type: ignore  # Warp functions, which type checkers cannot follow
"""Serial arms in kernels: the flange of their joints, and the joints of a flange by iteration.

The inverse is the Levenberg-Marquardt method with a damping that falls with the error (Sugihara
2011, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method"), within the
joints' limits: a joint that is at a limit and pushed beyond it is held in that step. Where it does
not come to the pose from the joints given, it begins anew from postures spread over the limits.
From these a joint that turns nearly all the way round goes on at its other limit, once, and a
descent that gets no nearer is given up: most descents that fail have a joint at a limit.
"""

import warp as wp

from warpgrasp.core.dtypes import (
    HALF,
    ONE,
    TWO,
    ZERO,
    mat66,
    mat76,
    mat77,
    quat,
    real,
    struct,
    transform,
    vec3,
    vec6,
    vec7,
)
from warpgrasp.core.turns import sine_cosine

STARTS = 24
"""Postures from which a pose is looked for; the first are the joints given and home."""
MORE_STARTS = 60
"""Postures at most, where the pose is not come to from those."""
_STARTS = wp.constant(STARTS)
_MORE_STARTS = wp.constant(MORE_STARTS)
_ITERATIONS = wp.constant(48)
_LENGTH = wp.constant(real(0.25))  # [m] that weighs as much as a radian [est]
_NEAR = wp.constant(real(1e-8))  # [rad], and times `_LENGTH` [m]: the pose is reached
_DAMPING = wp.constant(real(1e-9))
_LONGEST = wp.constant(real(0.6))  # [rad] of any joint in a step
# A descent is given up where in so many iterations what is missed does not fall below this share.
_PATIENCE = wp.constant(8)
_NEARER = wp.constant(real(0.9))
_GAP = wp.constant(real(1.6))  # [rad] between a joint's limits the other way round at most, for
# it to go on at the other one [est]
_TURN = wp.constant(real(6.283185307179586))
_GOLDEN = wp.constant(real(1.0969815577985598))  # x^8 = x + 1: evenly spread points in seven
# dimensions (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences")


@struct
class SerialArm:
    """Joints in a row, each about the z axis of its frame."""

    joints: int
    """None: no serial arm."""
    frame: mat77
    """Each joint's place at angle zero in the frame before it: position [m], quaternion xyzw."""
    flange: transform
    """In the last joint's frame."""
    low: vec7
    high: vec7
    home: vec7
    reach: real
    """The flange is at most this far from the first joint's origin [m]."""


@wp.func
def _place(arm: SerialArm, j: int):
    return transform(
        vec3(arm.frame[j, 0], arm.frame[j, 1], arm.frame[j, 2]),
        quat(arm.frame[j, 3], arm.frame[j, 4], arm.frame[j, 5], arm.frame[j, 6]))


@wp.func
def _joint_at(arm: SerialArm, before: transform, j: int, angle: real):
    """The frame of joint `j` from that before it."""
    half = sine_cosine(angle * HALF)
    return wp.transform_multiply(before, wp.transform_multiply(
        _place(arm, j), transform(vec3(ZERO, ZERO, ZERO), quat(ZERO, ZERO, half[0], half[1]))))


@wp.func
def serial_flange(arm: SerialArm, q: vec7):
    """Pose of the flange in the base frame."""
    t = transform(vec3(ZERO, ZERO, ZERO), quat(ZERO, ZERO, ZERO, ONE))
    for j in range(arm.joints):
        t = _joint_at(arm, t, j, q[j])
    return wp.transform_multiply(t, arm.flange)


@wp.func
def _turn_of(r: quat):
    """The rotation vector of a quaternion [rad]."""
    if r[3] < ZERO:
        r = -r
    v = vec3(r[0], r[1], r[2])
    size = wp.length(v)
    if size == ZERO:
        return v
    return v * (TWO * wp.atan2(size, r[3]) / size)


@wp.func
def _missed(now: transform, wanted: transform):
    """What takes the flange to where it is wanted: a way in `_LENGTH`, and a turn [rad]."""
    p = (wp.transform_get_translation(wanted) - wp.transform_get_translation(now)) / _LENGTH
    r = _turn_of(wp.transform_get_rotation(wanted)
                 * wp.quat_inverse(wp.transform_get_rotation(now)))
    return vec6(p[0], p[1], p[2], r[0], r[1], r[2])


@wp.func
def _moves(joints: int, axes: mat76, at: vec3):
    """How each joint moves a point [1/_LENGTH] and turns it, a row a joint, from its place and
    axis."""
    found = mat76()
    for j in range(joints):
        z = vec3(axes[j, 3], axes[j, 4], axes[j, 5])
        way = wp.cross(z, at - vec3(axes[j, 0], axes[j, 1], axes[j, 2])) / _LENGTH
        found[j] = vec6(way[0], way[1], way[2], z[0], z[1], z[2])
    return found


@wp.func(inline=False)
def _solved(a: mat66, y: vec6):
    """The solution of a symmetric positive definite system, by elimination."""
    for k in range(6):
        for r in range(k + 1, 6):
            share = a[r, k] / a[k, k]
            for c in range(k, 6):
                a[r, c] = a[r, c] - share * a[k, c]
            y[r] = y[r] - share * y[k]
    for back in range(6):
        k = 5 - back
        for c in range(k + 1, 6):
            y[k] = y[k] - a[k, c] * y[c]
        y[k] = y[k] / a[k, k]
    return y


@wp.func
def _damped_step(arm: SerialArm, moves: mat76, missed: vec6, held: int):
    """The step of the joints that are not `held`, a bit each [rad]."""
    damping = _DAMPING + HALF * wp.dot(missed, missed)
    system = mat66()
    for k in range(6):
        system[k, k] = damping
    for j in range(arm.joints):
        if (held & (1 << j)) == 0:
            system += wp.outer(moves[j], moves[j])
    pull = _solved(system, missed)
    step = vec7()
    for j in range(arm.joints):
        if (held & (1 << j)) == 0:
            step[j] = wp.dot(moves[j], pull)
    return step


@wp.func
def _pushed(arm: SerialArm, q: vec7, step: vec7, j: int):
    """Whether a joint is at a limit and a step takes it beyond."""
    return (q[j] >= arm.high[j] and step[j] > ZERO) or (q[j] <= arm.low[j] and step[j] < ZERO)


@wp.func
def _moved(arm: SerialArm, q: vec7, step: vec7, beyond: int):
    """Joints after a step, within the limits; those of `beyond`, a bit each, go on at the other
    limit."""
    for j in range(arm.joints):
        angle = q[j] + step[j]
        if (beyond & (1 << j)) != 0:
            if angle > arm.high[j]:
                angle = angle - _TURN
            elif angle < arm.low[j]:
                angle = angle + _TURN
        q[j] = wp.clamp(angle, arm.low[j], arm.high[j])
    return q


@wp.func(inline=False)
def _come_to(arm: SerialArm, wanted: transform, start: vec7, stays: bool):
    """Joints within the limits at the pose, from `start`; NaN where it is not come to. Of one that
    `stays` no joint goes on at its other limit, and it is not given up early."""
    q = vec7()
    for j in range(arm.joints):
        q[j] = wp.clamp(start[j], arm.low[j], arm.high[j])
    went_round = int(0)
    nearest = real(1e30)
    since = int(0)
    for _ in range(_ITERATIONS):
        axes = mat76()
        now = transform(vec3(ZERO, ZERO, ZERO), quat(ZERO, ZERO, ZERO, ONE))
        for j in range(arm.joints):
            now = _joint_at(arm, now, j, q[j])
            p = wp.transform_get_translation(now)
            z = wp.quat_rotate(wp.transform_get_rotation(now), vec3(ZERO, ZERO, ONE))
            axes[j] = vec6(p[0], p[1], p[2], z[0], z[1], z[2])
        now = wp.transform_multiply(now, arm.flange)
        missed = _missed(now, wanted)
        far = wp.dot(missed, missed)
        if far < _NEAR * _NEAR:
            return q
        since += 1
        if far < _NEARER * _NEARER * nearest:
            nearest = far
            since = int(0)
        if since > _PATIENCE and not stays:
            break
        moves = _moves(arm.joints, axes, wp.transform_get_translation(now))
        step = _damped_step(arm, moves, missed, 0)
        held = int(0)
        beyond = int(0)
        for j in range(arm.joints):
            if _pushed(arm, q, step, j):
                gap = _TURN - (arm.high[j] - arm.low[j])
                if stays or gap > _GAP or (went_round & (1 << j)) != 0:
                    held = held | (1 << j)
                else:
                    beyond = beyond | (1 << j)
        went_round = went_round | beyond
        if held != 0:
            step = _damped_step(arm, moves, missed, held)
        longest = real(0.0)
        for j in range(arm.joints):
            longest = wp.max(longest, wp.abs(step[j]))
        if longest > _LONGEST:
            step = step * (_LONGEST / longest)
        q = _moved(arm, q, step, beyond)
    q[0] = wp.sqrt(-ONE)
    return q


@wp.func
def serial_start(arm: SerialArm, number: int, last: vec7):
    """The posture from which a pose is looked for: `last`, home, then spread over the limits."""
    if number == 0:
        return last
    if number == 1:
        return arm.home
    q = vec7()
    share = real(1.0)
    for j in range(arm.joints):
        share = share / _GOLDEN
        at = HALF + real(number - 1) * share
        q[j] = arm.low[j] + (at - wp.floor(at)) * (arm.high[j] - arm.low[j])
    return q


@wp.func
def serial_beyond(arm: SerialArm, wanted: transform):
    """Whether a pose of the flange is farther than the arm is long."""
    first = _place(arm, 0)
    away = wp.transform_get_translation(wanted) - wp.transform_get_translation(first)
    return not (wp.dot(away, away) <= arm.reach * arm.reach)  # True of NaN


@wp.func
def serial_joints(arm: SerialArm, wanted: transform, last: vec7):
    """Joints that take the flange to a pose, come to from `last`; else of those that are come to
    from other postures the ones nearest to `last`, by the joint that moves most. NaN where none is.
    """
    best = vec7()
    best[0] = wp.sqrt(-ONE)
    if serial_beyond(arm, wanted):
        return best
    nearest = real(1e30)
    for number in range(_MORE_STARTS):
        if number >= _STARTS and wp.isfinite(best[0]):
            return best
        q = _come_to(arm, wanted, serial_start(arm, number, last), number == 0)
        if wp.isfinite(q[0]):
            if number == 0:
                return q
            far = real(0.0)
            for j in range(arm.joints):
                far = wp.max(far, wp.abs(q[j] - last[j]))
            if far < nearest:
                nearest = far
                best = q
    return best


@wp.kernel(enable_backward=False)
def flange_kernel(
    first: int,
    arm: SerialArm,
    # Joints in:
    q: wp.array[vec7],
    # Pose out:
    flange: wp.array[transform],
):
    """The flange of each row of joints."""
    i = wp.tid() + first
    flange[i] = serial_flange(arm, q[i])


@wp.kernel(enable_backward=False)
def come_kernel(
    first: int,
    arm: SerialArm,
    # Pose in:
    flange: wp.array[transform],
    near: wp.array[vec7],
    before: int,
    # Joints out:
    q: wp.array2d[vec7],
):
    """The joints that each start comes to at each pose, of those after the first `before`; NaN
    where it does not."""
    i, column = wp.tid()
    i += first
    number = before + column
    found = vec7()
    found[0] = wp.sqrt(-ONE)
    if not serial_beyond(arm, flange[i]):
        found = _come_to(arm, flange[i], serial_start(arm, number, near[i]), number == 0)
    q[i, column] = found


@wp.kernel(enable_backward=False)
def joints_kernel(
    first: int,
    arm: SerialArm,
    # Pose in:
    flange: wp.array[transform],
    last: wp.array[vec7],
    # Joints out:
    q: wp.array[vec7],
):
    """The joints of each pose, nearest to those before."""
    i = wp.tid() + first
    q[i] = serial_joints(arm, flange[i], last[i])
