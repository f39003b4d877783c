# type: ignore  # Warp functions, which type checkers cannot follow
"""PUMA 560 in kernels: forward kinematics, the eight inverse solutions, moves between poses."""

import numpy as np
import warp as wp

from warpgrasp.arms.serial_arm_kernel import SerialArm
from warpgrasp.core.dtypes import (
    HALF,
    ONE,
    PI,
    TWO,
    TWO_PI,
    ZERO,
    quat,
    real,
    struct,
    transform,
    vec3,
    vec7,
)

_SINGULAR = wp.constant(real(1e-10))
_QUARTER = wp.constant(real(np.pi / 2))


@struct
class Arm:
    """What kernels need of an ArmTable [m, rad, rad/s]: a PUMA 560, a floating wrist or a serial
    arm."""

    d1: real
    d3: real
    d4: real
    a2: real
    a3: real
    low: vec7
    high: vec7
    speed: vec7
    mount: real
    encoder_step: real
    repeatability: real
    floating: int
    """1: no arm, a wrist that floats within `low` to `high` (`arm_kernel`)."""
    serial: SerialArm
    """Any other arm; see `arm_kernel`."""
    offset: vec7
    """Of the true arm's joints against what the encoders say [rad]."""


@wp.func
def _turn(theta: real, quarter_turns: real):
    """One joint's turn: about z, then (in quarter turns) about x."""
    h = theta * HALF
    k = quarter_turns * _QUARTER * HALF
    about_z = quat(ZERO, ZERO, wp.sin(h), wp.cos(h))
    about_x = quat(wp.sin(k), ZERO, ZERO, wp.cos(k))
    return about_z * about_x


@wp.func
def _dh(theta: real, d: real, a: real, quarter_turns: real):
    """One joint: turn and rise along z, then shift and turn (in quarter turns) along x."""
    return transform(vec3(a * wp.cos(theta), a * wp.sin(theta), d), _turn(theta, quarter_turns))


@wp.func
def puma_forward(arm: Arm, q: vec7):
    """Pose of the flange (joint frame 6) in the base frame."""
    turn = q + arm.offset
    t = _dh(turn[0], arm.d1, ZERO, ONE)
    t = wp.transform_multiply(t, _dh(turn[1], ZERO, arm.a2, ZERO))
    t = wp.transform_multiply(t, _dh(turn[2], arm.d3, arm.a3, -ONE))
    t = wp.transform_multiply(t, _dh(turn[3], arm.d4, ZERO, ONE))
    t = wp.transform_multiply(t, _dh(turn[4], ZERO, ZERO, -ONE))
    return wp.transform_multiply(t, _dh(turn[5], ZERO, ZERO, ZERO))


@struct
class _WristPlace:
    """What the first three joints of all branches have in common."""

    p: vec3
    z: real
    distance: real
    """From the first joint's axis."""
    azimuth: real
    shoulder: real
    """NaN where the wrist is nearer the axis than the shoulder."""
    forearm: real


@wp.func
def _wrist_place(arm: Arm, p: vec3):
    """Where the wrist is to be."""
    at = _WristPlace()
    at.p = p
    at.z = p[2] - arm.d1
    at.distance = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    at.azimuth = wp.atan2(p[1], p[0])
    at.shoulder = wp.asin(arm.d3 / at.distance)
    at.forearm = wp.atan2(arm.a3, arm.d4)
    return at


@wp.func(inline=False)
def _arm_angles(arm: Arm, at: _WristPlace, branch: int):
    """Joints 1 to 3 that take the wrist to its place, NaN out of reach."""
    q1 = at.azimuth + at.shoulder
    if (branch & 1) != 0:
        q1 = at.azimuth + PI - at.shoulder
    v = at.p[0] * wp.cos(q1) + at.p[1] * wp.sin(q1)
    reach_sq = v * v + at.z * at.z
    cosine = (arm.a2 * arm.a2 - arm.d4 * arm.d4 - arm.a3 * arm.a3 + reach_sq) / (
        TWO * arm.a2 * wp.sqrt(reach_sq))
    elbow = wp.acos(cosine)  # NaN out of reach
    if wp.abs(cosine) > ONE or arm.d3 > at.distance:
        elbow = wp.sqrt(-ONE)
    q2 = wp.atan2(at.z, v) + elbow
    if (branch & 2) != 0:
        q2 = wp.atan2(at.z, v) - elbow
    c2 = wp.cos(q2)
    s2 = wp.sin(q2)
    q3 = at.forearm - wp.atan2(c2 * v + s2 * at.z - arm.a2, c2 * at.z - s2 * v)
    return vec3(q1, q2, q3)


@wp.func
def _wrist_angles(q: vec3, turn: quat, hint: real):
    """Joints 4 to 6, not flipped, that turn the flange to `turn` when the first three stand at `q`.

    In the wrist singularity, where only q4 + q6 is fixed, q4 is taken from `hint`.
    """
    before = _turn(q[0], ONE) * _turn(q[1], ZERO) * _turn(q[2], -ONE)
    m = wp.transpose(wp.quat_to_matrix(before)) * wp.quat_to_matrix(turn)
    sine = wp.sqrt(m[0, 2] * m[0, 2] + m[1, 2] * m[1, 2])
    q4 = wp.atan2(m[1, 2], m[0, 2])
    q6 = wp.atan2(m[2, 1], -m[2, 0])
    if sine < _SINGULAR:
        q4 = hint
        about = wp.atan2(m[1, 0], m[0, 0])
        q6 = about - q4
        if m[2, 2] < ZERO:
            q6 = q4 - wp.atan2(-m[1, 0], -m[0, 0])
    return vec3(q4, -wp.atan2(sine, m[2, 2]), q6)


@wp.func
def _flipped(wrist: vec3, branch: int):
    """The wrist of a branch."""
    if (branch & 4) != 0:
        return vec3(wrist[0] + PI, -wrist[1], wrist[2] + PI)
    return wrist


@wp.func
def puma_inverse(arm: Arm, flange: transform, branch: int):
    """Joint angles of one of the eight branches (bits: lefty, elbow, flip), NaN out of reach.

    In the wrist singularity, where only q4 + q6 is fixed, q4 of a wrist not flipped is 0.
    """
    q = _arm_angles(arm, _wrist_place(arm, wp.transform_get_translation(flange)), branch)
    w = _flipped(_wrist_angles(q, wp.transform_get_rotation(flange), ZERO), branch)
    return vec7(q[0], q[1], q[2], w[0], w[1], w[2], ZERO)


@wp.func
def _into_limits(angle: real, low: real, high: real, near: real):
    """The equivalent angle inside the limits nearest to `near`; NaN if there is none."""
    best = angle + TWO_PI * wp.round((near - angle) / TWO_PI)
    if best > high:
        best -= TWO_PI * wp.ceil((best - high) / TWO_PI)
    if best < low:
        best += TWO_PI * wp.ceil((low - best) / TWO_PI)
    if best > high:
        return wp.sqrt(-ONE)
    return best


@wp.func
def move_time(arm: Arm, start: vec7, end: vec7):
    """Time of a joint move [s]: the slowest joint governs."""
    t = real(0.0)
    for j in range(7):
        t = wp.max(t, wp.abs(end[j] - start[j]) / arm.speed[j])
    return t


@wp.func(inline=False)
def puma_reach(arm: Arm, flange: transform, last: vec7):
    """The branch inside the limits that is soonest reached from `last`; NaN joints if none is.

    Of several as soon the first one. A wrist is computed only where the first three joints
    would be there as soon as the best so far.
    """
    best = vec7(wp.sqrt(-ONE), ZERO, ZERO, ZERO, ZERO, ZERO, ZERO)
    best_time = real(1.0e30)
    best_branch = int(8)
    turn = wp.transform_get_rotation(flange)
    at = _wrist_place(arm, wp.transform_get_translation(flange))
    for branch in range(4):
        free = _arm_angles(arm, at, branch)
        q = vec7(free[0], free[1], free[2], last[3], last[4], last[5], ZERO)
        for j in range(3):
            q[j] = _into_limits(q[j], arm.low[j], arm.high[j], last[j])
        inside = wp.isfinite(q[0]) and wp.isfinite(q[1]) and wp.isfinite(q[2])
        if inside and move_time(arm, last, q) <= best_time:
            wrist = _wrist_angles(free, turn, last[3])
            for flip in range(2):
                w = _flipped(wrist, 4 * flip)
                good = int(1)
                for j in range(3):
                    q[3 + j] = _into_limits(w[j], arm.low[3 + j], arm.high[3 + j], last[3 + j])
                    if not wp.isfinite(q[3 + j]):
                        good = int(0)
                t = move_time(arm, last, q)
                number = branch + 4 * flip
                if good == 1 and (t < best_time or (t == best_time and number < best_branch)):
                    best = q
                    best_time = t
                    best_branch = number
    return best


@wp.kernel(enable_backward=False)
def _forward_kernel(
    first: int,
    arm: Arm,
    # Joints in:
    q: wp.array[vec7],
    # Pose out:
    flange: wp.array[transform],
):
    i = wp.tid() + first
    flange[i] = puma_forward(arm, q[i])


@wp.kernel(enable_backward=False)
def _inverse_kernel(
    first: int,
    arm: Arm,
    # Pose in:
    flange: wp.array[transform],
    # Joints out:
    q: wp.array2d[vec7],
):
    i, branch = wp.tid()
    q[i + first, branch] = puma_inverse(arm, flange[i + first], branch)


@wp.kernel(enable_backward=False)
def _reachable_kernel(
    first: int,
    arm: Arm,
    # Pose in:
    flange: wp.array[transform],
    # Whether some branch is inside the limits out:
    reachable: wp.array[wp.bool],
):
    i = wp.tid() + first
    reachable[i] = wp.isfinite(puma_reach(arm, flange[i], vec7())[0])
