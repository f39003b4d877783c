"""The energy of a finger at rest, written out a second time in NumPy: what `finger_rest` minimises.

    E(q) = 1/2 K |q_cmd - q|^2 + sum over links and obstacles 1/2 k max(0, r - phi(x_link(q)))^2

The obstacles are the body and the table. The nearest point of a link is found by sampling, its
neighbourhood sampled again, and so on: slow, and independent of the kernels' search. Only the
body's distance is shared with them.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.body import Body, distance_to_bodies, scene_of
from warpgrasp.parameters import HandTable

_SAMPLES = 33
_ROUNDS = 5


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

    def __init__(self, body: Body, hand: HandTable, pose: np.ndarray, finger: int) -> None:
        self._scene = _scene(body.content, _Held(body))
        self.hand = hand
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
        for _ in range(_ROUNDS):
            t = low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, _SAMPLES)
            points = start[:, None] + t[..., None] * along[:, None]
            best = self._distance(points)[0].argmin(1)
            low, high = t[rows, np.maximum(best - 1, 0)], t[
                rows, np.minimum(best + 1, _SAMPLES - 1)]
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
        lag = command - q
        return float(0.5 * self.hand.joint_stiffness_Nm_rad * lag @ lag
                     + 0.5 * self.hand.skin_stiffness_N_m * (depth**2).sum())

    def gradient(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        """dE/dq [N m], (4,), the contact forces' moments about the joint axes."""
        state, (places, axes) = self.links(q), self.chain(q)
        total = -self.hand.joint_stiffness_Nm_rad * (command - q)
        origins = np.concatenate([self._base[None], places[:3]])
        for link, obstacle in np.argwhere(state.depth_m > 0.0):
            force = self.hand.skin_stiffness_N_m * state.depth_m[link, obstacle]
            for joint in range(link + 2):
                lever = np.cross(axes[joint], state.point_m[link, obstacle] - origins[joint])
                total[joint] -= force * lever @ state.normal[link, obstacle]
        return total

    def _distance(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, normal = distance_to_bodies(self._scene, np.zeros(1, int),
                                           points.reshape(1, -1, 3))
        return value.reshape(points.shape[:2]), normal.reshape(points.shape)
