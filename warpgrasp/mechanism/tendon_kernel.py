# type: ignore  # Warp functions, which type checkers cannot follow
"""Tendons in kernels: tensions of a joint torque, what the sensors read, and back."""

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, real, struct, vec2, vec4
from warpgrasp.core.random_kernel import counter_key, counter_normal
from warpgrasp.core.reading_kernel import mean_read, quantised


@struct
class TendonSensor:
    """The tendons of one finger, and the numbers of a SensorTable that kernels need [N, m, rad]."""

    moment_arm: vec4
    per_torque: vec4
    """Tension difference for a joint's torque [N / (N m)]."""
    co_contraction: real
    least: real
    friction: real

    threshold: real
    noise: real
    step: real
    readings: int
    joint_noise: real
    heard: int
    """Whether a finger that touches nothing may stop: its readings are then all drawn."""


@wp.func
def moving_sign(x: real):
    """The sign of a command's step: 1, -1, or 0 where the tendon stands still."""
    if x > real(1e-12):
        return ONE
    if x < real(-1e-12):
        return -ONE
    return ZERO


@wp.func
def tension_sum(sensor: TendonSensor, pull: real):
    """Of a joint's two tendons, without friction, whose difference is `pull` [N]."""
    return real(2.0) * wp.max(sensor.co_contraction, sensor.least + wp.abs(pull) * HALF)


@wp.func
def tendon_tensions(sensor: TendonSensor, joint: int, torque: real, moving: real):
    """Flexor and extensor tension [N] at the actuators, `moving` the sign of the command's step.

    Their difference times the moment arm is the torque: where one tendon may not become slacker,
    the other one carries the rest.
    """
    pull = torque * sensor.per_torque[joint]
    least = tension_sum(sensor, pull) * HALF - wp.abs(pull) * HALF
    flexor = least + wp.max(pull, ZERO)
    extensor = least - wp.min(pull, ZERO)
    rub = sensor.friction * moving
    return vec2(flexor * (ONE + rub), extensor * (ONE - rub))


@wp.func
def tension_noise(key: wp.uint64):
    """Noise of the readings of a flexor and an extensor, in standard deviations."""
    return vec2(counter_normal(counter_key(key, 0)), counter_normal(counter_key(key, 1)))


@wp.func
def tension_difference_read(sensor: TendonSensor, tensions: vec2, noise: vec2):
    """One noisy, quantised reading of flexor minus extensor tension [N]."""
    flexor = tensions[0] + sensor.noise * noise[0]
    extensor = tensions[1] + sensor.noise * noise[1]
    return quantised(flexor, sensor.step) - quantised(extensor, sensor.step)


@wp.func
def tension_mean_read(sensor: TendonSensor, tension: real, key: wp.uint64):
    """Mean of the readings taken at rest [N]."""
    return mean_read(tension, sensor.noise, sensor.step, sensor.readings, key)


@wp.func
def torque_from_tensions(sensor: TendonSensor, joint: int, tensions: vec2, moving: real):
    """Joint torque [N m] from measured tensions, with friction of nominal size removed."""
    flexor = tensions[0] / (ONE + sensor.friction * moving)
    extensor = tensions[1] / (ONE - sensor.friction * moving)
    return sensor.moment_arm[joint] * (flexor - extensor)
