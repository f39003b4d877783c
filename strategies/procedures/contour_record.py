"""What a contour is followed along, how, and what that brings."""

from dataclasses import dataclass

import numpy as np

from fit.option_checks import check_counts, check_number, check_numbers
from strategies.procedures.touches import MissedTips, TouchTable, check_lengths


@dataclass(frozen=True)
class Axis:
    """An axis of exploration in each world, from its lower end up. Shapes start with (world,)."""

    foot_m: np.ndarray
    """Lower end, (world, 3)."""
    direction: np.ndarray
    """Unit, upwards, (world, 3)."""
    length_m: np.ndarray
    radius_m: np.ndarray
    """Rough radius of the object, for how deep the fingers reach around it."""

    @staticmethod
    def upright(x_m: np.ndarray, y_m: np.ndarray, height_m: np.ndarray,
                radius_m: np.ndarray) -> "Axis":
        """Vertical axes standing on the table."""
        zero = np.zeros_like(x_m)
        return Axis(np.stack([x_m, y_m, zero], 1), np.stack([zero, zero, zero + 1.0], 1),
                    height_m, radius_m)

    def turned(self, error_rad: np.ndarray, about_rad: np.ndarray) -> "Axis":
        """The axis as known with an angular error: tipped by `error_rad` towards an azimuth."""
        tip = np.stack([np.cos(about_rad), np.sin(about_rad), np.zeros_like(about_rad)], 1)
        tip -= (tip * self.direction).sum(1, keepdims=True) * self.direction
        tip /= np.linalg.norm(tip, axis=1, keepdims=True)
        return Axis(self.foot_m, np.cos(error_rad)[:, None] * self.direction
                    + np.sin(error_rad)[:, None] * tip, self.length_m, self.radius_m)


@dataclass(frozen=True)
class ContourOptions:
    """How a contour is followed [m]."""

    step_m: float = 0.010
    """Along the axis."""
    finest_step_m: float = 0.0025
    """The end is searched by halving the step down to this."""
    beyond_m: tuple[float, float] = (0.005, -0.003)
    """How far fingertips reach beyond the axis, section by section in turn."""
    swing_rad: float = np.radians(20)
    """The hand stands turned about the axis by this, one way and the other in turn."""
    table_clear_m: float = 0.002
    retreat_m: float = 0.10
    """The hand comes from this far behind its first place."""
    sidesteps_m: tuple[float, ...] = (0.0, 0.012, -0.012, 0.024, -0.024)
    """Tried across the approach until the open fingers come around the object."""
    most_sections: int | None = None
    """As many as the axis is long, and some more, unless given."""
    most_blocked: int = 4
    """Sections running without two touches that end the search."""

    def __post_init__(self) -> None:
        check_lengths(self, "step_m", "finest_step_m", "retreat_m")
        check_numbers(self, "swing_rad", low=-np.pi, high=np.pi)
        check_numbers(self, "table_clear_m", low=-1.0, high=1.0)
        check_counts(self, most_blocked=1)
        if self.most_sections is not None:
            check_counts(self, most_sections=1)
        for name, usual in (("beyond_m", (0.005, -0.003)), ("sidesteps_m", (0.0,))):
            lengths = getattr(self, name)
            if not isinstance(lengths, tuple | list) or len(lengths) < len(usual):
                raise ValueError(f"{name}: {lengths!r}, should be lengths [m] such as {usual}")
            for length in lengths:
                check_number(name, length, low=-1.0, high=1.0)


@dataclass(frozen=True)
class ContourExploration:
    """The contours of each world's object."""

    touches: TouchTable
    """`part` is the section, upwards from 0."""
    reason: np.ndarray
    """EndReason, (world,)."""
    axis: Axis
    """As given."""
    thumb: int
    """The number of the finger that is, or stands for, the thumb; the others are opposed to it."""
    found_m: np.ndarray
    """Highest place of the hand along the axis at which both fingers touched, from its foot,
    (world,). Round tips touch an edge from above, so it may lie a tip's radius above the object."""
    rejected: np.ndarray
    """Closings blocked without tactile contact."""
    touch_count: np.ndarray
    """Guarded lines until contact that were made, felt or not, (world,)."""
    time_s: np.ndarray
    path_m: np.ndarray
    missed: MissedTips
    """Where the finger met nothing."""
