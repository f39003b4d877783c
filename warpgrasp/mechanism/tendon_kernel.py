# type: ignore  # Warp functions, which type checkers cannot follow
"""Tendons in kernels: tensions of a joint torque, what the sensors read, and back."""

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, real, struct, vec2
from warpgrasp.core.random_kernel import counter_key, counter_normal
from warpgrasp.mechanism.utah_mit_hand_kernel import Hand


@struct
class TendonSensor:
    """The numbers of a SensorTable that kernels need [N, rad]."""

    threshold: real
    noise: real
    step: real
    readings: int
    joint_noise: real
    hazard_moving: real
    """Of a false stop in a step of a joint whose tendons move, -log(1 - its chance)."""
    hazard_still: real


@wp.func
def moving_sign(x: real):
    """The sign of a command's step: 1, -1, or 0 where the tendon stands still."""
    if x > real(1e-12):
        return ONE
    if x < real(-1e-12):
        return -ONE
    return ZERO


@wp.func
def tension_sum(hand: Hand, pull: real):
    """Of a joint's two tendons, without friction, whose difference is `pull` [N]."""
    return real(2.0) * wp.max(hand.co_contraction, hand.tension_low + wp.abs(pull) * HALF)


@wp.func
def tendon_tensions(hand: Hand, joint: int, torque: real, moving: real):
    """Flexor and extensor tension [N] at the actuators, `moving` the sign of the command's step.

    Their difference times the moment arm is the torque: where one tendon may not become slacker,
    the other one carries the rest.
    """
    pull = torque / hand.moment_arm[joint]
    least = tension_sum(hand, pull) * HALF - wp.abs(pull) * HALF
    flexor = least + wp.max(pull, ZERO)
    extensor = least - wp.min(pull, ZERO)
    return vec2(flexor * (ONE + hand.friction * moving), extensor * (ONE - hand.friction * moving))


@wp.func
def _quantised(value: real, step: real):
    if step <= ZERO:
        return value
    return step * wp.floor(value / step + HALF)


@wp.func
def tension_noise(key: wp.uint64):
    """Noise of the readings of a flexor and an extensor, in standard deviations."""
    return vec2(counter_normal(counter_key(key, 0)), counter_normal(counter_key(key, 1)))


@wp.func
def tension_difference_read(sensor: TendonSensor, tensions: vec2, noise: vec2):
    """One noisy, quantised reading of flexor minus extensor tension [N]."""
    flexor = tensions[0] + sensor.noise * noise[0]
    extensor = tensions[1] + sensor.noise * noise[1]
    return _quantised(flexor, sensor.step) - _quantised(extensor, sensor.step)


@wp.func
def tension_mean_read(sensor: TendonSensor, tension: real, key: wp.uint64):
    """Mean of the readings taken at rest; quantisation enters as its variance, step^2 / 12."""
    variance = (sensor.noise * sensor.noise + sensor.step * sensor.step / real(12.0)) / real(
        sensor.readings)
    return tension + wp.sqrt(variance) * counter_normal(key)


@wp.func
def torque_from_tensions(hand: Hand, joint: int, tensions: vec2, moving: real):
    """Joint torque [N m] from measured tensions, with friction of nominal size removed."""
    flexor = tensions[0] / (ONE + hand.friction * moving)
    extensor = tensions[1] / (ONE - hand.friction * moving)
    return hand.moment_arm[joint] * (flexor - extensor)
