"""The contour follower (Allen and Michelman 1990, section IV-E): the third procedure.

The hand opens around the object near one end of its axis. The thumb closes in steps until its pad
feels, then the index finger; both places are noted, both back off, and arm and hand move a step
along the axis, until a finger finds nothing. The axis is given: vertical, or an orientation that
may be wrong by some degrees; each section's own centre steers the next.

    axis = Axis.upright(prior.x_m, prior.y_m, prior.height_m, prior.radius_m)
    found = explore_contour(robot, axis)
    profile = profile_of(found)                             # strategies.procedures.contour_shape
"""

import numpy as np
from scipy.spatial.transform import Rotation

from fit.rotation import matrix_of_quaternion
from strategies.procedures.contour_record import Axis, ContourExploration, ContourOptions
from strategies.procedures.possible import opposed_of
from strategies.procedures.touches import TABLE_MARGIN_M, EndReason, TouchLog
from warpgrasp.core.array_checks import check_array
from warpgrasp.mechanism.arm_reach import hand_reachable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.robot import Robot
from warpgrasp.touch.line_touch import LineTouch

_PITCH_RAD = np.radians(30)
_AZIMUTHS_RAD = np.radians([0, 25, -25, 50, -50, 75, -75])
_BACK_OFF_M = 0.004
_SHIFT_M = 0.006
_LOW, _HIGH = 2.0, 1.0
"""What a reachable place of the hand is worth at the lower end, and at the upper one."""
_LOWER_END = 3 * _LOW  # for both swings, and the way in for one
_ALL_REACHED = _LOWER_END + 2 * _HIGH
_LONGER, _MORE_SECTIONS, _LEAST_SECTIONS = 1.3, 12, 80  # than the axis is told, and its ends take
_LEAST_REACH = 0.75  # wide objects: fingertips short of the axis by this share of the radius
_FINGERS_PASS = 0.9  # by more, however much the hand is held off, they could pass in front of it


def explore_contour(
    robot: Robot, axis: Axis, *, wanted: np.ndarray | None = None,
    options: ContourOptions | None = None,
) -> ContourExploration:
    """Follow the contours of each world's object along its axis, upwards.

    Worlds where `wanted` (world,) is False are left alone. An axis that cannot be used, or misses
    the object, ends with a reason, never an exception. Raises NotPossible for a hand without an
    opposed pair of fingers, TypeError and ValueError for arrays of other kinds and shapes.
    """
    return _Follower(robot, axis, wanted, options or ContourOptions()).run()


class _Follower:
    def __init__(self, robot: Robot, axis: Axis, wanted: np.ndarray | None,
                 options: ContourOptions) -> None:
        worlds = robot.worlds
        if axis.foot_m.shape != (worlds, 3) or axis.direction.shape != (worlds, 3):
            raise ValueError(f"axis {axis.foot_m.shape}, {axis.direction.shape}: ({worlds}, 3)")
        self.robot, self.axis, self.o = robot, axis, options
        self.pair = opposed_of(robot.hand, robot.pads)
        with np.errstate(over="ignore"):
            length = np.linalg.norm(axis.direction, axis=1)
        numbers = np.column_stack([axis.foot_m, length, axis.length_m, axis.radius_m])
        good = np.isfinite(numbers).all(1) & (length > 1e-9) & (axis.length_m > 0)
        upright = np.where(good[:, None], axis.direction, [0.0, 0.0, 1.0])
        self.along = upright / np.linalg.norm(upright, axis=1, keepdims=True)
        self.foot = np.where(good[:, None], axis.foot_m, 0.0)
        self.radius = np.where(good, axis.radius_m, 0.03)
        self.reason = np.where(good, EndReason.GOING_ON, EndReason.BAD_START)
        # Fingers wrap an axis that stands; a lying one would need the palm above it.
        lying = self.along[:, 2] < np.cos(np.radians(40))
        self.reason[good & lying] = EndReason.UNREACHABLE
        self.along[lying] = [0.0, 0.0, 1.0]
        if wanted is not None:
            check_array("wanted", wanted, "bool", "world", world=worlds)
            self.reason = np.where(wanted, self.reason, EndReason.COMPLETE)
        self.offset = np.zeros((worlds, 3))  # measured centre against the axis as given
        self.backed_off_m = np.zeros(worlds)  # farther away, to clear the object
        self.nearer = np.zeros(worlds, bool)  # this section is tried again, less held off
        self.last = np.full((worlds, 7), np.nan)  # pose of the hand, where it is at the object
        self.place = np.zeros(worlds)  # of the section, along the axis from its foot
        self.step = np.full(worlds, options.step_m)
        self.searching = np.zeros(worlds, bool)  # for the end, by halving
        self.found = np.full(worlds, np.nan)
        self.section = np.zeros(worlds, int)
        enough = np.ceil(_LONGER * np.where(good, axis.length_m, 0.0) / options.step_m)
        self.most_sections = np.maximum(enough.astype(int) + _MORE_SECTIONS, _LEAST_SECTIONS) if (
            options.most_sections is None) else np.full(worlds, options.most_sections)
        self.missed = np.zeros(worlds, int)
        self.rejected = np.zeros(worlds, int)
        self.unfelt = np.zeros(worlds, bool)  # a finger was stopped above the table
        self.touch_count = np.zeros(worlds, int)
        self.time, self.path = np.zeros(worlds), np.zeros(worlds)
        self.frames = np.tile(np.eye(3), (worlds, 2, 1, 1))
        self.log = TouchLog(self.pair.open_rad.shape[2])

    def run(self) -> ContourExploration:
        self._choose_azimuth()
        self._come_around()
        while True:
            rows = np.flatnonzero(self.reason == EndReason.GOING_ON)
            if len(rows) == 0:
                break
            self._take_section(rows)
        self._retreat()
        return ContourExploration(self.log.table(), self.reason, self.axis, self.pair.fingers[1],
                                  self.found, self.rejected, self.touch_count, self.time,
                                  self.path, self.log.missed())

    @property
    def frame(self) -> np.ndarray:
        """Hand axes of the present sections as columns, (world, 3, 3); two sections a turn."""
        return self.frames[np.arange(len(self.frames)), (self.section // 2) % 2]

    def _choose_azimuth(self) -> None:
        """From which side the hand comes, so that the arm reaches both ends of the axis."""
        rows = np.flatnonzero(self.reason == EndReason.GOING_ON)
        if len(rows) == 0:
            return
        best, frames, place = np.full(len(rows), -1.0), self.frames.copy(), self.place
        for azimuth in _AZIMUTHS_RAD:
            left = np.flatnonzero(best < _ALL_REACHED)
            if len(left) == 0:
                break
            ways = [self._inward(azimuth + self.o.swing_rad),
                    self._inward(azimuth - self.o.swing_rad)]
            self.frames = np.stack([self._frame(inward) for inward in ways], 1)
            low = np.maximum(*map(self._lowest, ways))
            score = self._reaches(rows[left], low, np.maximum(0.98 * self.axis.length_m, low))
            better = left[score > best[left]]
            best[left] = np.maximum(best[left], score)
            frames[rows[better]], place[rows[better]] = self.frames[rows[better]], low[rows[better]]
        self.frames, self.place = frames, place
        # At least the lower end, and the way in to it.
        self.reason[rows[best < _LOWER_END]] = EndReason.UNREACHABLE

    def _reaches(self, rows: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """How much of the axis the arm reaches: the lower end and the way in count most."""
        arm, hand = self.robot.arm, self.robot.hand
        score = np.zeros(len(rows))
        for turn in range(2):
            self.section[:] = 2 * turn
            self.place = low
            poses = self._pose(rows)
            behind = poses.copy()
            behind[:, :3] -= self.frame[rows][:, :, 2] * self.o.retreat_m
            score += _LOW * hand_reachable(arm, hand, poses)
            score += _LOW * hand_reachable(arm, hand, behind) * (turn == 0)
            self.place = high
            score += _HIGH * hand_reachable(arm, hand, self._pose(rows))
        self.section[:] = 0
        return score

    def _inward(self, azimuth: float) -> np.ndarray:
        """From the hand to the axis, across it, unit, (world, 3)."""
        bearing = np.arctan2(self.foot[:, 1], self.foot[:, 0]) + azimuth
        level = np.stack([np.cos(bearing), np.sin(bearing), np.zeros_like(bearing)], 1)
        inward = level - (level * self.along).sum(1, keepdims=True) * self.along
        return inward / np.linalg.norm(inward, axis=1, keepdims=True)

    def _lowest(self, inward: np.ndarray) -> np.ndarray:
        """Lowest section at which the hand, pitched and leaning with the axis, clears the table."""
        pair, sin, cos = self.pair, np.sin(_PITCH_RAD), np.cos(_PITCH_RAD)
        across, up, ahead = ((pair.rest_m - pair.middle_m) @ pair.axes).T
        sideways = np.cross(self.along, inward)[:, 2, None]
        sinks = (sin * self.along[:, 2] - cos * inward[:, 2])[:, None]
        rises = (cos * self.along[:, 2] + sin * inward[:, 2])[:, None]
        rest = ahead * sinks - up * rises - across * sideways + pair.rest_radius_m
        tip = np.maximum(max(pair.ball_m), rest.max(1)) + self.o.table_clear_m
        reach = max(self.o.beyond_m) + 0.004
        return (tip + reach * sinks[:, 0] - self.foot[:, 2]) / self.along[:, 2]

    def _frame(self, inward: np.ndarray) -> np.ndarray:
        """Hand axes as columns, (world, 3, 3): x across, z towards the axis and downwards."""
        z = np.cos(_PITCH_RAD) * inward - np.sin(_PITCH_RAD) * self.along
        x = np.cross(self.along, inward)
        return np.stack([x, np.cross(z, x), z], 2)

    def _pose(self, rows: np.ndarray, sideways: float = 0.0) -> np.ndarray:
        """Hand poses astride the axis at the present sections, (row, 7)."""
        pair, frame = self.pair, self.frame[rows]
        z = frame[:, :, 2]
        # Wide objects are held short of their widest: the fingers open only so far.
        wide = np.sqrt(np.maximum(self.radius[rows]**2 - pair.widest_half_m**2, 0.0))
        beyond = np.take(self.o.beyond_m, self.section[rows] % 2) - wide * (
            1.0 + 0.4 * (self.section[rows] % 2))
        beyond = np.maximum(beyond / np.cos(_PITCH_RAD), -_LEAST_REACH * self.radius[rows])
        beyond = np.maximum(beyond - self.backed_off_m[rows], -_FINGERS_PASS * self.radius[rows])
        centre = (self.foot[rows] + self.offset[rows]
                  + self.along[rows] * self.place[rows][:, None])
        # The fingertips, not the hand's middle, are to be at the section's height.
        inward = z - (z * self.along[rows]).sum(1, keepdims=True) * self.along[rows]
        target = centre + inward * beyond[:, None] + frame[:, :, 0] * sideways
        turn = (frame[:, :, None] * pair.axes).sum(-1)
        deeper = np.interp(self.radius[rows], pair.half_m, pair.deep_m)
        place = target - (turn * pair.middle_m).sum(-1) - z * deeper[:, None]
        return np.concatenate([place, Rotation.from_matrix(turn).as_quat()], 1)

    def _come_around(self) -> None:
        """The open hand comes in; where it is barred it is tried again a little to the side."""
        o = self.o
        left = np.flatnonzero(self.reason == EndReason.GOING_ON)
        for sideways in o.sidesteps_m:
            if len(left) == 0:
                return
            z = self.frame[left][:, :, 2]
            pose = self._pose(left, sideways)
            start = pose.copy()
            start[:, :3] -= z * o.retreat_m
            interval = 0.002
            touch = self.robot.guarded_line(
                left, start, z, interval_m=interval, steps=round(o.retreat_m / interval),
                finger=self.pair.fingers[0], commands_rad=self.pair.open_rad,
                checked=sideways != o.sidesteps_m[0])
            self._spend(left, touch)
            self._stand(left, touch)
            stopped = np.isin(touch.status, (ProbeStatus.CONTACT, ProbeStatus.BLOCKED))
            short = o.retreat_m - touch.steps * interval + _BACK_OFF_M
            # Almost there, something of the hand meets the object: a little less deep will do.
            shallow = stopped & (short < 0.6 * self.radius[left] + _BACK_OFF_M)
            free = (touch.status == ProbeStatus.NO_CONTACT) | shallow
            self.offset[left[free]] += self.frame[left[free]][:, :, 0] * sideways
            self.backed_off_m[left[shallow]] += short[shallow]
            self.reason[left[touch.status == ProbeStatus.UNREACHABLE]] = EndReason.UNREACHABLE
            left = left[~free & (touch.status != ProbeStatus.UNREACHABLE)]
        self.reason[left] = EndReason.START_BLOCKED

    def _retreat(self) -> None:
        """The open hand goes out as it came in, as far as the arm reaches: from there the arm goes
        elsewhere. At the end of a tall object that is short, and nothing is in the way."""
        rows = np.flatnonzero(np.isfinite(self.last[:, 0]))
        if len(rows) == 0:
            return
        interval = 0.002
        back = -matrix_of_quaternion(self.last[rows, 3:])[:, :, 2]
        touch = self.robot.guarded_line(
            rows, self.last[rows], back, interval_m=interval,
            steps=round(self.o.retreat_m / interval), finger=self.pair.fingers[0],
            commands_rad=self.pair.open_rad, checked=True)
        self._spend(rows, touch)

    def _stand(self, rows: np.ndarray, touch: LineTouch) -> None:
        """Note where the hand is, in worlds where it came to where the line starts."""
        came = (touch.steps > 0) | ~np.isin(touch.status, (ProbeStatus.UNREACHABLE,
                                                           ProbeStatus.COLLISION))
        self.last[rows[came]] = touch.hand_pose[came]

    def _spend(self, rows: np.ndarray, touch: LineTouch) -> None:
        self.touch_count[rows] += touch.is_touch
        self.time[rows] += touch.time_s
        self.path[rows] += touch.path_m

    def _take_section(self, rows: np.ndarray) -> None:
        """Thumb, then index finger; what they found steers the hand to the next section."""
        pose = self._pose(rows)
        thumb, index = (self._close(rows, pose, which) for which in (1, 0))
        status = np.stack([thumb.status, index.status], 1)
        low = np.stack([thumb.point_m[:, 2], index.point_m[:, 2]], 1) < TABLE_MARGIN_M
        status[low & (status == ProbeStatus.CONTACT)] = ProbeStatus.BLOCKED  # by the table
        both = (status == ProbeStatus.CONTACT).all(1)
        nothing = (status == ProbeStatus.NO_CONTACT).any(1) & ~both
        # Held off from a wider part, one finger may pass in front of a thin one: once more, nearer.
        passed = (nothing & (status == ProbeStatus.CONTACT).any(1) & ~self.nearer[rows]
                  & (self.backed_off_m[rows] > 0.0))
        nothing &= ~passed
        self.nearer[rows] = passed
        self.backed_off_m[rows[passed]] = np.maximum(
            self.backed_off_m[rows[passed]] - _BACK_OFF_M, 0.0)
        gone = (status == ProbeStatus.UNREACHABLE).any(1)
        stopped = ~both & ~nothing & ~gone & ~passed
        blocked = status == ProbeStatus.BLOCKED
        self.rejected[rows] += blocked.sum(1)
        self.unfelt[rows] |= (blocked & ~low).any(1)
        self._steer(rows[both], thumb, index, np.flatnonzero(both))
        self.section[rows] += 1
        self.missed[rows] = np.where(stopped, self.missed[rows] + 1, 0)
        self.reason[rows[gone]] = EndReason.UNREACHABLE
        self.reason[rows[self.missed[rows] >= self.o.most_blocked]] = EndReason.BLOCKED
        self.found[rows[both]] = np.fmax(self.found[rows[both]], self.place[rows[both]])
        # Before the first touch the search goes on along the axis, up to its end.
        never = nothing & np.isnan(self.found[rows])
        nothing &= ~never
        past = rows[never & (self.place[rows] > self.axis.length_m[rows])]
        self.reason[past] = np.where(self.unfelt[past], EndReason.BLOCKED, EndReason.NO_CONTACT)
        self._shift_from(rows[stopped], status[stopped])
        going = ~stopped & ~passed
        self._advance(rows[going], nothing[going])
        self.reason[rows[(self.section[rows] >= self.most_sections[rows])
                         & (self.reason[rows] == EndReason.GOING_ON)]] = EndReason.SPENT

    def _close(self, rows: np.ndarray, pose: np.ndarray, which: int) -> LineTouch:
        finger, commands = self.pair.fingers[which], self.pair.commands_rad[which]
        touch = self.robot.guarded_line(
            rows, pose, np.zeros((len(rows), 3)), interval_m=0.001, steps=commands.shape[1] - 1,
            finger=finger, commands_rad=commands, checked=True)
        self._spend(rows, touch)
        self._stand(rows, touch)
        self.log.miss(rows, touch)
        noted = np.isin(touch.status, (ProbeStatus.CONTACT, ProbeStatus.BLOCKED))
        self.log.add(rows, touch, np.flatnonzero(noted), self.section[rows], finger,
                     self.robot.line_count - 1)
        return touch

    def _shift_from(self, rows: np.ndarray, status: np.ndarray) -> None:
        """A finger that cannot close, or stands against the object, says where the object is."""
        hindered = np.isin(status, (ProbeStatus.BLOCKED, ProbeStatus.COLLISION))
        self.offset[rows] += self.frame[rows][:, :, 0] * (
            _SHIFT_M * hindered @ [1.0, -1.0])[:, None]
        # An open hand that already touches is too narrow here: also hold it farther off.
        self.backed_off_m[rows] += _SHIFT_M * np.where(hindered.all(1), 1.0, 0.5 * (
            status == ProbeStatus.COLLISION).any(1))
        self.place[rows[self.missed[rows] == 2]] += self.o.step_m

    def _steer(self, rows: np.ndarray, thumb: LineTouch, index: LineTouch,
               at: np.ndarray) -> None:
        """Half way to the centre of this section, by the two places and their normals."""
        along = self.along[rows]
        centre, radius = section_circle(thumb.point_m[at], thumb.normal[at], index.point_m[at],
                                        index.normal[at], along)
        axis_point = (self.foot[rows] + self.offset[rows])
        miss = centre - axis_point
        miss -= (miss * along).sum(1, keepdims=True) * along
        size = np.linalg.norm(miss, axis=1, keepdims=True)
        miss *= np.minimum(1.0, 0.015 / np.maximum(size, 1e-9))
        self.offset[rows] += 0.5 * miss
        self.radius[rows] += 0.5 * (np.clip(radius, 0.005, 0.08) - self.radius[rows])

    def _advance(self, rows: np.ndarray, nothing: np.ndarray) -> None:
        """Up a step; at the end half steps back and forth until it is known finely enough."""
        self.searching[rows] |= nothing
        halving = self.searching[rows]
        self.step[rows] = np.where(halving, 0.5 * self.step[rows], self.step[rows])
        self.place[rows] += np.where(nothing, -self.step[rows], self.step[rows])
        ended = halving & (self.step[rows] < self.o.finest_step_m)
        going = self.reason[rows] == EndReason.GOING_ON
        self.reason[rows[ended & going]] = EndReason.END_OF_OBJECT


def section_circle(
    p1: np.ndarray, n1: np.ndarray, p2: np.ndarray, n2: np.ndarray, along: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Circle across `along` through two touches with outward normals, all (n, 3).

    The centre lies at one radius behind both: the radius is the least squares of p1 - p2 against
    n1 - n2. Returns centres (n, 3), at the mean height of the touches, and radii (n,) [m].
    """
    def across(v: np.ndarray) -> np.ndarray:
        return v - (v * along).sum(1, keepdims=True) * along

    m1, m2 = across(n1), across(n2)
    m1 = m1 / np.maximum(np.linalg.norm(m1, axis=1, keepdims=True), 1e-9)
    m2 = m2 / np.maximum(np.linalg.norm(m2, axis=1, keepdims=True), 1e-9)
    apart = across(p1 - p2)
    spread = m1 - m2
    radius = (apart * spread).sum(1) / np.maximum((spread**2).sum(1), 1e-6)
    centre = 0.5 * (p1 + p2 - radius[:, None] * (m1 + m2))
    return centre, radius
