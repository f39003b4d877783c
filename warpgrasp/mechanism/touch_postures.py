"""How a hand touches with one finger, and with two: records, and the Utah-MIT hand's.

To touch a surface one finger is extended, and the hand leans so that the pad, bent over the
fingertip, faces the surface while all else of the hand stays clear of it. To touch a section from
both sides two fingers close towards each other, one after the other.
"""

from dataclasses import dataclass
from math import asin, cos, nan, radians, sin

import numpy as np

from warpgrasp.parameters import HandTable, PadTable


@dataclass(frozen=True, eq=False)
class ExtendedFinger:
    """A hand that touches with one finger, SI, hand frame."""

    finger: int
    commands_rad: np.ndarray
    """Of all fingers, (finger, step 1, joint)."""
    axes: np.ndarray
    """Columns: the side that the pad lies on, the third, and the way the finger points, (3, 3)."""
    tip_m: np.ndarray
    """What the pad bends about, (3,)."""
    ball_m: float
    """From there to the pad's face."""
    lean_rad: float
    """From the pad's side to the direction that it touches in, towards where the finger points."""


@dataclass(frozen=True, eq=False)
class OpposedPair:
    """Two fingers whose tips close towards each other, SI, hand frame."""

    fingers: tuple[int, int]
    """The second stands for the thumb."""
    commands_rad: tuple[np.ndarray, np.ndarray]
    """Of each of the two all fingers', (finger, step, joint): it closes, the others stay."""
    axes: np.ndarray
    """Columns: the way from the first tip to the second, the third, and the approach, (3, 3)."""
    middle_m: np.ndarray
    """Between the open tips, (3,)."""
    ball_m: tuple[float, float]
    """Radii of both fingertips, pads included."""
    widest_half_m: float
    """Half the chord that the open fingertips can stand astride with some room."""
    half_m: np.ndarray
    """Half chords, rising, (sample,), at which the tips, on their way, are by `deep_m` (sample,)
    farther along the approach than the middle."""
    deep_m: np.ndarray
    rest_m: np.ndarray
    """Places of the open hand of which one may be its lowest, (place, 3), and the radii about them,
    (place,)."""
    rest_radius_m: np.ndarray

    @property
    def open_rad(self) -> np.ndarray:
        """Both fingers open, (finger, step 1, joint)."""
        return self.commands_rad[0][:, :1]


_INDEX, _THUMB = 0, 3
_POKE_LEAN_RAD = radians(57)
"""The fingertip leads folded thumb and palm."""
_CLOSED_DEG = 30.0
_CLOSING_STEPS = 81
_ROOM_M = 0.0093
"""Of a chord as wide as the open fingertips can stand astride, to either side [est]."""
_OPEN_DEG = -10.0


def _posture(*fingers_deg: tuple[float, float, float, float]) -> np.ndarray:
    """Joint commands (finger 4, step 1, 4) [rad]."""
    return np.radians(np.asarray(fingers_deg, float))[:, None, :]


_POKE_RAD = _posture((0, 0, 0, 0), (0, -10, 95, 95), (0, -10, 95, 95), (0, 10, 95, 95))
"""Index finger extended, the others folded."""
_PINCH_OPEN_RAD = _posture((0, _OPEN_DEG, 0, 0), (0, 30, 95, 95), (0, 30, 95, 95),
                           (0, _OPEN_DEG, 0, 0))
"""Index finger and thumb opened wide; others fold. The index finger abducts to face the thumb."""


def index_abduction_rad(hand: HandTable) -> float:
    """By how much the straight index finger turns aside for its tip to face the thumb's; NaN where
    it is too short."""
    share = hand.finger_spacing_m / (hand.abduction_offset_m + sum(hand.link_length_m))
    return asin(share) if share <= 1.0 else nan


def utah_mit_extended(hand: HandTable, pads: PadTable) -> ExtendedFinger:
    """The Utah-MIT hand with its index finger extended."""
    tip = np.array([-hand.palm_gap_m / 2, -hand.finger_spacing_m,
                    hand.abduction_offset_m + sum(hand.link_length_m)])
    return ExtendedFinger(_INDEX, _POKE_RAD, np.eye(3), tip,
                          hand.link_radius_m + pads.thickness_m, _POKE_LEAN_RAD)


def utah_mit_opposed(hand: HandTable, pads: PadTable) -> OpposedPair | None:
    """Its index finger and thumb, each straight, closing from its base: half a degree a step, a
    millimetre at the fingertip. None where the index finger's limit of abduction keeps it from
    facing the thumb."""
    abduction = index_abduction_rad(hand)
    if not abduction <= hand.abduction_limit_rad[1]:
        return None
    index, thumb = (np.repeat(_PINCH_OPEN_RAD, _CLOSING_STEPS, axis=1) for _ in range(2))
    for commands, finger in ((index, _INDEX), (thumb, _THUMB)):
        commands[_INDEX, :, 0] = abduction
        commands[finger, :, 1] = np.radians(np.linspace(_OPEN_DEG, _CLOSED_DEG, _CLOSING_STEPS))
    reach = (hand.abduction_offset_m + sum(hand.link_length_m)) * cos(abduction)
    ball = hand.link_radius_m + pads.thickness_m
    opened = hand.palm_gap_m / 2 - reach * sin(radians(_OPEN_DEG))
    tips = np.array([[-opened, 0.0, 0.0], [opened, 0.0, 0.0]])
    tips[:, 2] = reach * cos(radians(_OPEN_DEG))
    return OpposedPair((_INDEX, _THUMB), (index, thumb), np.eye(3), np.array([0.0, 0.0, reach]),
                       (ball, ball), opened - ball - _ROOM_M, np.zeros(1), np.zeros(1), tips,
                       np.full(2, ball))
