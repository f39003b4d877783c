# type: ignore  # Warp functions, which type checkers cannot follow
"""Tendons in kernels: tensions of a joint torque, what the sensors read, and back."""

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, real, struct, vec2, vec4
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
    per_torque: vec4
    """Tension difference for a joint's torque [N / (N m)], out of range less."""
    rub: real
    """The largest that friction adds to it [N]."""


@wp.func
def moving_sign(x: real):
    """The sign of a command's step: 1, -1, or 0 where the tendon stands still."""
    if x > real(1e-12):
        return ONE
    if x < real(-1e-12):
        return -ONE
    return ZERO


@wp.func
def tendon_tensions(hand: Hand, joint: int, torque: real, moving: real):
    """Flexor and extensor tension [N] at the actuators, `moving` the sign of the command's step."""
    pull = torque / (real(2.0) * hand.moment_arm[joint])
    flexor = wp.clamp(hand.co_contraction + pull, hand.tension_low, hand.tension_high)
    extensor = wp.clamp(hand.co_contraction - pull, hand.tension_low, hand.tension_high)
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
    """Joint torque [N m] from measured tensions, with friction of nominal size removed.

    Where one tendon has gone to the end of its range only the other one measures the torque.
    """
    flexor = tensions[0] / (ONE + hand.friction * moving)
    extensor = tensions[1] / (ONE - hand.friction * moving)
    arm = hand.moment_arm[joint]
    edge = hand.tension_low + real(0.25)
    if extensor < edge and flexor >= edge:
        return real(2.0) * arm * (flexor - hand.co_contraction)
    if flexor < edge and extensor >= edge:
        return real(2.0) * arm * (hand.co_contraction - extensor)
    return arm * (flexor - extensor)
