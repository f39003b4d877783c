"""The energy of a finger of any hand at rest, written out in NumPy from the hand's model alone.

    E(q) = sum 1/2 k_d (command_d - q_d)^2 + sum over capsules and obstacles 1/2 K depth^2
           + weight of the links + 1/2 k_stop (drives past their stops)^2

Frames come from `hands.hand_frames`, which MuJoCo and yourdfpy agree with; the nearest place of a
capsule is found by sampling, again and again about the best. Only the body's distance is shared
with the kernels.
"""

import numpy as np
from scipy.optimize import minimize, nnls

from warpgrasp.chain.chain_hand import ChainHand, capsule_ends, link_frames_of
from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of
from warpgrasp.parameters import ContactTable, HandTable

_SAMPLES, _ROUNDS = 65, 6
_DIRECTIONS = 32


class ReferenceChain:
    """A finger of a hand held at `pose` (4, 4) in the frame of a body that stands on the table."""

    def __init__(self, body: Body, hand: ChainHand, table: HandTable, pose: np.ndarray,
                 finger: int, contact: ContactTable) -> None:
        self.scene, self.hand, self.pose, self.finger = scene_of([body], "cpu"), hand, pose, finger
        model = hand.model.fingers[finger]
        drives = [model.joints[j] for j in hand.drives[finger]]
        self.stiffness = np.array([joint.stiffness_Nm_rad for joint in drives])
        self.low = np.array([joint.low_rad for joint in drives])
        self.high = np.array([joint.high_rad for joint in drives])
        self.stop = table.joint_stop_Nm_rad * contact.joint_stops
        self.skin = table.skin_stiffness_N_m
        self.friction = contact.friction
        self.radius = np.array([c.radius for c in hand.capsules[finger]])
        bulks = hand.bulks[finger]
        self.weight = 9.81 * table.link_density_kg_m3 * contact.weight * np.array(
            [bulk.volume_m3 for bulk in bulks])
        self.centre = np.array([[*bulk.centre_m, 1.0] for bulk in bulks])

    def _padded(self, q: np.ndarray) -> np.ndarray:
        return np.pad(q, (0, self.hand.width - len(q)))

    def _ends(self, q: np.ndarray) -> np.ndarray:
        """Of the capsules' axes in the body's frame [m], (capsule, 2, 3)."""
        ends = capsule_ends(self.hand, self.finger, self._padded(q))
        return np.asarray(ends @ self.pose[:3, :3].T + self.pose[:3, 3])

    def depths(self, q: np.ndarray) -> np.ndarray:
        """How deep body and table press into each capsule [m], (capsule, 2); negative: free."""
        ends = self._ends(q)
        low, high = np.zeros(len(ends)), np.ones(len(ends))
        nearest = np.zeros(len(ends))
        for _ in range(_ROUNDS):
            share = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, _SAMPLES)
            points = ends[:, :1] + share[..., None] * (ends[:, 1:] - ends[:, :1])
            away = distance_to_bodies(self.scene, np.zeros(1, int), points.reshape(1, -1, 3))[0]
            away = away.reshape(share.shape)
            best = away.argmin(1)
            nearest = away.min(1)
            at, step = share[np.arange(len(ends)), best], (high - low) / (_SAMPLES - 1)
            low, high = np.maximum(at - step, 0.0), np.minimum(at + step, 1.0)
        return np.stack([self.radius - nearest, self.radius - ends[..., 2].min(1)], 1)

    def energy(self, q: np.ndarray, command: np.ndarray) -> float:
        """At drives `q` on a `command` [J]."""
        frames = link_frames_of(self.hand, self.finger, self._padded(q))
        height = np.einsum("ij,kjl,kl->ki", self.pose, frames, self.centre)[:, 2]
        past = q - np.clip(q, self.low, self.high)
        pressed = np.maximum(self.depths(q), 0.0)
        return float(0.5 * (self.stiffness * (command - q) ** 2).sum()
                     + 0.5 * self.skin * (pressed**2).sum() + (self.weight * height).sum()
                     + 0.5 * self.stop * (past**2).sum())

    def slope(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        """Of the energy, by each drive [N m]."""
        return np.array([(self.energy(q + d, command) - self.energy(q - d, command)) / 2e-6
                         for d in 1e-6 * np.eye(len(q))])

    def felt(self, q: np.ndarray) -> np.ndarray:
        """What skin and stops turn the drives by [N m]."""
        weight, self.weight = self.weight, 0.0 * self.weight
        found = np.array([(self.energy(q + d, q + d) - self.energy(q - d, q - d)) / 2e-6
                          for d in 1e-6 * np.eye(len(q))])
        self.weight = weight
        return found

    def contacts(self, q: np.ndarray) -> list[tuple[int, np.ndarray, np.ndarray, float]]:
        """Pressed capsules: the number, the place on its axis that is nearest to body or table in
        the body's frame [m], the normal there, and how deep [m]."""
        found = []
        for c, what in np.argwhere(self.depths(q) > 0.0):
            start, end = self._ends(q)[c]
            share = np.linspace(0.0, 1.0, 20001)[:, None]
            points = start + share * (end - start)
            away, normal = distance_to_bodies(self.scene, np.zeros(1, int), points[None])
            if what:
                away, normal = points[None, :, 2], np.broadcast_to([0.0, 0.0, 1.0], (1, 20001, 3))
            k = away[0].argmin()
            n = normal[0, k] / np.linalg.norm(normal[0, k])
            found.append((int(c), points[k], n, float(self.radius[c] - away[0, k])))
        return found

    def lever(self, c: int, point: np.ndarray, q: np.ndarray) -> np.ndarray:
        """How a point of a capsule moves as each drive turns [m/rad], (drive, 3): differences."""
        joint = self.hand.capsule_joint[self.finger][c]

        def frame(q: np.ndarray) -> np.ndarray:
            return self.pose @ link_frames_of(self.hand, self.finger, self._padded(q))[joint]

        own = np.linalg.solve(frame(q), [*point, 1.0])
        return np.array([((frame(q + d) - frame(q - d)) @ own)[:3] / 2e-6
                         for d in 1e-6 * np.eye(len(q))])

    def unheld(self, q: np.ndarray, command: np.ndarray) -> np.ndarray:
        """The part of the slope that no friction can hold [N m], shortest: zero at any rest.

        Along the surface each contact bears any force up to the friction coefficient times its
        normal force, here in one of `_DIRECTIONS` directions.
        """
        left = self.slope(q, command)
        columns, owners, limits = [], [], []
        angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
        for k, (c, place, n, depth) in enumerate(self.contacts(q)):
            one = np.cross(n, np.eye(3)[np.abs(n).argmin()])
            one /= np.linalg.norm(one)
            ways = np.outer(np.cos(angle), one) + np.outer(np.sin(angle), np.cross(n, one))
            skin = place - n * (self.radius[c] - depth)
            columns += [*(self.lever(c, skin, q) @ ways.T).T, np.zeros(len(q))]
            owners += [k] * (_DIRECTIONS + 1)
            # A polygon around the circle.
            limits.append(self.friction * self.skin * depth / np.cos(np.pi / _DIRECTIONS))
        if not columns:
            return left
        forces, whole = np.stack(columns, 1), 1e2
        sums = np.stack([np.asarray(owners) == k for k in range(len(limits))]) * whole
        weights, _ = nnls(np.concatenate([forces, sums]),
                          np.concatenate([-left, whole * np.asarray(limits)]))
        return np.asarray(left + forces @ weights)

    def rest(self, command: np.ndarray, start: np.ndarray) -> np.ndarray:
        """The drives of least energy near `start`."""
        # Stiff across the skin and soft along it: steps of a simplex of a thousandth of a radian.
        found = minimize(lambda d: 1e3 * self.energy(start + 1e-2 * d, command),
                         np.zeros(len(start)), method="Nelder-Mead",
                         options={"xatol": 1e-5, "fatol": 1e-11, "maxiter": 1200,
                                  "initial_simplex": np.vstack([np.zeros(len(start)),
                                                                0.1 * np.eye(len(start))])})
        return start + 1e-2 * found.x
