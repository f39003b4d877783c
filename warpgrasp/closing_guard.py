"""The guard of a closing: whether the tendons' readings at a step stop the finger."""

import warp as wp

from warpgrasp.counter_random import counter_key, counter_uniform
from warpgrasp.finger_between import Ball
from warpgrasp.real import HALF, ONE, ZERO, real, vec4
from warpgrasp.tendon import (
    TendonSensor,
    may_cross,
    moving_sign,
    tendon_tensions,
    tension_difference_read,
    tension_noise,
)
from warpgrasp.utah_mit_hand import Hand

_SIXTH = wp.constant(real(1.0 / 6.0))
_THIRTYSECOND = wp.constant(real(1.0 / 32.0))


@wp.func
def _least_draw(key: wp.uint64, joint: int):
    """The key of the lesser of the uniform numbers that `may_cross` asks of a joint's reading."""
    noise = counter_key(key, joint)
    return wp.min(counter_key(counter_key(noise, 0), 1), counter_key(counter_key(noise, 1), 1))


@wp.func
def _surely_below(sensor: TendonSensor, torque: vec4, slack: real, key: wp.uint64):
    """Whether no reading of joints with these torques, give or take `slack` [N m], can stop.

    `may_cross` for the largest of the three differences with the least of their six numbers.
    """
    pull = wp.max((wp.abs(torque[1]) + slack) * sensor.per_torque[1],
                  wp.max((wp.abs(torque[2]) + slack) * sensor.per_torque[2],
                         (wp.abs(torque[3]) + slack) * sensor.per_torque[3]))
    margin = sensor.threshold - sensor.step - sensor.rub - pull
    if margin <= ZERO or sensor.noise <= ZERO:
        return margin > ZERO
    share = margin / sensor.noise
    x = share * share * _THIRTYSECOND  # a quarter of what exp is of
    e = ONE + x * (ONE + x * (HALF + x * _SIXTH))
    least = wp.min(_least_draw(key, 1), wp.min(_least_draw(key, 2), _least_draw(key, 3)))
    return counter_uniform(least) * (e * e) * (e * e) >= ONE


@wp.func
def stop_reading(
    hand: Hand, sensor: TendonSensor, torque: vec4, delta: vec4, key: wp.uint64
):
    """The largest tendon difference of the flexion joints in one reading of each [N], by size.

    `delta` is the command's last move. Readings that are sure to stay below the threshold are left
    out.
    """
    largest = real(0.0)
    if _surely_below(sensor, torque, ZERO, key):
        return largest
    for j in range(1, 4):
        tensions = tendon_tensions(hand, j, torque[j], moving_sign(delta[j]))
        noise = counter_key(key, j)
        if may_cross(sensor, wp.abs(tensions[0] - tensions[1]), noise):
            d = tension_difference_read(sensor, tensions, tension_noise(noise))
            if wp.abs(d) > wp.abs(largest):
                largest = d
    return largest


@wp.func
def may_stop(hand: Hand, sensor: TendonSensor, torque: Ball, delta: vec4, key: wp.uint64):
    """Whether some of the torques possible would have that same reading stop the finger.

    A reading rises with the torque, so the ends of what is possible tell.
    """
    if _surely_below(sensor, torque.centre, torque.radius, key):
        return False
    for j in range(1, 4):
        moving = moving_sign(delta[j])
        low = tendon_tensions(hand, j, torque.centre[j] - torque.radius, moving)
        high = tendon_tensions(hand, j, torque.centre[j] + torque.radius, moving)
        noise = counter_key(key, j)
        if may_cross(sensor, wp.max(wp.abs(low[0] - low[1]), wp.abs(high[0] - high[1])), noise):
            drawn = tension_noise(noise)
            if tension_difference_read(sensor, high, drawn) > sensor.threshold:
                return True
            if tension_difference_read(sensor, low, drawn) < -sensor.threshold:
                return True
    return False
