"""Tendons: what the 32 tension sensors read, and when friction and noise alone cross a threshold.

A joint torque tau is carried by a flexor and an extensor, T_co +- tau / 2R, each kept in its range.
What is read lies on the actuator's side of a tendon that rubs (Coulomb): more than the joint feels
where the actuator pulls, less where it pays out. The difference therefore does not vanish in free
motion, and a threshold must clear it.
"""

from functools import lru_cache
from math import erf, log1p, sqrt

import numpy as np
import warp as wp

from warpgrasp.counter_random import counter_key, counter_normal
from warpgrasp.parameters import HandTable, SensorTable
from warpgrasp.real import HALF, ONE, ZERO, real, vec2, vec4
from warpgrasp.utah_mit_hand import Hand

_CERTAIN = 1.0 - 1e-16  # a chance that has a logarithm


@wp.struct
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
    """Which way a command moves a tendon: 1, -1, or 0 where it stands still."""
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
    """What noise does to a flexor's and an extensor's reading, in standard deviations."""
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
    """Joint torque [N m] from read tensions, friction undone at its nominal size.

    Where one tendon has gone to the end of its range only the other one tells the torque.
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


def _upper_tail(x: float) -> float:
    return 0.5 * (1.0 - erf(x / sqrt(2.0)))


def _tension_at_rest_N(hand: HandTable) -> float:
    """Of both tendons of a joint without torque."""
    return min(max(hand.co_contraction_N, hand.tension_low_N), hand.tension_high_N)


@lru_cache(maxsize=64)
def false_stop_probability(hand: HandTable, sensor: SensorTable, *, moving: bool) -> float:
    """Chance that one joint's reading crosses the threshold in one step of free motion.

    Exact for the quantised reading: the two tendons' levels are convolved.
    """
    rub = hand.tendon_friction if moving else 0.0
    rest = _tension_at_rest_N(hand)
    flexor, extensor = rest * (1 + rub), rest * (1 - rub)
    threshold, sigma, step = (sensor.tendon_threshold_N, sensor.tension_noise_N,
                              sensor.tension_step_N)
    if sigma == 0.0:
        levels = [step * np.floor(t / step + 0.5) if step else t for t in (flexor, extensor)]
        return float(abs(levels[0] - levels[1]) > threshold)
    if step <= sigma * 0.01:  # too fine to matter, and too many levels to convolve
        mean, spread = flexor - extensor, sigma * sqrt(2.0)
        return _upper_tail((threshold - mean) / spread) + _upper_tail((threshold + mean) / spread)
    reach = int(np.ceil(10 * sigma / step)) + 1
    masses = []
    for tension in (flexor, extensor):
        middle = int(np.floor(tension / step + 0.5))
        levels = np.arange(middle - reach, middle + reach + 1)
        edges = (np.append(levels, levels[-1] + 1) - 0.5) * step
        cumulative = np.array([1.0 - _upper_tail((e - tension) / sigma) for e in edges])
        # In the far upper tail differences of the distribution lose their digits: use its mirror.
        tail = np.array([_upper_tail((e - tension) / sigma) for e in edges])
        mass = np.where(levels * step > tension, tail[:-1] - tail[1:], np.diff(cumulative))
        masses.append((middle, mass))
    difference = np.convolve(masses[0][1], masses[1][1][::-1])
    levels = np.arange(len(difference)) - 2 * reach + masses[0][0] - masses[1][0]
    return float(difference[np.abs(levels * step) > threshold].sum())


def tendon_sensor_of(hand: HandTable, sensor: SensorTable) -> TendonSensor:
    """The kernels' sensor, with the false-stop chances of one free step of one joint."""
    s = TendonSensor()
    s.threshold, s.noise = sensor.tendon_threshold_N, sensor.tension_noise_N
    s.step, s.readings = sensor.tension_step_N, sensor.tension_readings
    s.joint_noise = sensor.joint_noise_rad
    s.hazard_moving, s.hazard_still = (
        -log1p(-min(false_stop_probability(hand, sensor, moving=moving), _CERTAIN))
        for moving in (True, False))
    s.per_torque = vec4(*(1.0 / arm for arm in hand.moment_arm_m))
    s.rub = 2.0 * hand.tendon_friction * _tension_at_rest_N(hand)
    return s
