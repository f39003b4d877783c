"""Waypoint families: hand poses around an object of roughly known place and size.

A family places poses about the bounding cylinder or box given as prior (place, size, height, all
with errors). The hand's z axis is its approach direction; `tilt` is the angle between the approach
and straight down (0: from above, 90 deg: level); `azimuth` is where the hand stands around the
object, 0 being the side of the robot's base, of a box the face there; `roll` turns the hand about
its approach, 0 having the fingers close horizontally. `aim` is the height aimed at, as a fraction
of the object's; `aim_out` moves that point from the axis towards the hand, 1 being the rim.
"""

from dataclasses import dataclass, field, replace
from math import pi, radians
from typing import Any

import numpy as np

from warpgrasp.core.array_checks import check_array, check_finite
from warpgrasp.spec_words import number, spec_words

PRIOR_MARGIN_M = 0.03
"""How far objects may reach beyond their prior, at least: three standard deviations of each of its
numbers by default."""


class WaypointError(ValueError):
    """A waypoint table or file that cannot be used; the message says where and what is right."""


@dataclass(frozen=True)
class BoundingCylinder:
    """The prior of each object: upright cylinders on the table, shape (world,)."""

    x_m: np.ndarray
    y_m: np.ndarray
    radius_m: np.ndarray
    height_m: np.ndarray
    margin_m: float = field(default=PRIOR_MARGIN_M, kw_only=True)
    """How far the object may reach beyond it: three standard deviations of each of its numbers, and
    at least `PRIOR_MARGIN_M`, for fits err too."""

    def __post_init__(self) -> None:
        shapes = [np.shape(v) for v in (self.x_m, self.y_m, self.radius_m, self.height_m)]
        if len(set(shapes)) > 1 or len(shapes[0]) != 1:
            raise ValueError(f"{type(self).__name__}: x_m, y_m, radius_m, height_m are of shapes "
                             f"{', '.join(map(str, shapes))}; should be (world,) each")

    @property
    def worlds(self) -> int:
        """Number of worlds."""
        return len(self.x_m)

    def larger(self, by_m: np.ndarray | float, least_m: float) -> "BoundingCylinder":
        """With radius, or half sides, and height larger `by_m` (world,); where that is negative the
        height stays, and the others keep `least_m`."""
        return replace(self, radius_m=np.maximum(self.radius_m + by_m, least_m),
                       height_m=self.height_m + np.maximum(by_m, 0.0))

    def half_width(self, angle: np.ndarray) -> np.ndarray:
        """From the axis to the side seen along a level direction [m].

        `angle` (world, pose) is that direction's azimuth in the base frame [rad].
        """
        return np.broadcast_to(self.radius_m[:, None], angle.shape)

    def front(self) -> np.ndarray:
        """The azimuth of the side that faces the robot's base [rad], (world,)."""
        return np.arctan2(-self.y_m, -self.x_m)


@dataclass(frozen=True)
class BoundingBox(BoundingCylinder):
    """An upright box as prior; `radius_m` is that of the cylinder around it."""

    half_m: np.ndarray
    """Half its length and half its width, (world, 2)."""
    yaw_rad: np.ndarray
    """Azimuth of its length, (world,)."""

    def larger(self, by_m: np.ndarray | float, least_m: float) -> "BoundingBox":
        """As of a cylinder."""
        half = self.half_m + np.broadcast_to(by_m, self.x_m.shape)[:, None]
        whole = super().larger(by_m, least_m)
        return replace(whole, half_m=np.maximum(half, least_m))  # type: ignore[return-value]

    def half_width(self, angle: np.ndarray) -> np.ndarray:
        """From the axis to the side seen along a level direction [m], (world, pose)."""
        turned = angle - self.yaw_rad[:, None]
        return (self.half_m[:, :1] * np.abs(np.cos(turned))
                + self.half_m[:, 1:] * np.abs(np.sin(turned)))

    def front(self) -> np.ndarray:
        """The azimuth of the face nearest to facing the robot's base [rad], (world,)."""
        turned = super().front() - self.yaw_rad
        return np.asarray(self.yaw_rad + np.round(turned / (pi / 2)) * (pi / 2))


def check_prior(prior: BoundingCylinder) -> None:
    """Raise ValueError or TypeError for a prior that is no cylinder or box: of numbers that are not
    finite, or sizes that are not above 0."""
    sizes = ("half_m", "yaw_rad") if isinstance(prior, BoundingBox) else ()
    for name in ("x_m", "y_m", "radius_m", "height_m", *sizes):
        value = getattr(prior, name)
        check_array(f"prior.{name}", value, "numbers",
                    "world 2" if name == "half_m" else "world", world=prior.worlds)
        check_finite(f"prior.{name}", value)
        if name in ("radius_m", "height_m", "half_m") and (value <= 0.0).any():
            world = int(np.argwhere(value <= 0.0)[0, 0])
            raise ValueError(f"prior.{name}: is {value[value <= 0.0][0]:g} m in world {world}; "
                             "should be above 0")


def _unused(default: float) -> Any:
    """A field of `Placement` that says nothing of a family, which has its own."""
    return field(default=default, init=False)


_COUNT = {"low": 1, "high": 256, "doc": "poses"}


@spec_words
@dataclass(frozen=True)
class Placement:
    """What every family shares: how far the palm stays away, which way the hand is turned."""

    palm_clearance_m: float = number(0.040, -0.05, 0.3, "palm to a thin object's prior cylinder")
    clearance_per_radius: float = number(1.5, 0.0, 5.0,
                                         "further away by this times the radius over 20 mm")
    roll_rad: float = number(0.0, -2 * pi, 2 * pi, "turn about the approach direction")
    azimuth_rad: float = number(0.0, -2 * pi, 2 * pi, "azimuth of the first pose")
    tilt_rad: float = number(radians(55), 0.0, pi, "between approach and straight down")
    aim: float = number(0.5, -1.0, 2.0, "height aimed at / height of the object")
    aim_out: float = number(0.0, -2.0, 2.0, "aimed off the axis, towards the hand / radius")


@spec_words
@dataclass(frozen=True)
class Ring(Placement):
    """Poses evenly around the object at one tilt and height."""

    count: int = field(default=6, metadata=_COUNT)


@spec_words
@dataclass(frozen=True)
class Column(Placement):
    """A ring repeated up the object: `count` poses in all, spread over `levels` heights."""

    aim: float = _unused(0.5)
    count: int = field(default=9, metadata=_COUNT)
    levels: int = number(3, 1, 32, "heights, evenly from `aim_low` to `aim_high`")
    aim_low: float = number(0.25, -1.0, 2.0, "lowest height / height of the object")
    aim_high: float = number(0.75, -1.0, 2.0, "highest height / height of the object")


@spec_words
@dataclass(frozen=True)
class Opposing(Placement):
    """Pairs of poses half a turn apart, the pairs evenly turned against each other."""

    count: int = field(default=6, metadata=_COUNT)


@spec_words
@dataclass(frozen=True)
class Top(Placement):
    """Straight from above, the rolls evenly over half a turn."""

    tilt_rad: float = _unused(radians(55))
    count: int = field(default=2, metadata=_COUNT)


@spec_words
@dataclass(frozen=True)
class Random(Placement):
    """Directions even over the part of the sphere above `tilt_rad`, any roll, any height."""

    aim: float = _unused(0.5)
    count: int = field(default=6, metadata=_COUNT)
    aim_low: float = number(0.25, -1.0, 2.0, "lowest height aimed at")
    aim_high: float = number(0.75, -1.0, 2.0, "highest height aimed at")


@spec_words
@dataclass(frozen=True)
class Spiral(Placement):
    """Up the object as on a screw: height rises as the azimuth goes `turns` times around."""

    aim: float = _unused(0.5)
    count: int = field(default=12, metadata=_COUNT)
    turns: float = number(2.0, 0.0, 64.0, "times around from the first pose to the last")
    aim_low: float = number(0.2, -1.0, 2.0, "height aimed at first / height of the object")
    aim_high: float = number(0.9, -1.0, 2.0, "height aimed at last")


@spec_words
@dataclass(frozen=True)
class Hemisphere(Placement):
    """Directions evenly over the part of the sphere above `tilt_rad` (a Fibonacci lattice)."""

    count: int = field(default=12, metadata=_COUNT)


@dataclass(frozen=True)
class Csv:
    """Poses from a file: x_m, y_m, z_m, qx, qy, qz, qw of the hand in the robot's base frame."""

    file: str = field(default="", metadata={"doc": "path, relative to the spec"})


WAYPOINT_KINDS: dict[str, type] = {
    "ring": Ring, "column": Column, "opposing": Opposing, "top": Top, "random": Random,
    "spiral": Spiral, "hemisphere": Hemisphere, "csv": Csv,
}
