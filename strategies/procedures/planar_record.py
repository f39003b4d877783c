"""What the planar explorer is given, and what it returns."""

from dataclasses import dataclass

import numpy as np

from fit.option_checks import check_counts, check_numbers
from strategies.procedures.touches import MissedTips, TouchTable, check_lengths

DIRECTIONS = 4  # along u both ways, then along v both ways


@dataclass(frozen=True)
class PlanarOptions:
    """How a face is crossed [m]."""

    interval_m: float = 0.001
    """Of a guarded line; searches towards the surface go as many whole ones as come nearest."""
    stand_off_m: float = 0.030
    """The approach starts this far before the point given."""
    search_m: float = 0.040
    """And ends this far behind it."""
    step_m: float = 0.006
    """Along the surface."""
    clear_m: float = 0.0015
    """Lifted further once contact is lost."""
    edge_drop_m: float = 0.004
    """No contact this far below the last one: the surface ended or fell away."""
    fall_drop_m: float = 0.006
    """How much further the arm moves towards the surface to find out which."""
    table_clear_m: float = 0.002
    """The fingertip keeps this far from the table."""
    most_steps: int = 60
    """In one direction."""
    most_blocked: int = 3
    """Blocked moves running that end a direction."""

    def __post_init__(self) -> None:
        check_lengths(self, "interval_m", "stand_off_m", "search_m", "step_m", "edge_drop_m",
                      "fall_drop_m")
        check_numbers(self, "clear_m", "table_clear_m", low=-1.0, high=1.0)
        check_counts(self, most_steps=1, most_blocked=1)


@dataclass(frozen=True)
class PlanarExploration:
    """One face of each world's object, explored."""

    touches: TouchTable
    """`part` is the direction, 0 to 3: +u, -u, +v, -v; the first contact counts to 0."""
    reason: np.ndarray
    """EndReason of each world, (world,)."""
    direction_reason: np.ndarray
    """EndReason of each direction, (world, 4)."""
    axes: np.ndarray
    """u, v and the outward normal as given, (world, 3, 3)."""
    rejected: np.ndarray
    """Moves that were blocked without tactile contact, (world,)."""
    touch_count: np.ndarray
    """Guarded lines until contact that were made, felt or not, (world,)."""
    time_s: np.ndarray
    path_m: np.ndarray
    missed: MissedTips
    """Where the finger met nothing."""
