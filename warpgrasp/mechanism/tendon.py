"""Tendons: what the 32 tension sensors read, and whether friction and noise may stop a finger.

A joint torque tau is carried by a flexor and an extensor, T_co +- tau / 2R. Neither is let slacker
than the least tension: from there on the other one carries the rest, so that their difference times
R is the torque always.
What is read lies on the actuator's side of a tendon that rubs (Coulomb): more than the joint feels
where the actuator pulls, less where it pays out. The difference therefore does not vanish in free
motion, and a threshold must clear it.
"""

import numpy as np

from warpgrasp.core.dtypes import vec4
from warpgrasp.mechanism.tendon_kernel import TendonSensor
from warpgrasp.parameters import HandTable, SensorTable

_NEVER = 8.5
"""Deviations of one tension: six of the difference of two."""


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
