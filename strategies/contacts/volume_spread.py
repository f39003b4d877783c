"""From what the robot knows of a recovered body to the spread of its volume.

Least squares know the contacts' own spread and the errors that they share. They do not know how far
the true body is from any superquadric or contour. Four signs tell: how thin the body is, for its
surface lies off by about as much everywhere; contacts that contradict it; how much taller the given
prior is, for a neck that no finger touched is missing then; and how much of the prior it leaves
empty, for a body that fills its prior is a cylinder or a block, and one that leaves most of it
empty may be a needle between its contacts. The factors are estimates, fitted on simulated episodes
(`tests/scripts/interval_factors.py`, `docs/fit.md`).
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

OWN = 0.5
"""Of the standard deviation that contacts and their shared errors give. Not fitted: it is large
only where few contacts leave a body open, and one object decided it [est]."""
OFF_M = 0.75e-3
"""By how much the whole surface may lie off, one standard deviation [est]."""
OUTSIDE_PADS_M = 0.45e-3
"""By how much the true surface lies outside one that pads touched; none outside a contour [est]."""
CONTRADICTED, EMPTY = 0.8, 0.08
"""Standard deviations of the logarithm of the volume, of grasps alone: of the share of contacts
that contradict, and of the square of `VolumeSigns.empty` [est]."""
MISSING_SHIFT, EMPTY_SHIFT, ROUND_SHIFT = 0.42, 0.07, 0.10
"""By how much the logarithm of the true volume is greater, of grasps alone: of `missing`, of the
square of `empty`, and of the exponent along the body: flat ends reach farther than any
finger, round ones less far than the object [est]."""
MOST_OWN, MOST_SIDE_PER_M, MOST_EMPTY, MOST_MISSING, MOST_ROUND = 1.0, 500.0, 3.0, 2.0, 1.5
"""Greater signs count as this great: such bodies are none."""


class FeltBy(IntEnum):
    """What a body was felt by, and which model it is."""

    GRASPS = 0
    """A superquadric, felt by links alone."""
    PADS = 1
    """A superquadric, some of whose contacts pads felt."""
    CONTOUR = 2
    """A contour that was followed."""


@dataclass(frozen=True)
class VolumeSigns:
    """What the robot knows of each recovered body. Shapes (world,)."""

    felt_by: np.ndarray
    """`FeltBy`."""
    own_std: np.ndarray
    """Of the logarithm of the volume, by contacts and the errors that they share."""
    side_per_m: np.ndarray
    """Area above the foot over the volume [1/m]."""
    contradicted: np.ndarray
    """Share of the contacts that contradict the body."""
    missing: np.ndarray
    """By how much the given prior is taller, as a share of the body's height; at least 0."""
    empty: np.ndarray
    """Logarithm of the prior's volume over the body's; at least 0."""
    round_end: np.ndarray
    """The exponent along the superquadric."""


def volume_spread(signs: VolumeSigns) -> tuple[np.ndarray, np.ndarray]:
    """By how much the logarithm of the true volume is expected to exceed that of the body, and its
    standard deviation, (world,) each."""
    grasped = signs.felt_by == FeltBy.GRASPS
    side = np.minimum(signs.side_per_m, MOST_SIDE_PER_M)
    empty = np.minimum(signs.empty, MOST_EMPTY) ** 2
    shift = np.where(
        grasped, MISSING_SHIFT * np.minimum(signs.missing, MOST_MISSING) + EMPTY_SHIFT * empty
        + ROUND_SHIFT * np.minimum(signs.round_end, MOST_ROUND),
        np.where(signs.felt_by == FeltBy.PADS, OUTSIDE_PADS_M * side, 0.0))
    variance = (OWN * np.minimum(signs.own_std, MOST_OWN)) ** 2 + (OFF_M * side) ** 2
    variance = variance + grasped * (
        (CONTRADICTED * signs.contradicted) ** 2 + (EMPTY * empty) ** 2)
    return shift, np.sqrt(variance)
