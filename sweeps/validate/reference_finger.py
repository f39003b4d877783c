"""The energy of a finger at rest, written out a second time in NumPy.

    E(q) = 1/2 K |q_cmd - q|^2 + sum over links and obstacles 1/2 k max(0, r - phi(x_link(q)))^2
           + weight of the links + 1/2 k_stop (joints past their stops)^2

What `finger.equilibrium` minimises. The obstacles are the body and the table. The nearest point
of a link is found by sampling, its neighbourhood sampled again, and so on: slow, and independent of
the kernels' search. Only the body's distance is shared with them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations
from typing import Any

import numpy as np
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.parameters import ContactTable, HandTable

_COARSE = 257
_SAMPLES = 17
_ROUNDS = 5
_CREASE_M = 1e-7
"""Places of a link so much nearer or farther than another are equally near to the body."""
_FLUSH_M = 2e-3
"""A stretch of a link equally near and longer than this lies flush with a face."""
_FINE = 2001
_DIRECTIONS = 64
"""Of a force along the surface."""
OVERLAP_M = 5e-4
"""Two skins give less than this where links touch, unless they press with more than 5 N."""


@dataclass(frozen=True, eq=False)
class _Held:
    """A body that does not enter a cache's key."""

    body: Body

    def __hash__(self) -> int:
        return 0

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Held)


@lru_cache(maxsize=16)
def _scene(content: str, held: _Held) -> Any:
    return scene_of([held.body], "cpu")


@dataclass(frozen=True)
class LinkState:
    """Links of one finger against body and table, shapes (link 3, obstacle 2, ...)."""

    depth_m: np.ndarray
    """How far skin is pressed in [m], not positive where free."""
    point_m: np.ndarray
    """Of the link's axis nearest to the obstacle."""
    normal: np.ndarray
    """Of the obstacle there, outward."""


class FingerEnergy:
    """Energy of one finger (number 0 to 3) of a hand held at a pose (7,) in the body's frame."""

    def __init__(self, body: Body, hand: HandTable, pose: np.ndarray, finger: int,
                 contact: ContactTable | None = None) -> None:
        self._scene = _scene(body.content, _Held(body))
        self.hand, contact = hand, contact or ContactTable()
        length, radius = np.array(hand.link_length_m), hand.link_radius_m
        volume = np.pi * radius**2 * length + 4 / 3 * np.pi * radius**3
        self._weight = 9.81 * hand.link_density_kg_m3 * volume * contact.weight
        self._friction = contact.friction
        self._stop = hand.joint_stop_Nm_rad * contact.joint_stops
        self._low = np.array([hand.abduction_limit_rad[0], *hand.flexion_low_rad])
        self._high = np.array([hand.abduction_limit_rad[1], *hand.flexion_high_rad])
        turn = Rotation.from_quat(pose[3:])
        x = hand.palm_gap_m / 2 * (1.0 if finger == 3 else -1.0)
        y = 0.0 if finger == 3 else hand.finger_spacing_m * (finger - 1)
        self._base = pose[:3] + turn.apply([x, y, 0.0])
        self._turn = turn * Rotation.from_euler("z", np.pi if finger == 3 else 0.0)

    def chain(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Flexion joints and tip centre (4, 3), and joint axes (4, 3)."""
        turn = self._turn * Rotation.from_rotvec([-q[0], 0.0, 0.0])
        axes = [self._turn.apply([-1.0, 0.0, 0.0])]
        place = self._base + turn.apply([0.0, 0.0, self.hand.abduction_offset_m])
        places = [place]
        for angle, length in zip(q[1:], self.hand.link_length_m, strict=True):
            axes.append(turn.apply([0.0, 1.0, 0.0]))
            turn = turn * Rotation.from_rotvec([0.0, angle, 0.0])
            place = place + turn.apply([0.0, 0.0, length])
            places.append(place)
        return np.asarray(places), np.asarray(axes)

    def links(self, q: np.ndarray) -> LinkState:
        """Where each link is nearest to body and table."""
        places, _ = self.chain(q)
        start, along = places[:3], places[1:] - places[:3]
        low, high = np.zeros(3), np.ones(3)
        rows, best, points = np.arange(3), np.zeros(3, int), start[:, None]
        for samples in (_COARSE, *[_SAMPLES] * _ROUNDS):
            t = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, samples)
            points = start[:, None] + t[..., None] * along[:, None]
            best = self._distance(points)[0].argmin(1)
            low, high = t[rows, np.maximum(best - 1, 0)], t[
                rows, np.minimum(best + 1, samples - 1)]
        nearest = points[rows, best]
        distance, normal = self._distance(nearest[:, None])
        lower = np.where((along[:, 2] < 0.0)[:, None], places[1:], start)
        gaps = np.stack([distance[:, 0], lower[:, 2]], 1)
        up = np.tile([0.0, 0.0, 1.0], (3, 1))
        return LinkState(self.hand.link_radius_m - gaps, np.stack([nearest, lower], 1),
                         np.stack([normal[:, 0], up], 1))

    def energy(self, q: np.ndarray, command: np.ndarray) -> float:
        """E(q) [J]."""
        depth = np.maximum(self.links(q).depth_m, 0.0)
        lag, past = command - q, q - np.clip(q, self._low, self._high)
        places, _ = self.chain(q)
        height = 0.5 * (places[:-1] + places[1:])[:, 2]
        return float(0.5 * self.hand.joint_stiffness_Nm_rad * lag @ lag
                     + 0.5 * self._stop * past @ past + self._weight @ height
                     + 0.5 * self.hand.skin_stiffness_N_m * (depth**2).sum())

    def drive(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        """The part of dE/dq that is not the obstacles' [N m], (4,): servos, stops, weight."""
        places, axes = self.chain(q)
        past = q - np.clip(q, self._low, self._high)
        total = -self.hand.joint_stiffness_Nm_rad * (command - q) + self._stop * past
        for link, weight in enumerate(self._weight):
            centre = 0.5 * (places[link] + places[link + 1])
            total = total + weight * self._lever(link, centre, places, axes)[:, 2]
        return total

    def gradient(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        """dE/dq [N m], (4,), the contact forces' moments about the joint axes."""
        state, (places, axes) = self.links(q), self.chain(q)
        total = self.drive(q, command)
        for link, obstacle in np.argwhere(state.depth_m > 0.0):
            total = total - self._moments(
                int(link), float(state.depth_m[link, obstacle]), state.point_m[link, obstacle],
                state.normal[link, obstacle], places, axes)
        return total

    def slope(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        """The shortest mean of the slopes about q [N m], (4,): zero at any minimum, creases too.

        Where a link has several places equally near (within 0.1 um), or one between two walls, the
        energy is the largest of several smooth ones; each has its slope, and in a minimum some mean
        of them vanishes (Clarke, Optimization and Nonsmooth Analysis, 1983, 2.3).
        """
        state, (places, axes) = self.links(q), self.chain(q)
        fixed = self.drive(q, command)
        for link in np.flatnonzero(state.depth_m[:, 1] > 0.0).tolist():
            fixed = fixed - self._moments(link, state.depth_m[link, 1], state.point_m[link, 1],
                                          state.normal[link, 1], places, axes)
        columns, owners = [], []
        for link in np.flatnonzero(state.depth_m[:, 0] > 0.0).tolist():
            for point, normal in self._equally_near(places[link], places[link + 1]):
                columns.append(-self._moments(link, state.depth_m[link, 0], point, normal, places,
                                              axes))
                owners.append(link)
        if not columns:
            return fixed
        slopes, whole = np.stack(columns, 1), 1e4
        sums = np.stack([np.asarray(owners) == link for link in sorted(set(owners))]) * whole
        weights, _ = nnls(np.concatenate([slopes, sums]),
                          np.concatenate([-fixed, np.full(len(sums), whole)]))
        return fixed + slopes @ weights

    def unheld(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        """The part of dE/dq that no friction can hold [N m], (4,), shortest: zero at any rest.

        Along the surface each contact can bear any force up to the friction coefficient times its
        normal force, here in one of `_DIRECTIONS` directions.
        """
        state, (places, axes) = self.links(q), self.chain(q)
        left, columns, owners, limits = self.gradient(q, command), [], [], []
        angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
        for k, (link, what) in enumerate(np.argwhere(state.depth_m > 0.0)):
            n, depth = state.normal[link, what], float(state.depth_m[link, what])
            n = n / np.linalg.norm(n)
            skin = state.point_m[link, what] - n * (self.hand.link_radius_m - depth)
            one = np.cross(n, np.eye(3)[np.abs(n).argmin()])
            one /= np.linalg.norm(one)
            ways = np.outer(np.cos(angle), one) + np.outer(np.sin(angle), np.cross(n, one))
            columns += [*(self._lever(int(link), skin, places, axes) @ ways.T).T, np.zeros(4)]
            owners += [k] * (_DIRECTIONS + 1)
            # A polygon around the circle.
            limits.append(self._friction * self.hand.skin_stiffness_N_m * depth
                          / np.cos(np.pi / _DIRECTIONS))
        if not columns:
            return left
        forces, whole = np.stack(columns, 1), 1e2
        sums = np.stack([np.asarray(owners) == k for k in range(len(limits))]) * whole
        weights, _ = nnls(np.concatenate([forces, sums]),
                          np.concatenate([-left, whole * np.asarray(limits)]))
        return left + forces @ weights

    def lever(self, link: int, point: np.ndarray, q: np.ndarray) -> np.ndarray:
        """How a point of a link moves as each joint turns [m/rad], (4, 3)."""
        return self._lever(link, point, *self.chain(q))

    def _moments(self, link: int, depth: float, point: np.ndarray, normal: np.ndarray,
                 places: np.ndarray, axes: np.ndarray) -> np.ndarray:
        """What the skin's force at a point turns the joints with [N m], (4,)."""
        return self.hand.skin_stiffness_N_m * depth * (
            self._lever(link, point, places, axes) @ normal)

    def _lever(self, link: int, point: np.ndarray, places: np.ndarray,
               axes: np.ndarray) -> np.ndarray:
        """How a point of a link moves as each joint turns [m/rad], (4, 3)."""
        origins = np.concatenate([self._base[None], places[:3]])
        lever = np.cross(axes, point - origins)
        lever[link + 2:] = 0.0
        return lever

    def _equally_near(self, start: np.ndarray, end: np.ndarray):
        """Places of a link's axis equally near to the body, with normals of all its sides there."""
        t = np.linspace(0.0, 1.0, _FINE)
        gap = self._distance((start + t[:, None] * (end - start))[None])[0][0]
        inner = np.r_[True, gap[1:] <= gap[:-1]] & np.r_[gap[:-1] <= gap[1:], True]
        for k in np.flatnonzero(inner & (gap < gap.min() + 1e-5)):
            point, least = t[k] * (end - start) + start, float(gap[k])
            low, high = t[max(k - 1, 0)], t[min(k + 1, _FINE - 1)]
            for _ in range(_ROUNDS):
                near = np.linspace(low, high, _SAMPLES)
                gaps = self._distance((start + near[:, None] * (end - start))[None])[0][0]
                best = int(gaps.argmin())
                point, least = start + near[best] * (end - start), float(gaps[best])
                low, high = near[max(best - 1, 0)], near[min(best + 1, _SAMPLES - 1)]
            if least < gap.min() + _CREASE_M:
                yield from self._sides(point)
        flush = np.flatnonzero(gap < gap.min() + _CREASE_M)
        for run in np.split(flush, np.flatnonzero(np.diff(flush) > 1) + 1):
            if (t[run[-1]] - t[run[0]]) * np.linalg.norm(end - start) > _FLUSH_M:
                for k in (run[0], run[-1]):
                    yield from self._sides(t[k] * (end - start) + start)

    def _sides(self, point: np.ndarray):
        """The point with each of the body's normals there and just beside it."""
        about = point + _CREASE_M * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
        for normal in np.unique(self._distance(about[None])[1][0].round(9), axis=0):
            yield point, normal

    def _distance(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, normal = distance_to_bodies(self._scene, np.zeros(1, int),
                                           points.reshape(1, -1, 3))
        return value.reshape(points.shape[:2]), normal.reshape(points.shape)


def link_overlap(hand: HandTable, hand_pose: np.ndarray, q_rad: np.ndarray) -> np.ndarray:
    """How deep links of fingers are in those of others at most [m], (hand,), negative where apart.

    `hand_pose` (hand, 7), `q_rad` (hand, finger 4, 4).
    """
    points, _ = hand_links(hand, hand_pose, q_rad)
    share = np.linspace(0.0, 1.0, 13)[:, None]
    a, b = points[:, :, 1:-1, None], points[:, :, 2:, None]
    axes = (a + (b - a) * share).reshape(len(points), 4, -1, 3)
    deepest = np.full(len(points), -1.0)
    for one in range(4):
        for two in range(one + 1, 4):
            apart = np.linalg.norm(axes[:, one, :, None] - axes[:, two, None], axis=-1)
            deepest = np.maximum(deepest, 2 * hand.link_radius_m - apart.reshape(
                len(points), -1).min(1))
    return deepest


def overlap_beyond_skin(fingers: Sequence[FingerEnergy], q_rad: np.ndarray,
                        commands_rad: np.ndarray) -> float:
    """How deep links of a hand at rest are in one another at most [m], less what two skins in
    series give under the force between them.

    That force is what the servos, stops and weight of one of the two fingers ask for, beside what
    it touches of body and table; of the finger that leaves less unexplained. Joints and commands
    (finger, 4). A pair that no force holds apart keeps its whole depth.
    """
    hand, deepest, pressed = fingers[0].hand, 0.0, 0.0
    chains = [finger.chain(q)[0] for finger, q in zip(fingers, q_rad, strict=True)]
    for one, two in combinations(range(len(fingers)), 2):
        for a, b in np.ndindex(3, 3):
            x, y = _nearest(chains[one][a:a + 2], chains[two][b:b + 2])
            apart = float(np.linalg.norm(x - y))
            depth = 2 * hand.link_radius_m - apart
            if depth <= deepest:
                continue
            way = (x - y) / max(apart, 1e-12)
            sides = ((one, a, x, way), (two, b, y, -way))
            fits = [_pressed(fingers[f], q_rad[f], commands_rad[f], link, point, normal)
                    for f, link, point, normal in sides]
            deepest, pressed = depth, min(fits)[1]
    return deepest - 2.0 * pressed / hand.skin_stiffness_N_m


def _pressed(finger: FingerEnergy, q: np.ndarray, command: np.ndarray, link: int,
             point: np.ndarray, normal: np.ndarray) -> tuple[float, float]:
    """Which force [N] along `normal` at a point of a link holds a finger, beside what it touches:
    what it leaves unexplained [N m], and the force."""
    state = finger.links(q)
    columns = [finger.lever(link, point, q) @ normal]
    for other, what in np.argwhere(state.depth_m > 0.0):
        columns.append(finger.lever(int(other), state.point_m[other, what], q)
                       @ state.normal[other, what])
    forces, left = nnls(np.stack(columns, 1), finger.drive(q, command))
    return left, float(forces[0])


def _nearest(one: np.ndarray, two: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where two segments (2, 3) are nearest, by samples of the first, ever closer."""
    along, low, high = two[1] - two[0], 0.0, 1.0
    x = y = one[:1]
    best = 0
    for samples in (_COARSE, *[_SAMPLES] * _ROUNDS):
        t = np.linspace(low, high, samples)
        x = one[0] + t[:, None] * (one[1] - one[0])
        share = np.clip((x - two[0]) @ along / (along @ along), 0.0, 1.0)
        y = two[0] + share[:, None] * along
        best = int(np.linalg.norm(x - y, axis=1).argmin())
        low, high = t[max(best - 1, 0)], t[min(best + 1, samples - 1)]
    return x[best], y[best]
