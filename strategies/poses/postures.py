"""Postures of the hand for touching with one or two fingers, and where that puts the fingertip.

To touch a surface with the index finger extended, the other fingers fold and the hand leans so that
the fingertip's pad, bent over the tip, faces the surface while thumb and palm stay clear of it.
"""

from math import radians

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.parameters import HandTable, PadTable

INDEX, THUMB = 0, 3
POKE_LEAN_RAD = radians(57)
"""From the palmar direction to the probing direction: the fingertip leads folded thumb and palm."""


def _posture(*fingers_deg: tuple[float, float, float, float]) -> np.ndarray:
    """Joint commands (finger 4, step 1, 4) [rad]."""
    return np.radians(np.asarray(fingers_deg, float))[:, None, :]


POKE_RAD = _posture((0, 0, 0, 0), (0, -10, 95, 95), (0, -10, 95, 95), (0, 10, 95, 95))
"""Index finger extended, the others folded."""
PINCH_OPEN_RAD = _posture((14.3, -10, 0, 0), (0, 30, 95, 95), (0, 30, 95, 95), (0, -10, 0, 0))
"""Index finger and thumb opened wide, the index finger abducted to face the thumb; others fold."""
_CLOSED_DEG = 30.0
_CLOSING_STEPS = 81


def pinch_commands(finger: int) -> np.ndarray:
    """Commands (finger 4, step, 4) [rad] that close one straight finger from its base.

    Half a degree a step: a millimetre at the fingertip.
    """
    commands = np.repeat(PINCH_OPEN_RAD, _CLOSING_STEPS, axis=1)
    commands[finger, :, 1] = np.radians(np.linspace(-10.0, _CLOSED_DEG, _CLOSING_STEPS))
    return commands


def poke_tip_m(hand: HandTable) -> np.ndarray:
    """Centre of the extended index fingertip in the hand frame [m]."""
    return np.array([-hand.palm_gap_m / 2, -hand.finger_spacing_m,
                     hand.abduction_offset_m + sum(hand.link_length_m)])


def poking_pose(
    hand: HandTable, pads: PadTable, touch_m: np.ndarray, inward: np.ndarray, lean: np.ndarray
) -> np.ndarray:
    """Hand poses whose extended index pad touches `touch_m` while probing along `inward`.

    `touch_m`, unit `inward` and `lean` have shape (..., 3); the finger points along `inward` turned
    towards `lean` (its part across `inward`). Returns (..., 7), position [m], quaternion xyzw.
    """
    touch_m, inward, lean = np.broadcast_arrays(touch_m, inward, lean)
    side = lean - (lean * inward).sum(-1, keepdims=True) * inward
    side = side / np.linalg.norm(side, axis=-1, keepdims=True)
    c, s = np.cos(POKE_LEAN_RAD), np.sin(POKE_LEAN_RAD)
    x, z = c * inward - s * side, s * inward + c * side
    turn = Rotation.from_matrix(
        np.stack([x, np.cross(z, x), z], -1).reshape(-1, 3, 3))
    tip = turn.apply(poke_tip_m(hand)).reshape(touch_m.shape)
    radius = hand.link_radius_m + pads.thickness_m
    quaternion = turn.as_quat().reshape(*touch_m.shape[:-1], 4)
    return np.concatenate([touch_m - radius * inward - tip, quaternion], -1)
