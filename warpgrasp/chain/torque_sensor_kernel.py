# type: ignore  # Warp functions, which type checkers cannot follow
"""What fingers feel that have no tendons, in kernels: torques of joints, or a switch at the tip."""

import warp as wp

from warpgrasp.chain.chain_kernel import vec6
from warpgrasp.core.dtypes import ZERO, real, struct, vec2
from warpgrasp.core.random_kernel import counter_key, counter_normal, counter_uniform
from warpgrasp.core.reading_kernel import mean_read, mean_variance, quantised
from warpgrasp.mechanism.tendon_kernel import moving_sign

TORQUES, SWITCHES = 1, 2
"""Kinds of sensors; 0: nothing is felt."""
_TORQUES, _SWITCHES = wp.constant(TORQUES), wp.constant(SWITCHES)


@struct
class TorqueSensor:
    """The sensors of one finger [N m, N, rad]."""

    kind: int
    gain: vec6
    """What is read for a newton metre, by the errors of calibration; 1 of the believed one."""
    friction: real
    """Of gears between a joint and its motor, where the torque is read."""
    threshold: real
    noise: real
    step: real
    readings: int
    switch_force: real
    """On the last link, that closes its switch."""
    joint_noise: real
    suspect: real
    """Noise can stop a finger that touches nothing only where the first uniform draw of a reading
    is below this; 0: it never can."""


@wp.func
def torque_carried(sensor: TorqueSensor, drive: int, torque: real, moving: real):
    """A drive's torque as its motor carries it [N m], `moving` the sign of the command's step."""
    return sensor.gain[drive] * torque + sensor.friction * moving


@wp.func
def torque_read(sensor: TorqueSensor, drive: int, torque: real, moving: real, key: wp.uint64):
    """One noisy, quantised reading of a drive's torque [N m]."""
    value = torque_carried(sensor, drive, torque, moving) + sensor.noise * counter_normal(key)
    return quantised(value, sensor.step)


@wp.func
def torque_mean_read(sensor: TorqueSensor, drive: int, torque: real, moving: real, key: wp.uint64):
    """Mean of the readings taken at rest [N m]."""
    return mean_read(torque_carried(sensor, drive, torque, moving), sensor.noise, sensor.step,
                     sensor.readings, key)


@wp.func
def guard_reading(
    sensor: TorqueSensor, drives: int, torque: vec6, tip_force: real, delta: vec6, key: wp.uint64
):
    """What guards a closing: how far the largest reading goes, of its threshold, and the reading.

    `torque` is what the servos bear beside the links' believed weight, `delta` the last step of the
    command. A finger stops from 1 on.
    """
    largest = vec2(ZERO, ZERO)
    if sensor.kind == _TORQUES:
        for d in range(drives):
            r = torque_read(sensor, d, torque[d], moving_sign(delta[d]), counter_key(key, d))
            if wp.abs(r) > largest[0] * sensor.threshold:
                largest = vec2(wp.abs(r) / sensor.threshold, r)
    elif sensor.kind == _SWITCHES:
        largest = vec2(tip_force / sensor.switch_force, tip_force)
    return largest


@wp.func
def noise_may_stop(sensor: TorqueSensor, drives: int, key: wp.uint64):
    """Whether the noise of a reading may stop a finger that touches nothing: of `counter_normal`
    the first draw alone bounds how large it is, whatever the other one."""
    may = int(0)
    for d in range(drives):
        if counter_uniform(counter_key(counter_key(key, d), 1)) < sensor.suspect:
            may = 1
    return may == 1


@wp.func
def torque_from_reading(sensor: TorqueSensor, mean: real, moving: real):
    """Torque of a joint from what was read, friction of nominal size removed [N m]."""
    return mean - sensor.friction * moving


@wp.func
def torque_variance(sensor: TorqueSensor):
    """Of the mean reading [(N m)^2]."""
    return mean_variance(sensor.noise, sensor.step, sensor.readings)
