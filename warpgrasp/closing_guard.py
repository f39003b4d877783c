"""The guard of a closing: whether the tendons' readings at a step stop the finger."""

import warp as wp

from warpgrasp.counter_random import counter_key, counter_uniform
from warpgrasp.finger_between import Ball
from warpgrasp.real import HALF, ONE, ZERO, real, vec4
from warpgrasp.tendon import (
    TendonSensor,
    moving_sign,
    tendon_tensions,
    tension_difference_read,
    tension_noise,
)
from warpgrasp.utah_mit_hand import Hand

_SIXTH = wp.constant(real(1.0 / 6.0))
_THIRTYSECOND = wp.constant(real(1.0 / 32.0))


@wp.func
def _surely_below(sensor: TendonSensor, pull: real, moving: real, noise: wp.uint64):
    """Whether a joint's reading surely stays below the threshold; `pull` [N] is its true size.

    Friction adds to it where tendons move. A normal of Box and Muller is at most sqrt(-2 log u) by
    size, and u takes no root or cosine; for exp(-x), which u is compared with, the first terms of
    exp(x / 4) to the fourth do.
    """
    margin = sensor.threshold - sensor.step - wp.abs(moving) * sensor.rub - pull
    if margin <= ZERO or sensor.noise <= ZERO:
        return margin > ZERO
    x = margin * margin * (_THIRTYSECOND / (sensor.noise * sensor.noise))
    e = ONE + x * (ONE + x * (HALF + x * _SIXTH))
    least = wp.min(counter_key(counter_key(noise, 0), 1), counter_key(counter_key(noise, 1), 1))
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
    for j in range(1, 4):
        moving = moving_sign(delta[j])
        noise = counter_key(key, j)
        if not _surely_below(sensor, wp.abs(torque[j]) * sensor.per_torque[j], moving, noise):
            d = tension_difference_read(
                sensor, tendon_tensions(hand, j, torque[j], moving), tension_noise(noise))
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
        noise = counter_key(key, j)
        centre = torque.centre[j]
        if not _surely_below(sensor, (wp.abs(centre) + torque.radius) * sensor.per_torque[j],
                             moving, noise):
            drawn = tension_noise(noise)
            low = tendon_tensions(hand, j, centre - torque.radius, moving)
            high = tendon_tensions(hand, j, centre + torque.radius, moving)
            if tension_difference_read(sensor, high, drawn) > sensor.threshold:
                return True
            if tension_difference_read(sensor, low, drawn) < -sensor.threshold:
                return True
    return False
