"""How often friction and noise alone stop a finger: exact, for the tests of closings."""

from math import erf, sqrt

import numpy as np

from warpgrasp.parameters import HandTable, SensorTable


def _upper_tail(x: float) -> float:
    return 0.5 * (1.0 - erf(x / sqrt(2.0)))


def _tension_at_rest_N(hand: HandTable) -> float:
    """Of both tendons of a joint without torque."""
    return max(hand.co_contraction_N, hand.tension_low_N)


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
