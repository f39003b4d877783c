"""What is asked of a guarded line, and what it brings; without the kernels that carry it out."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from warpgrasp.core.array_checks import check_array, check_finite, check_poses, check_range

_ROUNDED = 1e-6
"""By how much a unit vector may be longer."""


class Until(IntEnum):
    """What ends a guarded line."""

    CONTACT = 0
    RELEASE = 1
    """A pad that felt feels no more: status NO_CONTACT."""


@dataclass(frozen=True)
class LineTouch:
    """What the robots know of a guarded line. A row for each robot that moved."""

    status: np.ndarray
    """ProbeStatus, shape (row,): CONTACT, NO_CONTACT (spent, or released), BLOCKED, UNREACHABLE,
    COLLISION (the finger is pushed away, or hand strikes, already where the line starts)."""
    link: np.ndarray
    """Link whose pad felt (0 proximal to 2 distal; of a chain its joint), -1 without a touch."""
    point_m: np.ndarray
    """Believed contact, base frame [m], (row, 3); NaN without a touch."""
    normal: np.ndarray
    """Believed outward normal of the surface: against the pad's, (row, 3)."""
    tip_m: np.ndarray
    """Believed place of the fingertip's centre [m], (row, 3)."""
    hand_pose: np.ndarray
    """Believed hand pose at the end, [m] and quaternion xyzw, (row, 7). Of a line whose start
    the arm does not reach it is that start, not where the hand is."""
    q_rad: np.ndarray
    """Joint angles of the finger as read, of a chain its drives', (row, joint)."""
    taxel_peak: np.ndarray
    """Largest count of the pad that felt, or that bore most where the line was blocked; else 0."""
    image: np.ndarray
    """Its counts, uint8, (row, 16, 16)."""
    steps: np.ndarray
    """Intervals made."""
    is_touch: np.ndarray
    """Whether it counts as a touch, felt or not (see `motion_cost`); never one until RELEASE."""
    time_s: np.ndarray
    """Move to the start, the intervals, and the finger's way back to its first command."""
    path_m: np.ndarray
    """Path of the hand's origin, straight to the start and along the intervals [m]."""


@dataclass(frozen=True)
class LineTruth:
    """The true outcome, for the scorer alone."""

    rows: np.ndarray
    """World of each row."""
    q_rad: np.ndarray
    """(row, joint)."""
    point_m: np.ndarray
    """Surface point at the pad's centre of force, base frame [m], (row, 3); NaN without load."""
    normal: np.ndarray
    """Outward surface normal there, (row, 3)."""
    force_N: np.ndarray
    """On all taxels together, (row,)."""
    on_table: np.ndarray
    """Whether the table, not the object, was touched."""
    hand_pose: np.ndarray
    """(row, 7)."""


@dataclass(frozen=True)
class LineMove:
    """One guarded line for some of the worlds, row by row.

    Raises TypeError for what are no numbers, ValueError for arrays of other shapes, numbers that
    are not finite, poses that are no places and unit quaternions, commands of no step, directions
    longer than 1, negative intervals, and steps that are no whole numbers from 0.
    """

    rows: np.ndarray
    """Worlds that move, (row,)."""
    number: np.ndarray
    """How many lines each of them has made before, (row,): seeds the noise."""
    hand_pose: np.ndarray
    """Where the line starts, as believed, [m] and quaternion xyzw, (row, 7)."""
    direction: np.ndarray
    """Way of the arm in one interval, in units of it, base frame, (row, 3): a unit vector, a
    shorter one for shorter intervals, zero where the arm stays."""
    interval_m: np.ndarray | float
    """Of each row, (row,), or of all, as `steps` and `until`."""
    steps: np.ndarray | int
    finger: int
    """Whose pads count; of the Utah-MIT hand 3 is the thumb."""
    commands_rad: np.ndarray
    """Joint commands of all fingers at each interval, (finger, step, joint), the last one held; the
    fingers that do not probe stay at their first."""
    until: np.ndarray | Until = Until.CONTACT
    checked: bool = False
    """Whether the way to the start is looked at: see `Robot.guarded_line`."""

    def __post_init__(self) -> None:
        rows = len(self.rows)
        check_array("hand_pose", self.hand_pose, "numbers", "row 7", row=rows)
        check_poses("hand_pose", self.hand_pose)
        check_array("direction", self.direction, "numbers", "row 3", row=rows)
        check_array("commands_rad", self.commands_rad, "numbers", "finger step joint")
        if self.commands_rad.size == 0:
            raise ValueError(f"commands_rad: of shape {self.commands_rad.shape}; should be of a "
                             "finger, a step (which is held) and a joint at least")
        for name in ("direction", "interval_m", "commands_rad"):
            check_finite(name, getattr(self, name))
        for name in ("interval_m", "steps", "until"):
            if np.shape(value := getattr(self, name)) not in ((), (rows,)):
                raise ValueError(f"{name}: of shape {np.shape(value)}; should be one number, or "
                                 f"one a row, ({rows},)")
        if np.min(self.interval_m, initial=0.0) < 0.0:  # it would be taken off the path
            raise ValueError(f"interval_m: is {np.min(self.interval_m)}; should be 0 or more: the "
                             "direction says which way")
        if (long := np.linalg.norm(self.direction, axis=1) > 1.0 + _ROUNDED).any():
            raise ValueError(f"direction: is {self.direction[long][0].tolist()}; should be of "
                             "length 1 at most")
        check_range("steps", self.steps, 0, np.iinfo(np.int32).max)
        check_range("until", self.until, min(Until), max(Until))


def check_rows(rows: np.ndarray, worlds: int) -> None:
    """Raise TypeError for rows that are no whole numbers, ValueError for those of no world."""
    check_array("rows", rows, "whole numbers", "row")
    check_range("rows", rows, 0, worlds - 1)
