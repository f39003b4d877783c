# type: ignore  # Warp functions, which type checkers cannot follow
"""Any arm in kernels: the flange of its joints, the joints of a flange, the time of a move.

The PUMA 560 has six joints and an inverse in closed form, serial arms have six or seven and one by
iteration. A floating wrist has the flange's place [m] and rotation vector [rad] in place of joints:
every pose is reachable whose place lies within its box.
"""

import warp as wp

from warpgrasp.arms.serial_arm_kernel import serial_flange, serial_joints
from warpgrasp.core.dtypes import HALF, ONE, TWO, ZERO, quat, real, transform, vec3, vec7
from warpgrasp.core.turns import sine_cosine
from warpgrasp.mechanism.puma560_kernel import Arm, move_time, puma_forward, puma_reach

_STILL = wp.constant(real(1e-12))


@wp.func
def _floating_turn(q: vec7):
    """The quaternion of the last three numbers, a rotation vector."""
    v = vec3(q[3], q[4], q[5])
    angle = wp.length(v)
    if angle < _STILL:
        return quat(ZERO, ZERO, ZERO, ONE)
    half = sine_cosine(angle * HALF)
    v = v * (half[0] / angle)
    return quat(v[0], v[1], v[2], half[1])


@wp.func
def _turn_between(a: quat, b: quat):
    """The angle of the turn from one to the other [rad], at most half a turn."""
    between = wp.quat_inverse(a) * b
    v = vec3(between[0], between[1], between[2])
    return TWO * wp.atan2(wp.length(v), wp.abs(between[3]))


@wp.func
def arm_flange(arm: Arm, q: vec7):
    """Pose of the flange in the base frame."""
    if arm.floating == 1:
        return transform(vec3(q[0], q[1], q[2]), _floating_turn(q))
    if arm.serial.joints > 0:
        return serial_flange(arm.serial, q + arm.offset)
    return puma_forward(arm, q)


@wp.func
def arm_joints(arm: Arm, flange: transform, last: vec7):
    """The joints inside the limits that are soonest reached from `last`; NaN if there are none."""
    if arm.floating == 1:
        p = wp.transform_get_translation(flange)
        for j in range(3):
            if not (p[j] >= arm.low[j] and p[j] <= arm.high[j]):
                return vec7(wp.sqrt(-ONE), ZERO, ZERO, ZERO, ZERO, ZERO, ZERO)
        r = wp.transform_get_rotation(flange)
        if r[3] < ZERO:
            r = -r
        v = vec3(r[0], r[1], r[2])
        size = wp.length(v)
        if size > _STILL:
            v = v * (TWO * wp.atan2(size, r[3]) / size)
        return vec7(p[0], p[1], p[2], v[0], v[1], v[2], ZERO)
    if arm.serial.joints > 0:
        return serial_joints(arm.serial, flange, last)
    return puma_reach(arm, flange, last)


@wp.func
def arm_time(arm: Arm, start: vec7, end: vec7):
    """Time of a move [s]: the slowest joint governs; of a floating wrist, way or turn."""
    if arm.floating == 1:
        way = vec3(end[0] - start[0], end[1] - start[1], end[2] - start[2])
        turn = _turn_between(_floating_turn(start), _floating_turn(end))
        return wp.max(wp.length(way) / arm.speed[0], turn / arm.speed[3])
    return move_time(arm, start, end)
