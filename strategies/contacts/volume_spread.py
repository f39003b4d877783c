"""From what the robot knows of a recovered body to the spread of its volume.

Least squares know the contacts' own spread and the errors that they share. Of a contour, and of a
superquadric that pads touched, that is enough. Of one that links alone felt it is not, for the true
body is no superquadric; four signs tell how far off it may be: how much was not felt, the contacts
that contradict the body, how much taller the given prior is (a neck that no finger touched is
missing then), and how much of the prior the body leaves empty (a body that fills its prior is a
cylinder or a block; one that leaves most of it empty may have shrunk between its contacts). The
factors are estimates, fitted on simulated episodes (`tests/scripts/interval_factors.py`,
`docs/fit.md`).
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

MOST_OWN, MOST_OF_GRASPS = 1.0, 0.4
MOST_UNFELT, MOST_EMPTY, MOST_MISSING = 4.0, 3.0, 2.0
"""Greater signs count as this great: such bodies have failed. `own_std` of grasps is greater only
where few contacts leave a body open, and the prior knows more then [est]."""
CONTRADICTED_FROM, EMPTY_FROM, UNFELT_FROM = 0.3, 1.5, 4.0
"""Signs from which on an interval is not trusted [est], the last two of bodies felt by grasps
alone; the fourth is an `own_std` of `MOST_OF_GRASPS`, which the interval leaves out."""
SLIVER_FROM = MOST_EMPTY
"""A sign `empty` from which on no interval is trusted, whatever felt the body: it is a twentieth of
the prior, as of touches all on one side [est]."""
OFF_FROM_M = (np.inf, 0.0020, 0.0025)
"""How far contacts lie off a body, root mean square, from which on its interval is not trusted
[est], by `FeltBy`: of pads and of contours then, it is of another kind than the model."""


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
    unfelt: np.ndarray
    """The volume between the surface and one as far outside as the nearest contact is away, over
    the body's; of superquadrics, else 0."""
    contradicted: np.ndarray
    """Share of the contacts that contradict the body."""
    missing: np.ndarray
    """By how much the given prior is taller, as a share of the body's height; at least 0."""
    empty: np.ndarray
    """Logarithm of the volume of the prior cylinder over the body's; at least 0."""


@dataclass(frozen=True)
class Factors:
    """What the signs are multiplied by [est]; of grasps alone, unless they say otherwise."""

    own_of_grasps: float = 1.0
    """Of `own_std`. Not fitted, for one object would decide it: 0.8 has the least interval score,
    but intervals of small bodies then hold less often when errors of calibration are doubled."""
    own_of_pads: float = 1.47
    own_of_contours: float = 0.87
    contours: float = 0.02
    """Of every contour, added: what no surface of revolution is. Not fitted."""
    unfelt: float = 0.091
    contradicted: float = 0.64
    empty: float = 0.046
    """Of the square of `VolumeSigns.empty`."""
    missing_shift: float = 0.65
    """By how much the logarithm of the true volume is greater, of `missing`."""
    empty_shift: float = 0.081
    """The same, of the square of `empty`."""
    pads_shift: float = 0.99
    """The same, of `own_std`, where pads touched a superquadric."""


FACTORS = Factors()


def spread_of_volumes(
    signs: VolumeSigns, factors: Factors = FACTORS
) -> tuple[np.ndarray, np.ndarray]:
    """By how much the logarithm of the true volume is expected to exceed that of the body, and its
    standard deviation, (world,) each."""
    f = factors
    own = np.minimum(signs.own_std, MOST_OWN)
    empty = np.minimum(signs.empty, MOST_EMPTY) ** 2
    # By `FeltBy`.
    shift = np.choose(signs.felt_by, [
        f.missing_shift * np.minimum(signs.missing, MOST_MISSING) + f.empty_shift * empty,
        f.pads_shift * own, np.zeros_like(own)])
    grasped = np.sqrt((f.own_of_grasps * np.minimum(own, MOST_OF_GRASPS)) ** 2
                      + (f.unfelt * np.minimum(signs.unfelt, MOST_UNFELT)) ** 2
                      + (f.empty * empty) ** 2 + (f.contradicted * signs.contradicted) ** 2)
    return shift, np.choose(signs.felt_by, [
        grasped, f.own_of_pads * own, np.hypot(f.own_of_contours * own, f.contours)])


def interval_trusted(signs: VolumeSigns, off_m: np.ndarray) -> np.ndarray:
    """Whether an interval is of a kind that held as often as it says, bool (world,).

    `off_m` (world,) is how far the body's contacts lie off it, root mean square [m]. Intervals of
    bodies felt by grasps alone held in 85 to 95 % of the episodes but of four kinds: bodies that
    many contacts contradict, bodies of which hardly anything was felt, bodies that leave most of
    the prior empty, and bodies that so few contacts hold that least squares know less than the
    prior. Those held in 71 to 80 %. Of bodies that pads felt two kinds are not trusted: those that
    many contacts contradict, and those that contacts lie off. Slivers are not trusted, whatever
    felt them, nor is a sign that is no number.
    """
    sound = ((signs.empty < EMPTY_FROM) & (signs.unfelt < UNFELT_FROM)
             & (signs.own_std < MOST_OF_GRASPS))
    near = ((off_m < np.choose(signs.felt_by, OFF_FROM_M)) & (signs.empty < SLIVER_FROM)
            & np.isfinite(signs.own_std))
    return (signs.contradicted < CONTRADICTED_FROM) & np.where(
        signs.felt_by == FeltBy.GRASPS, sound, near)
