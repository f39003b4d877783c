"""What a robot does not know of its own fingers, by which it tells whether they met: see
`press_kernel`.

The default limit leaves one meeting in some hundred untold: squared deviations of the gap and of
four joints that stay below it with 98 %.
"""

import numpy as np

from warpgrasp.hand_rest.press_kernel import Doubt
from warpgrasp.parameters import ErrorTable, SensorTable

MISFIT = 12.0
"""Squared deviations: a finger that pressing on a link explains worse did not stop there."""
_TURN_RAD = 0.003
"""What turns a joint beside what is known: links pressed in two places, or that glance [est]."""
_PLACE_M = 3e-4
"""How far skins give [est]."""


def doubt_of(sensors: SensorTable, errors: ErrorTable, length_m: np.ndarray) -> Doubt:
    """What a robot does not know of a finger whose links have these lengths.

    `errors` are standard deviations already scaled. Lengths and bases count as errors of a place in
    every direction, joints by how they move it.
    """
    doubt = Doubt()
    doubt.zero = errors.joint_offset_rad**2 + _TURN_RAD**2
    doubt.reading = sensors.joint_noise_rad**2
    doubt.turn = doubt.reading + _TURN_RAD**2
    stretch = float(((errors.link_length_share * length_m) ** 2).sum())
    doubt.place = errors.finger_base_m**2 + stretch + _PLACE_M**2
    return doubt
