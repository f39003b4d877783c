"""The hand as balls of a link's radius: where it is open, and where its fingers sweep.

A link is taken as balls along its axis, and one thicker than the thinnest, as palm and wrist are,
as balls just within its surface. All places are in the hand's frame and depend on the tables of the
hand alone.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.spatial import ConvexHull

from strategies.foresight.hand_meetings import hand_meetings
from strategies.poses.hand_outline import outline_of
from strategies.procedures.containment import padded_commands
from strategies.procedures.possible import check_foreseeable
from warpgrasp.core.array_checks import check_array, check_finite, check_range
from warpgrasp.hand_capsules import HandCapsules, balls_within, capsules_of_hand
from warpgrasp.parameters import HandTable

STRIDE = 6
"""Steps of half a degree between two places of a finger that are looked at."""
STILL_M = 1e-6
THIN_OPEN, THIN_PLACES, THIN_BALLS = 12, 4, 9
"""A first look takes one of so many balls of the open hand, places of a path and balls of a finger.
Fingertips tell as much as three balls of a finger; of places of a path and of the open hand it
needs more (docs/design_notes/fits.md)."""
APPROACH_M, APPROACH_STEP_M = 0.12, 0.008
"""The way in, and how often it is looked at."""


@dataclass(frozen=True)
class SweptFingers:
    """The fingers along one closing path.

    Raises TypeError and ValueError for other arrays, and for places and fingers that there are not.
    """

    balls_m: np.ndarray
    """Centres, (finger, place, ball, 3)."""
    feels: np.ndarray
    """Which balls feel a touch, bool (finger, ball)."""
    joints_rad: np.ndarray
    """Commands, (finger, place, joint)."""
    met: np.ndarray
    """Place at which each finger touches another or the palm, where nothing is in the way; the
    number of places where none, int (finger,)."""
    meets: np.ndarray
    """The finger it touches there; -1 the palm or none, int (finger,)."""

    def __post_init__(self) -> None:
        check_array("balls_m", self.balls_m, "numbers", "finger place ball 3")
        fingers, places, balls = self.balls_m.shape[:3]
        check_array("feels", self.feels, "bool", "finger ball", finger=fingers, ball=balls)
        for name, least, most in (("met", 0, places), ("meets", -1, fingers - 1)):
            numbers = getattr(self, name)
            check_array(name, numbers, "whole numbers", "finger", finger=fingers)
            check_range(name, numbers, least, most)


@dataclass(frozen=True)
class HandSamples:
    """The open hand, and its fingers along every closing path.

    Raises TypeError and ValueError for other places of the open hand, and such that are not finite.
    """

    open_m: np.ndarray
    """Centres of balls that fill the open hand and its way in, (ball, 3)."""
    radius_m: float
    """Of all balls."""
    swept: tuple[SweptFingers, ...]
    """One for each closing path."""

    def __post_init__(self) -> None:
        check_array("open_m", self.open_m, "numbers", "ball 3")
        check_finite("open_m", self.open_m)

    @cached_property
    def outermost_m(self) -> np.ndarray:
        """Those of `open_m` that no others are around, (corner, 3): the lowest is one of them,
        however the hand is turned."""
        return self.open_m[ConvexHull(self.open_m).vertices]

    @cached_property
    def thinned(self) -> "HandSamples":
        """Fewer samples, for a first look at many poses: the last ball of each finger, and those
        so far before it, at a few places of a path, and of the open hand some that lie far apart.
        """
        return HandSamples(_far_apart(self.open_m, -(-len(self.open_m) // THIN_OPEN)),
                           self.radius_m, tuple(map(_thinned, self.swept)))


def _far_apart(places_m: np.ndarray, count: int) -> np.ndarray:
    """So many of places (place, 3), each the farthest from those before it, the first from all."""
    away = np.linalg.norm(places_m - places_m.mean(0), axis=1)
    chosen = np.array([], int)
    for _ in range(count):
        chosen = np.append(chosen, away.argmax())
        from_last = np.linalg.norm(places_m - places_m[chosen[-1]], axis=1)
        away = from_last if len(chosen) == 1 else np.minimum(away, from_last)
    return places_m[chosen]


def _thinned(swept: SweptFingers) -> SweptFingers:
    kept = np.arange(swept.balls_m.shape[2])[::-THIN_BALLS][::-1]
    return SweptFingers(swept.balls_m[:, ::THIN_PLACES, kept], swept.feels[:, kept],
                        swept.joints_rad[:, ::THIN_PLACES], -(-swept.met // THIN_PLACES),
                        swept.meets)


def samples_of_hand(hand: HandTable, closings: tuple[str, ...]) -> HandSamples:
    """Samples of a hand for its closing paths of these names. Raises NotPossible for a hand that
    feels nothing."""
    check_foreseeable(hand)
    return _samples(capsules_of_hand(hand), closings)


@lru_cache(maxsize=32)
def _samples(capsules: HandCapsules, closings: tuple[str, ...]) -> HandSamples:
    radius = outline_of(capsules.table).skin_m
    commands, count = padded_commands(closings, capsules.table)
    swept = []
    for path, steps in zip(commands, count, strict=True):
        kept = np.append(np.arange(0, steps - 1, STRIDE), steps - 1)
        ends = capsules.places(path[:, kept])
        balls, link = _balls(capsules, ends, radius)
        feels = np.take_along_axis(capsules.feels, link, 1)
        swept.append(SweptFingers(balls, feels, path[:, kept], *hand_meetings(capsules, ends)))
    fingers, link = _balls(capsules, capsules.places(commands[0][:, :1]), radius)
    fingers = fingers[:, 0]
    ahead = fingers[np.take_along_axis(capsules.outer, link, 1)]
    back = APPROACH_STEP_M * np.arange(1, int(APPROACH_M / APPROACH_STEP_M) + 1)
    way = ahead[:, None] - back[:, None] * np.array([0.0, 0.0, 1.0])
    return HandSamples(np.concatenate([way.reshape(-1, 3), fingers.reshape(-1, 3),
                                       capsules.within_m]), radius, tuple(swept))


def _balls(hand: HandCapsules, ends_m: np.ndarray, ball_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Balls of links with axes (finger, place, link, 2, 3): (finger, place, ball, 3), and each
    ball's link, int (finger, ball). A finger with fewer balls than others repeats its last. Of
    fingers that move, links that stand still have none: they are where the open hand is."""
    still = np.ptp(ends_m, axis=1).max((-1, -2)) < STILL_M
    balls, numbers = [], []
    for f, count in enumerate(hand.count):
        moved = [c for c in range(count) if not still[f, c]] or list(range(count))
        own = [balls_within(ends_m[f, :, c], float(hand.radius_m[f, c]), ball_m) for c in moved]
        balls.append(np.concatenate(own, 1))
        numbers.append(np.repeat(moved, [b.shape[1] for b in own]))
    most = max(map(len, numbers))
    found, link = [], []
    for own, number in zip(balls, numbers, strict=True):
        more = most - own.shape[1]
        found.append(np.pad(own, ((0, 0), (0, more), (0, 0)), mode="edge"))
        link.append(np.pad(number, (0, more), mode="edge"))
    return np.stack(found), np.stack(link)


def reached_place(swept: SweptFingers, finger: np.ndarray, q_rad: np.ndarray) -> np.ndarray:
    """Which place of the path is nearest to where fingers (k,) stand, by joints (..., k, joint) as
    read, (..., k)."""
    apart = np.linalg.norm(swept.joints_rad[finger] - q_rad[..., None, :], axis=-1)
    return apart.argmin(-1)
