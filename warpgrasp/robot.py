"""A batch of robots, each before its own object: what a strategy may do, and what it then feels.

The robot offers guarded moves and no procedure. What truly happened goes to the `Truth` its
maker keeps for the scorer; a strategy is handed the robot, never the truth.

Kernels of lines and cameras are imported when they are first used: most episodes do without.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from warpgrasp.closing.closing import Closing, ClosingTruth
from warpgrasp.closing.contact_estimate import ContactEstimate
from warpgrasp.core.array_checks import (
    check_array,
    check_finite,
    check_kind,
    check_poses,
    check_range,
)
from warpgrasp.core.kernel_launch import check_device
from warpgrasp.core.random import Purpose, counter_key, normal_vector
from warpgrasp.geometry.body import Body, scene_of
from warpgrasp.mechanism.arm_motion import ArmMoves, ArmState
from warpgrasp.motion_cost import closing_time_s
from warpgrasp.objects.body_baking import touched_body
from warpgrasp.parameters import (
    ArmTable,
    ContactTable,
    ErrorTable,
    HandTable,
    PadTable,
    SensorTable,
    StereoTable,
    TrueTables,
)
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot_hand import robot_hand
from warpgrasp.touch.line_touch import LineMove, LineTouch, LineTruth, Until, check_rows

if TYPE_CHECKING:
    from warpgrasp.sight.depth_view import DepthView
    from warpgrasp.sight.silhouette import Cameras

_AXIS = 1  # of the stream of cameras; 0 is of what is wrong with images
_UPRIGHT, _ON_TABLE_M = 1e-6, 1e-6
"""How far an object may lean (x and y of its quaternion), and stand above or in the table."""


@dataclass(frozen=True)
class Grasps:
    """What the robot knows of a batch of grasps. Shapes start with (world, probe)."""

    moves: ArmMoves
    closing: Closing
    estimate: ContactEstimate
    time_s: np.ndarray
    """Arm and finger time of each probe [s]."""
    commands_rad: np.ndarray
    """As closed along, (grasp, finger, step, joint)."""


@dataclass
class Truth:
    """What truly happened, in the order it did: for the scorer alone.

    Raises TypeError and ValueError for other arrays, and ValueError for poses that are no places
    and unit quaternions.
    """

    body_pose: np.ndarray
    """Where the objects truly stand, turned about the vertical, (world, 7)."""
    closings: list[ClosingTruth] = field(default_factory=list)
    lines: list[LineTruth] = field(default_factory=list)
    """Guarded lines, in the order they were made."""

    def __post_init__(self) -> None:
        check_array("body_pose", self.body_pose, "numbers", "world 7")
        check_poses("body_pose", self.body_pose)


def _check_stands(pose: np.ndarray) -> None:
    """Raise ValueError for objects (world, 7) that do not stand upright on the table: it is at
    z = 0 of their own frames, and would come with them."""
    off = (np.abs(pose[:, 3:5]) > _UPRIGHT).any(1) | (np.abs(pose[:, 2]) > _ON_TABLE_M)
    if off.any():
        first = int(off.argmax())
        raise ValueError(f"body_pose: that of world {first} is {pose[first].tolist()}; what is "
                         "touched stands on the table, its z 0 and x and y of its quaternion 0. "
                         "What leans or lies is a body of its own, with turned parts or a stable "
                         "pose")


def _of_closed(closing: Closing, closes: np.ndarray) -> Closing:
    """The closing with fingers that stayed open as NOT_TRIED."""
    made = np.isin(closing.status, (ProbeStatus.CONTACT, ProbeStatus.NO_CONTACT))
    return replace(closing, status=np.where(made & ~closes[:, :, None], ProbeStatus.NOT_TRIED,
                                            closing.status))


class Robot:
    """Robots in lock-step, one a world. All methods take and give arrays with world as axis 0."""

    def __init__(
        self,
        bodies: Sequence[Body],
        body: np.ndarray,
        truth: Truth,
        key: np.ndarray,
        arm: ArmTable,
        hand: HandTable,
        sensors: SensorTable,
        *,
        pads: PadTable | None = None,
        errors: ErrorTable | None = None,
        contact: ContactTable | None = None,
        true: TrueTables | None = None,
        device: str = "cpu",
    ) -> None:
        """`body` (world or 1,) numbers `bodies`; `key` (world,) uint64 seeds all noise, and the
        errors of calibration, whose deviations are those of `errors`. The robot that is has the
        tables `true`; those that are believed where there are none.

        Raises TypeError for tables that are none, and for keys and numbers of bodies that are no
        whole numbers, ValueError for bodies that are none, for a number that none of them has, for
        a device that is not here, for poses, keys and numbers of bodies that are not as many, and
        where `true` moves the hand along its mount, which arm and hand share, or is another hand,
        or where errors could make a factor zero or less; HandError for a hand that cannot be used.
        """
        if not isinstance(bodies, Sequence) or not bodies or not all(
                isinstance(each, Body) for each in bodies):
            raise ValueError(f"bodies: are {bodies!r:.80}; should be a list of Body, such as "
                             '[body_from_name("block")]')
        for name, value, kind in (("truth", truth, Truth), ("arm", arm, ArmTable),
                                  ("hand", hand, HandTable), ("sensors", sensors, SensorTable)):
            check_kind(name, value, kind)
        for name, value, kind in (("pads", pads, PadTable), ("errors", errors, ErrorTable),
                                  ("contact", contact, ContactTable), ("true", true, TrueTables)):
            check_kind(name, value, kind, optional=True)
        check_array("body", body, "whole numbers", "world")
        check_array("key", key, "whole numbers", "world")
        check_range("body", body, 0, len(bodies) - 1)
        check_device(device)
        if len(key) != len(truth.body_pose) or len(body) not in (1, len(key)):
            raise ValueError(f"{len(truth.body_pose)} true poses, {len(key)} keys, {len(body)} "
                             "numbers of bodies; should be one of each a world (or one body)")
        self._scene = scene_of([touched_body(body) for body in bodies], device)
        self._body = body
        self._truth = truth
        self._key = key
        self._device = device
        self._probes_made = np.zeros(len(key), int)
        self._lines_made = np.zeros(len(key), int)
        self._line_count = 0
        self._state = ArmState.home(len(key), arm)
        self.arm, self.hand, self.sensors = arm, hand, sensors
        self.pads = pads or PadTable()
        self.errors = (errors or ErrorTable()).scaled()
        self.contact = contact or ContactTable()
        self._true = true or TrueTables(hand, sensors, self.errors)
        if self._true.hand.mount_length_m != hand.mount_length_m:
            raise ValueError("hand.mount_length_mm cannot differ between truth and belief")
        if self._true.hand.kind != hand.kind:
            raise ValueError("hand.kind cannot differ between truth and belief")
        self._own = robot_hand(hand, sensors, self.contact, self._true)
        self._calibration = self._own.calibration(self._true.errors.scaled(), key)

    @property
    def worlds(self) -> int:
        """Number of worlds."""
        return len(self._key)

    @property
    def line_count(self) -> int:
        """Guarded lines made so far: the number the next one will have."""
        return self._line_count

    def rehearsing(self, rows: np.ndarray | None = None) -> "Robot":
        """A copy that goes on from here, noise and all, and leaves no trace in this one's truth; of
        the worlds `rows` (row,), which may name a world more than once, or of all. Raises TypeError
        and ValueError for rows that are no worlds."""
        rows = np.arange(self.worlds) if rows is None else rows
        check_rows(rows, self.worlds)
        other = copy(self)
        other._truth = Truth(self._truth.body_pose[rows])
        other._key = self._key[rows]
        if len(self._body) > 1:
            other._body = self._body[rows]
        other._calibration = self._calibration.of(rows)
        other._probes_made = self._probes_made[rows]
        other._lines_made = self._lines_made[rows]
        other._state = ArmState(self._state.q_rad[rows])
        return other

    def grasp(
        self, hand_pose: np.ndarray, wanted: np.ndarray, commands_rad: np.ndarray,
        command_count: np.ndarray, room: np.ndarray | None = None,
        closes: np.ndarray | None = None,
    ) -> Grasps:
        """Take the hands to poses in turn; at each, close guarded once along every path.

        `hand_pose` (world, probe, 7) [m], quaternion xyzw; `wanted` (world, probe) bool;
        `commands_rad` (grasp, finger, step, joint), `command_count` (grasp,) steps that count.
        Poses are left out from where the fingers' closings are as many as `room` (world,). `closes`
        (world, probe, finger) bool says which fingers close, all unless given; the others stay
        open, and are NOT_TRIED.

        Raises ValueError for arrays of other shapes, TypeError of other kinds, and ValueError for
        a wanted pose that is no place and unit quaternion, for commands that are not finite, and
        for an object that does not stand upright on the table.
        """
        check_array("hand_pose", hand_pose, "numbers", "world probe 7", world=self.worlds)
        worlds, probes, _ = hand_pose.shape
        check_array("wanted", wanted, "bool", "world probe", world=worlds, probe=probes)
        fingers, joints = self._own.commanded
        check_array("commands_rad", commands_rad, "numbers", "grasp finger step joint",
                    finger=fingers, joint=joints)
        check_range("number of grasps", len(commands_rad), 1, np.iinfo(np.int32).max)
        check_finite("commands_rad", commands_rad)
        if room is not None:
            check_array("room", room, "numbers", "world", world=worlds)
        if closes is None:
            closes = np.ones((1, 1, fingers), bool)
        else:
            check_array("closes", closes, "bool", "world probe finger", world=worlds, probe=probes,
                        finger=fingers)
        check_poses("hand_pose", hand_pose, wanted)
        _check_stands(self._truth.body_pose)
        if room is not None:
            wanted = self._within(room, hand_pose, wanted, commands_rad, closes)
        number = self._numbers(wanted)
        moves, actual = self._move(hand_pose, wanted, commands_rad, number)
        closing, truth = self._own.close(
            self._scene, self._body, self._truth.body_pose, self._key, moves.status, actual,
            commands_rad, command_count, closes=closes, errors=self._calibration,
            probe_number=number,
            device=self._device)
        closing = _of_closed(closing, closes)
        if self.contact.self_contact:
            closing = self._without_self(closing, moves.believed_pose, commands_rad)
        self._truth.closings.append(truth)
        self._probes_made += wanted.sum(1)
        self._state = moves.state
        estimate = self._own.estimate(closing, moves.believed_pose, commands_rad, self.arm,
                                      self.errors, self._device)
        return Grasps(moves, closing, estimate,
                      moves.time_s + closing_time_s(self.arm, closing.status, closing.step,
                                                    commands_rad), commands_rad)

    def _without_self(
        self, closing: Closing, believed_pose: np.ndarray, commands_rad: np.ndarray
    ) -> Closing:
        """The closing with what the robot can tell to be its own fingers or palm named so."""
        own = self._own.own_touches(closing, believed_pose, commands_rad, self.errors, self._device)
        own &= closing.status == ProbeStatus.CONTACT
        return replace(closing, status=np.where(own, ProbeStatus.SELF_CONTACT, closing.status))

    def _numbers(self, wanted: np.ndarray) -> np.ndarray:
        """Each world's own count of its probes, which does not depend on the other worlds."""
        return self._probes_made[:, None] + np.cumsum(wanted, axis=1) - 1

    def _move(
        self, hand_pose: np.ndarray, wanted: np.ndarray, commands_rad: np.ndarray,
        number: np.ndarray,
    ) -> tuple[ArmMoves, np.ndarray]:
        return self._own.move(
            self._scene, self._body, self._truth.body_pose, self.arm, self._key, self._state,
            hand_pose, wanted, commands_rad, errors=self._calibration, probe_number=number,
            device=self._device)

    def _within(self, room: np.ndarray, hand_pose: np.ndarray, wanted: np.ndarray,
                commands_rad: np.ndarray, closes: np.ndarray) -> np.ndarray:
        """Those of the poses wanted before which fewer closings than `room` are made."""
        each = closes.sum(2)
        made = wanted * each * len(commands_rad)
        if (wanted & (np.cumsum(made, axis=1) - made >= room[:, None])).any():  # some are in doubt
            moves, _ = self._move(hand_pose, wanted, commands_rad, self._numbers(wanted))
            made = (moves.status == ProbeStatus.CONTACT).sum(2) * each
        return wanted & (np.cumsum(made, axis=1) - made < room[:, None])

    def guarded_line(
        self, rows: np.ndarray, hand_pose: np.ndarray, direction: np.ndarray, *,
        interval_m: np.ndarray | float, steps: np.ndarray | int, finger: int,
        commands_rad: np.ndarray, until: np.ndarray | Until = Until.CONTACT, checked: bool = False,
    ) -> LineTouch:
        """Move arm or finger along a line in intervals until a pad of `finger` feels.

        Only the worlds `rows` (row,) move; `hand_pose` (row, 7) is where the hand starts,
        `direction` (row, 3) the arm's way in intervals (unit; zero: the arm stays), `commands_rad`
        (finger, step, joint) the joints at each interval, the last held. `until` RELEASE ends when
        the pads feel nothing any more; it, `interval_m` and `steps` are one for all rows, or one a
        row. The way from where the hand is to the start is taken to be
        free, as between retreats; `checked`, the status is COLLISION where the hand, its fingers at
        their first commands, would strike something on the straight way. A finger without pads
        feels nothing: it ends `blocked`.

        Raises TypeError and ValueError for rows that are not each another world, and as `LineMove`;
        ValueError for a pose that is no place and unit quaternion, for an object that does
        not stand upright on the table, and where errors could make the gain of a pad zero or less.
        """
        from warpgrasp.touch.guarded_motion import guarded_line

        if wrong := self._true.errors.misfit():
            raise ValueError(wrong)
        check_rows(rows, self.worlds)
        if len(np.unique(rows)) < len(rows):  # a world's state would be that of one of its lines
            raise ValueError(f"rows: are {rows.tolist()!s:.80}; should name a world only once")
        move = LineMove(rows, self._lines_made[rows], hand_pose, direction, interval_m, steps,
                        finger, commands_rad, until, checked)
        _check_stands(self._truth.body_pose)
        touch, truth, arm_q = guarded_line(
            self._scene, self._body, self._truth.body_pose, self.arm, self.hand, self.sensors,
            self.pads, self._key, self._calibration, self._state.q_rad[rows], move,
            true=self._true, contact=self.contact, device=self._device)
        self._truth.lines.append(truth)
        self._lines_made[rows] += 1
        self._line_count += 1
        q = self._state.q_rad.copy()
        q[rows] = arm_q
        self._state = ArmState(q)
        return touch

    def look(self, cameras: "Cameras", table: StereoTable) -> np.ndarray:
        """What is cut out of the cameras' images as the object, faults of `table` and all, bool
        (world, camera, row, column)."""
        from warpgrasp.sight.silhouette import silhouettes
        from warpgrasp.sight.silhouette_faults import faulty_silhouettes

        seen = silhouettes(self._scene, self._body, self._truth.body_pose, cameras,
                           device=self._device)
        return faulty_silhouettes(seen, self._key, table)

    def look_deep(self, cameras: "Cameras", table: StereoTable) -> "DepthView":
        """What stereo of the first of two cameras (world, camera 2) tells of how far the object is,
        errors and gaps of `table` and all."""
        from warpgrasp.sight.depth_view import seen_depths

        return seen_depths(self._scene, self._body, self._truth.body_pose, cameras, table,
                           self._key, device=self._device)

    def camera_noise(self, size: int, *, axis: bool = False) -> np.ndarray:
        """Standard normals (world, size) for what is read off the cameras' images; others for the
        axis that is seen."""
        key = counter_key(self._key, int(Purpose.CAMERA))
        return normal_vector(counter_key(key, _AXIS) if axis else key, size)
