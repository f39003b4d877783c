"""The guard of a closing: whether the tendons' readings at a step stop the finger."""

import warp as wp

from warpgrasp.counter_random import counter_key
from warpgrasp.finger_between import Ball
from warpgrasp.real import real, vec4
from warpgrasp.tendon import (
    TendonSensor,
    may_cross,
    moving_sign,
    tendon_tensions,
    tension_difference_read,
)
from warpgrasp.utah_mit_hand import Hand


@wp.func
def stop_reading(
    hand: Hand, sensor: TendonSensor, torque: vec4, delta: vec4, key: wp.uint64
):
    """The largest tendon difference of the flexion joints in one reading of each [N], by size.

    `delta` is the command's last move. Readings that are sure to stay below the threshold are left
    out.
    """
    largest = real(0.0)
    for j in range(1, 4):
        tensions = tendon_tensions(hand, j, torque[j], moving_sign(delta[j]))
        noise = counter_key(key, j)
        if may_cross(sensor, wp.abs(tensions[0] - tensions[1]), noise):
            d = tension_difference_read(sensor, tensions, noise)
            if wp.abs(d) > wp.abs(largest):
                largest = d
    return largest


@wp.func
def may_stop(hand: Hand, sensor: TendonSensor, torque: Ball, delta: vec4, key: wp.uint64):
    """Whether some of the torques possible would have that same reading stop the finger.

    A reading rises with the torque, so the ends of what is possible tell.
    """
    for j in range(1, 4):
        moving = moving_sign(delta[j])
        low = tendon_tensions(hand, j, torque.centre[j] - torque.radius, moving)
        high = tendon_tensions(hand, j, torque.centre[j] + torque.radius, moving)
        noise = counter_key(key, j)
        if may_cross(sensor, wp.max(wp.abs(low[0] - low[1]), wp.abs(high[0] - high[1])), noise):
            if tension_difference_read(sensor, high, noise) > sensor.threshold:
                return True
            if tension_difference_read(sensor, low, noise) < -sensor.threshold:
                return True
    return False
