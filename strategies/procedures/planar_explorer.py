"""The planar surface explorer (Allen and Michelman 1990, section IV-D): the second procedure.

With one finger extended the arm approaches a face until the pad feels. From there the finger
crosses the face: a) it lifts until contact is lost, b) steps along the surface, c) comes down until
contact, d) again, until c fails. Then back to the first contact and the opposite way, and both ways
across. A host-side state machine over the whole batch: worlds that are done are not touched again.

    truth = Truth(body_pose)
    robot = Robot([body], np.zeros(1, int), truth, key, ArmTable(), HandTable(), SensorTable())
    found = explore_plane(robot, point_m, outward_normal)   # both (world, 3)
    planes = planes_of(found)                               # strategies.procedures.planar_faces
"""

from collections.abc import Callable
from enum import IntEnum
from math import ceil

import numpy as np

from fit.rotation import matrix_of_quaternion
from strategies.procedures.lean import choose_lean, face_axes, fingertip_from
from strategies.procedures.planar_record import DIRECTIONS, PlanarExploration, PlanarOptions
from strategies.procedures.possible import extended_of
from strategies.procedures.touches import EndReason, TouchLog
from warpgrasp.core.array_checks import check_array
from warpgrasp.mechanism.arm_motion_kernel import RETREAT_M
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Robot
from warpgrasp.touch.line_touch import LineTouch, Until

_TRAVEL_M = 0.004  # guarded intervals of a way back
_OVER_M = 0.008  # and how much higher it leads than others
_TRIES = 3  # each so much higher again
_RELEASE_M = 0.010  # the farthest that a touch is left
_SHORTEST_STEP = 0.15
_TURN_MOST_RAD = np.radians(55)  # a believed normal further off belongs to something else
_ENDED = {ProbeStatus.NO_CONTACT: EndReason.NO_CONTACT,
          ProbeStatus.COLLISION: EndReason.START_BLOCKED,
          ProbeStatus.BLOCKED: EndReason.BLOCKED,
          ProbeStatus.UNREACHABLE: EndReason.UNREACHABLE}
"""What a first approach that touches nothing ends with."""


def explore_plane(
    robot: Robot, point_m: np.ndarray, normal: np.ndarray, *, wanted: np.ndarray | None = None,
    options: PlanarOptions | None = None,
) -> PlanarExploration:
    """Explore one face of each world's object: a point near it and its outward normal, (world, 3).

    Worlds where `wanted` (world,) is False are left alone. A start that cannot be used ends with a
    reason, never an exception. Raises NotPossible for a hand without a pad on a fingertip,
    TypeError and ValueError for arrays of other kinds and shapes.
    """
    return _Explorer(robot, point_m, normal, wanted, options or PlanarOptions()).run()


class _Phase(IntEnum):
    """What the next guarded line of a world is for."""

    APPROACH = 0
    LIFT = 1
    """a: off the face."""
    STEP = 2
    """b: along it."""
    LOWER = 3
    """c: down to it."""
    FURTHER = 4
    """Down, where it is no longer: an edge, or a surface that fell away?"""
    LEAVE = 5
    """Off the face, to go back to the first contact."""
    OVER = 6
    """Level, to above it."""
    RISE = 7
    """Off what was met on that way, to try it higher."""
    DOWN = 8
    """To the first contact."""
    LEAVE_FACE = 9
    """Off the face, for good."""
    RETREAT = 10
    """Out along the hand's axis, as after a grasp: from there the arm goes elsewhere."""


class _Explorer:
    """Each world has one guarded line before it; all of them are made at once, then each world is
    told its next one."""

    def __init__(self, robot: Robot, point: np.ndarray, normal: np.ndarray,
                 wanted: np.ndarray | None, options: PlanarOptions) -> None:
        worlds = robot.worlds
        point, normal = np.asarray(point, float), np.asarray(normal, float)
        if point.shape != (worlds, 3) or normal.shape != (worlds, 3):
            raise ValueError(f"point {point.shape} and normal {normal.shape}: ({worlds}, 3) each")
        self.robot, self.o = robot, options
        self.one = extended_of(robot.hand, robot.pads)
        with np.errstate(over="ignore"):
            length = np.linalg.norm(normal, axis=1)
        good = np.isfinite(point).all(1) & np.isfinite(length) & (length > 1e-9)
        safe = np.where(good[:, None], normal, [0.0, 0.0, 1.0])
        self.axes = face_axes(safe / np.linalg.norm(safe, axis=1, keepdims=True))
        self.point = np.where(good[:, None], point, 0.0)
        self.reason = np.where(good, EndReason.GOING_ON, EndReason.BAD_START)
        if wanted is not None:
            check_array("wanted", wanted, "bool", "world", world=worlds)
            self.reason = np.where(wanted, self.reason, EndReason.COMPLETE)
        self.ending = self.reason.copy()  # what `reason` will be after the retreat
        self.direction_reason = np.zeros((worlds, DIRECTIONS), int)
        self.direction = np.zeros(worlds, int)
        self.place = np.zeros((worlds, 3))  # of the hand, as commanded
        self.stood = np.zeros((worlds, 3))  # the same at the end of the line before
        self.first = np.zeros((worlds, 3))
        self.level = np.zeros(worlds)  # of the last touch of the face, along its normal
        self.fell = np.zeros(worlds, bool)  # whether the last touch was below the face
        self.steps = np.zeros(worlds, int)
        self.blocked = np.zeros(worlds, int)
        self.tries = np.zeros(worlds, int)  # of the way back
        self.rejected = np.zeros(worlds, int)
        self.touch_count = np.zeros(worlds, int)
        self.time, self.path = np.zeros(worlds), np.zeros(worlds)
        self.log = TouchLog(self.one.commands_rad.shape[2])
        self.after = {
            _Phase.APPROACH: self._begin, _Phase.LIFT: self._step, _Phase.STEP: self._lower,
            _Phase.LOWER: self._look_further, _Phase.FURTHER: self._edge,
            _Phase.LEAVE: self._rise_and_go_over, _Phase.OVER: self._come_down,
            _Phase.RISE: self._try_higher, _Phase.DOWN: self._cross_from_first,
            _Phase.LEAVE_FACE: self._retreat, _Phase.RETREAT: self._retreated}
        # The line before each world:
        self.phase = np.full(worlds, _Phase.APPROACH)
        self.way = np.zeros((worlds, 3))
        self.interval = np.zeros(worlds)
        self.intervals = np.zeros(worlds, int)
        self.until = np.full(worlds, Until.CONTACT)

    def run(self) -> PlanarExploration:
        if (going := np.flatnonzero(self.reason == EndReason.GOING_ON)).size:
            self._approach(going)
        begun = False  # the way to the first line comes from a retreat
        while True:
            rows = np.flatnonzero(self.reason == EndReason.GOING_ON)
            if len(rows) == 0:
                break
            self._go_on(rows, self._line(rows, checked=begun))
            begun = True
        return PlanarExploration(self.log.table(), self.reason, self.direction_reason, self.axes,
                                 self.rejected, self.touch_count, self.time, self.path,
                                 self.log.missed())

    def _line(self, rows: np.ndarray, *, checked: bool) -> LineTouch:
        """Make the lines of these worlds."""
        interval = self.interval[rows]
        touch = self.robot.guarded_line(
            rows, np.concatenate([self.place[rows], self.turn[rows]], 1), self.way[rows],
            interval_m=interval, steps=self.intervals[rows], finger=self.one.finger,
            commands_rad=self.one.commands_rad, until=self.until[rows], checked=checked)
        # A line that begins out of reach leaves the hand where it is.
        begun = (touch.status != ProbeStatus.UNREACHABLE) | (touch.steps > 0)
        self.place[rows] = np.where(
            begun[:, None], self.place[rows] + self.way[rows] * (touch.steps * interval)[:, None],
            self.stood[rows])
        self.stood[rows] = self.place[rows]
        self.touch_count[rows] += touch.is_touch
        self.time[rows] += touch.time_s
        self.path[rows] += touch.path_m
        return touch

    def _go_on(self, rows: np.ndarray, touch: LineTouch) -> None:
        """Note what was felt, and tell each world what follows."""
        status, phase = touch.status, self.phase[rows]
        felt, stopped = status == ProbeStatus.CONTACT, status == ProbeStatus.BLOCKED
        strange = felt & (phase == _Phase.STEP) & self._other_surface(rows, touch)
        approach, further = phase == _Phase.APPROACH, phase == _Phase.FURTHER
        to_face = approach | (phase == _Phase.STEP) | (phase == _Phase.LOWER)
        noted = to_face & (felt & ~strange | stopped) | felt & further
        self.log.add(rows, touch, np.flatnonzero(noted), self.direction[rows], self.one.finger,
                     self.robot.line_count - 1)
        self.log.miss(rows, touch, approach | further)
        height = (touch.point_m * self.axes[rows, 2]).sum(1)
        on_face = (to_face | (phase == _Phase.DOWN)) & felt & ~strange
        self.level[rows[on_face]] = height[on_face]
        self.fell[rows] = felt & (self.level[rows] - height > 0.5 * self.o.edge_drop_m)
        self._end_direction(rows[strange], EndReason.OBSTACLE)
        for now in np.unique(phase[~strange]):
            mine = (phase == now) & ~strange
            self.after[now](rows[mine], status[mine])

    def _plan(self, phase: _Phase, rows: np.ndarray, way: np.ndarray, intervals: np.ndarray | int,
              interval: float | None = None, until: Until = Until.CONTACT) -> None:
        """The next line of these worlds; `way` (row, 3) in units of an interval."""
        self.phase[rows], self.way[rows], self.intervals[rows] = phase, way, intervals
        self.interval[rows], self.until[rows] = interval or self.o.interval_m, until

    def _plan_search(self, phase: _Phase, rows: np.ndarray, way: np.ndarray, length: float) -> None:
        """Along `way` (row, 3) until something is touched, for about a length [m]."""
        self._plan(phase, rows, way, max(1, round(length / self.o.interval_m)))

    def _plan_step(self, phase: _Phase, rows: np.ndarray, way: np.ndarray, length: float) -> None:
        """Along `way` (row, 3) for just this length [m], in intervals that are no longer than
        others."""
        steps = max(1, ceil(length / self.o.interval_m - 1e-9))
        self._plan(phase, rows, way * (length / (steps * self.o.interval_m)), steps)

    def _plan_travel(self, phase: _Phase, rows: np.ndarray, way: np.ndarray) -> None:
        """All of `way` (row, 3) [m]."""
        steps = np.maximum(np.ceil(np.linalg.norm(way, axis=1) / _TRAVEL_M).astype(int), 1)
        self._plan(phase, rows, way / (steps * _TRAVEL_M)[:, None], steps, _TRAVEL_M)

    def _plan_release(self, phase: _Phase, rows: np.ndarray) -> None:
        """Off what is touched."""
        interval = 0.5 * self.o.interval_m
        self._plan(phase, rows, self.axes[rows, 2], max(1, round(_RELEASE_M / interval)), interval,
                   Until.RELEASE)

    def _approach(self, rows: np.ndarray) -> None:
        """Choose how the hand leans, to come up to the face and touch it."""
        o, robot = self.o, self.robot
        inward = -self.axes[:, 2]
        pose = np.zeros((robot.worlds, 7))
        pose[:, 6] = 1.0
        pose[rows], reachable = choose_lean(
            robot, self.one, self.point[rows], self.axes[rows], o.stand_off_m)
        self.reason[rows[~reachable]] = EndReason.UNREACHABLE
        self.turn = pose[:, 3:]
        self.tip = fingertip_from(self.one, self.turn)  # the finger stays as it is
        self.place = pose[:, :3] - inward * o.stand_off_m
        self.stood = self.place.copy()
        self._plan_search(_Phase.APPROACH, rows, inward[rows], o.stand_off_m + o.search_m)

    def _begin(self, rows: np.ndarray, status: np.ndarray) -> None:
        self.first[rows] = self.place[rows]
        for code, why in _ENDED.items():
            if code in (ProbeStatus.COLLISION, ProbeStatus.UNREACHABLE):
                self.reason[rows[status == code]] = why  # the hand did not come there
            else:
                self._end(rows[status == code], why)
        self._cross(rows[status == ProbeStatus.CONTACT])

    def _cross(self, rows: np.ndarray) -> None:
        """One more round of a, b, c."""
        self.steps[rows] += 1
        self._plan_release(_Phase.LIFT, rows)

    def _step(self, rows: np.ndarray, _: np.ndarray) -> None:
        o = self.o
        self.place[rows] += self.axes[rows, 2] * o.clear_m
        sign = np.where(self.direction[rows] % 2 == 0, 1.0, -1.0)
        along = self.axes[rows, self.direction[rows] // 2] * sign[:, None]
        share = self._step_above_table(rows, along)
        low = share < _SHORTEST_STEP
        self._end_direction(rows[low], EndReason.TABLE)
        self._plan_step(_Phase.STEP, rows[~low], (along * share[:, None])[~low], o.step_m)

    def _lower(self, rows: np.ndarray, status: np.ndarray) -> None:
        free = self._end_of_line(rows, status)
        self._plan_search(_Phase.LOWER, free, -self.axes[free, 2],
                         self.o.clear_m + 0.001 + self.o.edge_drop_m)

    def _look_further(self, rows: np.ndarray, status: np.ndarray) -> None:
        free = self._end_of_line(rows, status)
        self._plan_search(_Phase.FURTHER, free, -self.axes[free, 2], self.o.fall_drop_m)

    def _edge(self, rows: np.ndarray, _: np.ndarray) -> None:
        """A finger past an edge may still touch it, at the height of the face."""
        fell = self.fell[rows]
        self._end_direction(rows[fell], EndReason.FELL_AWAY)
        self._end_direction(rows[~fell], EndReason.EDGE)

    def _end_of_line(self, rows: np.ndarray, status: np.ndarray) -> np.ndarray:
        """Begin a round, or a direction, where this one is over; the worlds whose line was free.

        A blocked point is rejected, the hand backs off, and the search continues.
        """
        felt, stopped = status == ProbeStatus.CONTACT, status == ProbeStatus.BLOCKED
        free = status == ProbeStatus.NO_CONTACT
        self.blocked[rows[felt]] = 0
        back = rows[stopped]
        self.rejected[back] += 1
        self.blocked[back] += 1
        self.place[back] += self.axes[back, 2] * 2.0 * self.o.clear_m
        barred = stopped & (self.blocked[rows] >= self.o.most_blocked)
        over = (felt | stopped) & ~barred
        spent = over & (self.steps[rows] >= self.o.most_steps)
        self._end_direction(rows[status == ProbeStatus.UNREACHABLE], EndReason.UNREACHABLE)
        self._end_direction(rows[barred | (status == ProbeStatus.COLLISION)], EndReason.BLOCKED)
        self._end_direction(rows[spent], EndReason.SPENT)
        self._cross(rows[over & ~spent])
        return rows[free]

    def _other_surface(self, rows: np.ndarray, touch: LineTouch) -> np.ndarray:
        cosine = (touch.normal * self.axes[rows, 2]).sum(1)
        return cosine < np.cos(_TURN_MOST_RAD)

    def _step_above_table(self, rows: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Share of a step `along` (row, 3) that leaves the fingertip clear of the table."""
        height = self.place[rows, 2] + self.tip[rows, 2]
        lowest = self.one.ball_m + self.o.table_clear_m
        sinks = np.maximum(-along[:, 2], 1e-9) * self.o.step_m
        return np.clip((height - lowest) / sinks, 0.0, 1.0)

    def _end_direction(self, rows: np.ndarray, why: EndReason) -> None:
        """Back to the first contact, and on in the next direction, if there is one.

        Off the face, over it, and down to the first contact: straight back the hand would strike
        what it has just passed. Where something is met on the way, higher; at last it is barred.
        """
        if len(rows) == 0:
            return
        self.direction_reason[rows, self.direction[rows]] = why
        self.direction[rows] += 1
        self.steps[rows], self.blocked[rows], self.tries[rows] = 0, 0, 0
        done = self.direction[rows] >= DIRECTIONS
        self.direction[rows[done]] = DIRECTIONS - 1
        self._end(rows[done], EndReason.COMPLETE)
        self._plan_release(_Phase.LEAVE, rows[~done])

    def _rise_and_go_over(self, rows: np.ndarray, _: np.ndarray) -> None:
        """Up to where the last way down began: that way is known to be free."""
        self.place[rows] += self.axes[rows, 2] * (
            np.maximum(self._below_first(rows), 0.0) + self.o.clear_m)
        self._go_over(rows)

    def _below_first(self, rows: np.ndarray) -> np.ndarray:
        away = self.first[rows] - self.place[rows]
        return (away * self.axes[rows, 2]).sum(1, keepdims=True)

    def _go_over(self, rows: np.ndarray) -> None:
        self.place[rows] += self.axes[rows, 2] * _OVER_M
        self._plan_level(rows)

    def _go_low(self, rows: np.ndarray) -> None:
        """No higher than steps are; in the end from where the hand is."""
        rise = np.maximum(self._below_first(rows) + self.o.clear_m, 0.0)
        self.place[rows] += self.axes[rows, 2] * rise * (self.tries[rows, None] < 2)
        self._plan_level(rows)

    def _plan_level(self, rows: np.ndarray) -> None:
        away = self.first[rows] - self.place[rows]
        self._plan_travel(_Phase.OVER, rows,
                          away - self._below_first(rows) * self.axes[rows, 2])

    def _come_down(self, rows: np.ndarray, status: np.ndarray) -> None:
        """Where the arm reaches no way over, at the height at which it came."""
        free, far = status == ProbeStatus.NO_CONTACT, status == ProbeStatus.UNREACHABLE
        self._plan_release(_Phase.RISE, rows[~free & ~far])
        self._again(rows[far], self._go_low, EndReason.UNREACHABLE)
        rows = rows[free]
        self._plan_travel(_Phase.DOWN, rows, self.first[rows] - self.place[rows])

    def _try_higher(self, rows: np.ndarray, _: np.ndarray) -> None:
        self._again(rows, self._go_over, EndReason.BLOCKED)

    def _again(self, rows: np.ndarray, way: Callable, why: EndReason) -> None:
        """One more way back; after the last these worlds are done."""
        self.tries[rows] += 1
        barred = self.tries[rows] >= _TRIES
        self._bar(rows[barred], why)
        way(rows[~barred])

    def _cross_from_first(self, rows: np.ndarray, status: np.ndarray) -> None:
        """Down to the face a touch is one that is known, and not noted."""
        free = (status == ProbeStatus.NO_CONTACT) | (status == ProbeStatus.CONTACT)
        far = status == ProbeStatus.UNREACHABLE
        self._bar(rows[far], EndReason.UNREACHABLE)
        self._bar(rows[~free & ~far], EndReason.BLOCKED)
        self._cross(rows[free])

    def _bar(self, rows: np.ndarray, why: EndReason) -> None:
        """No way leads back: these worlds are done."""
        self.rejected[rows] += 1
        self._end(rows, why)

    def _end(self, rows: np.ndarray, why: EndReason) -> None:
        """Off the face and to a retreat."""
        self.ending[rows] = why
        self._plan_release(_Phase.LEAVE_FACE, rows)

    def _retreat(self, rows: np.ndarray, _: np.ndarray) -> None:
        self.tries[rows] = 0
        self.place[rows] += self.axes[rows, 2] * self.o.clear_m
        self._plan_retreat(rows)

    def _plan_retreat(self, rows: np.ndarray) -> None:
        forward = matrix_of_quaternion(self.turn[rows])[:, :, 2]
        self._plan_travel(_Phase.RETREAT, rows, -RETREAT_M * forward)

    def _retreated(self, rows: np.ndarray, status: np.ndarray) -> None:
        """Where something is met, from farther off the face; at last the hand stays there."""
        met = np.isin(status, (ProbeStatus.CONTACT, ProbeStatus.BLOCKED, ProbeStatus.COLLISION))
        again = met & (self.tries[rows] < _TRIES)
        self.tries[rows[again]] += 1
        self.place[rows[again]] += self.axes[rows[again], 2] * _OVER_M
        self._plan_retreat(rows[again])
        self._finish(rows[~again])

    def _finish(self, rows: np.ndarray) -> None:
        self.reason[rows] = self.ending[rows]
