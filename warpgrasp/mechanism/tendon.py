"""Tendons: what the 32 tension sensors read, and when friction and noise alone cross a threshold.

A joint torque tau is carried by a flexor and an extensor, T_co +- tau / 2R. Neither is let slacker
than the least tension: from there on the other one carries the rest, so that their difference times
R is the torque always.
What is read lies on the actuator's side of a tendon that rubs (Coulomb): more than the joint feels
where the actuator pulls, less where it pays out. The difference therefore does not vanish in free
motion, and a threshold must clear it.
"""

from functools import lru_cache
from math import erf, sqrt

import numpy as np

from warpgrasp.core.dtypes import vec4
from warpgrasp.mechanism.tendon_kernel import TendonSensor
from warpgrasp.parameters import HandTable, SensorTable

_NEVER = 8.5
"""Deviations of one tension: six of the difference of two."""


def _upper_tail(x: float) -> float:
    return 0.5 * (1.0 - erf(x / sqrt(2.0)))


def _tension_at_rest_N(hand: HandTable) -> float:
    """Of both tendons of a joint without torque."""
    return max(hand.co_contraction_N, hand.tension_low_N)


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


def may_stop_free(hand: HandTable, sensor: SensorTable, pull_N: np.ndarray) -> np.ndarray:
    """Whether friction, noise and the links' weight, which pulls a tendon by at most `pull_N`, may
    stop a finger that touches nothing. Chances below 1e-9 a step are taken for none."""
    rub = hand.tendon_friction * np.maximum(2 * hand.co_contraction_N,
                                            2 * hand.tension_low_N + pull_N)
    margin = sensor.tendon_threshold_N - sensor.tension_step_N - rub - pull_N
    return np.asarray(margin <= _NEVER * sensor.tension_noise_N)


def tendon_sensor_of(hand: HandTable, sensor: SensorTable) -> TendonSensor:
    """The kernels' sensor."""
    s = TendonSensor()
    s.moment_arm = vec4(*hand.moment_arm_m)
    s.per_torque = vec4(*(1.0 / arm for arm in hand.moment_arm_m))
    s.co_contraction, s.least = hand.co_contraction_N, hand.tension_low_N
    s.friction = hand.tendon_friction
    s.threshold, s.noise = sensor.tendon_threshold_N, sensor.tension_noise_N
    s.step, s.readings = sensor.tension_step_N, sensor.tension_readings
    s.joint_noise = sensor.joint_noise_rad
    return s
