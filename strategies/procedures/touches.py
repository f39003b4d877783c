"""The contacts of a procedure that feels with pads: one table for all worlds, a row a touch."""

from dataclasses import dataclass, fields
from enum import IntEnum
from numbers import Real

import numpy as np

from warpgrasp.parameters import TAXELS
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Truth
from warpgrasp.touch.line_touch import LineTouch

TABLE_MARGIN_M = 0.006
"""Contacts believed less than this above the table are taken to be the table."""
SHORTEST_M = 1e-5
"""Of the lengths [m] that a procedure is given."""
SLOTS = 256
"""More than one exploration can make with the options' limits."""


class EndReason(IntEnum):
    """Why an exploration, or one direction of it, ended. Every episode ends with one of these."""

    GOING_ON = 0
    COMPLETE = 1
    """All its parts were done."""
    EDGE = 2
    """The edge was passed: no surface where it should go on, nor a little below."""
    FELL_AWAY = 3
    """The surface goes on, but below the plane felt so far."""
    OBSTACLE = 4
    """Something else stands there: the next touch was on the side of it."""
    TABLE = 5
    """The finger came down to the table."""
    BLOCKED = 6
    """The hand was stopped several times running and no pad felt anything: something else of it may
    have met the object or the table."""
    UNREACHABLE = 7
    """The arm cannot go on within its reach and limits."""
    SPENT = 8
    """The steps allowed were used up."""
    NO_CONTACT = 9
    """The first approach met nothing: the start misses the object."""
    START_BLOCKED = 10
    """The hand strikes something where it starts: a start inside the object, or a wrong normal."""
    BAD_START = 11
    """The start is not finite, its normal or axis has no direction, or the axis no length."""
    END_OF_OBJECT = 12
    """A finger found nothing: the object ends here."""


REASON_TEXT = {
    EndReason.GOING_ON: "not ended",
    EndReason.COMPLETE: "all its parts were done",
    EndReason.EDGE: "the edge was passed: no surface where it should go on, nor a little below",
    EndReason.FELL_AWAY: "the surface goes on, but below the plane felt so far",
    EndReason.OBSTACLE: "something else stands there: the next touch was on the side of it",
    EndReason.TABLE: "the finger came down to the table",
    EndReason.SPENT: "the steps allowed were used up",
    EndReason.NO_CONTACT: "the first approach met nothing: does the start miss the object?",
    EndReason.START_BLOCKED: "the hand strikes something where it starts: is the start inside the "
                             "object, does the normal point into it, or do pads feel where nothing "
                             "is?",
    EndReason.BAD_START: "the start has a number that is not finite, a direction of length 0, or "
                         "an axis whose length is not above 0",
    EndReason.UNREACHABLE: "the arm cannot reach there",
    EndReason.BLOCKED: "the hand was stopped, but no pad felt anything: are the pads dead, or does "
                       "another part of the hand meet the object or the table?",
    EndReason.END_OF_OBJECT: "a finger found nothing: the object ends here",
}
"""The message for a user about an ending."""


@dataclass(frozen=True)
class TouchTable:
    """Touches in the order they were made, a row each; blocked moves are rows without a point."""

    world: np.ndarray
    part: np.ndarray
    """Which part of the procedure: direction of a face, or section along an axis."""
    finger: np.ndarray
    link: np.ndarray
    status: np.ndarray
    """ProbeStatus: CONTACT or BLOCKED."""
    point_m: np.ndarray
    """Believed contact, base frame, (row, 3); NaN where blocked."""
    normal: np.ndarray
    """Believed outward normal, (row, 3)."""
    q_rad: np.ndarray
    """(row, joint)."""
    taxel_peak: np.ndarray
    image: np.ndarray
    """Counts of the pad that felt, or of the distal pad, uint8 (row, 16, 16)."""
    hand_pose: np.ndarray
    """Believed, (row, 7)."""
    line: np.ndarray
    """Which guarded line of the robot, and which row of it: where the scorer finds the truth."""
    line_row: np.ndarray

    def __len__(self) -> int:
        return len(self.world)

    def above_table(self) -> np.ndarray:
        """Which touches are not of the table, bool (row,)."""
        return np.nan_to_num(self.point_m[:, 2]) > TABLE_MARGIN_M

    def sets(self, worlds: int, keep: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Points (world, slot, 3) and mask (world, slot) of the contacts (and `keep`, (row,)).

        Always `SLOTS` slots (a multiple, should a world have more): sums over them must not depend
        on how many touches its neighbours made.
        """
        felt = np.isfinite(self.point_m).all(1)
        felt = felt if keep is None else felt & keep
        world = self.world[felt]
        order = np.argsort(world, kind="stable")
        count = np.bincount(world, minlength=worlds)
        slot = np.empty(len(world), int)
        slot[order] = np.arange(len(world)) - np.repeat(count.cumsum() - count, count)
        most = max(int(count.max(initial=0)), 1)
        points = np.zeros((worlds, -(-most // SLOTS) * SLOTS, 3))
        mask = np.zeros(points.shape[:2], bool)
        points[world, slot], mask[world, slot] = self.point_m[felt], True
        return points, mask


@dataclass(frozen=True)
class MissedTips:
    """Attempted touches without contact, in order, a row each."""

    world: np.ndarray
    tip_m: np.ndarray
    """Believed centre of the fingertip [m], (row, 3)."""


class TouchLog:
    """Gathers touches, and what was missed, while a procedure runs."""

    def __init__(self, joints: int) -> None:
        self._joints = joints
        self._parts: list[TouchTable] = []
        self._missed: list[MissedTips] = []

    def add(
        self, world: np.ndarray, touch: LineTouch, which: np.ndarray, part: np.ndarray,
        finger: int, line: int
    ) -> None:
        """Note rows `which` (indices into `touch`) of worlds `world[which]`."""
        if len(which) == 0:
            return
        self._parts.append(TouchTable(
            world[which], part[which], np.full(len(which), finger), touch.link[which],
            touch.status[which], touch.point_m[which], touch.normal[which], touch.q_rad[which],
            touch.taxel_peak[which], touch.image[which], touch.hand_pose[which],
            np.full(len(which), line), which))

    def miss(self, world: np.ndarray, touch: LineTouch, which: np.ndarray | bool = True) -> None:
        """Note the rows of `touch`, of worlds `world`, whose finger met nothing on its way.

        Of those `which` (row,) alone, if it is given.
        """
        free = which & (touch.status == ProbeStatus.NO_CONTACT) & np.isfinite(touch.tip_m).all(1)
        self._missed.append(MissedTips(world[free], touch.tip_m[free]))

    def missed(self) -> MissedTips:
        """All that was missed so far."""
        parts = [MissedTips(np.zeros(0, int), np.zeros((0, 3))), *self._missed]
        return MissedTips(np.concatenate([p.world for p in parts]),
                          np.concatenate([p.tip_m for p in parts]))

    def table(self) -> TouchTable:
        """All touches so far."""
        names = [field.name for field in fields(TouchTable)]
        if not self._parts:
            none = np.zeros(0, int)
            wide = {"point_m": (3,), "normal": (3,), "q_rad": (self._joints,), "hand_pose": (7,),
                    "image": (TAXELS, TAXELS)}
            return TouchTable(**{name: np.zeros((0, *wide[name])) if name in wide else none
                                 for name in names})
        return TouchTable(**{name: np.concatenate([getattr(p, name) for p in self._parts])
                             for name in names})


def true_touches(table: TouchTable, truth: Truth) -> tuple[np.ndarray, np.ndarray]:
    """True contact points [m] and normals, (row, 3) each, for the scorer; NaN without load."""
    point = np.full((len(table), 3), np.nan)
    normal = point.copy()
    for number in np.unique(table.line):
        rows = np.flatnonzero(table.line == number)
        line = truth.lines[number]
        point[rows] = line.point_m[table.line_row[rows]]
        normal[rows] = line.normal[table.line_row[rows]]
    return point, normal


def check_lengths(options: object, *names: str) -> None:
    """Raises ValueError for options of a procedure whose lengths of these names are no lengths."""
    for name in names:
        value = getattr(options, name)
        if not isinstance(value, Real) or not SHORTEST_M <= float(value) < 1.0:
            raise ValueError(f"{type(options).__name__}.{name} is {value!r}; "
                             f"should be from {SHORTEST_M:g} to 1 m")
