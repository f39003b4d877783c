"""The energy of a finger of any hand at rest, written out in NumPy from the hand's model alone.

    E(q) = sum 1/2 k_d (command_d - q_d)^2 + sum over capsules and obstacles 1/2 K depth^2
           + weight of the links + 1/2 k_stop (drives past their stops)^2

Frames come from `hands.hand_frames`, which MuJoCo and yourdfpy agree with; the nearest place of a
capsule is found by sampling, again and again about the best. Only the body's distance is shared
with the kernels.
"""

import numpy as np
from scipy.optimize import minimize

from warpgrasp.chain.chain_hand import ChainHand, capsule_ends, link_frames_of
from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of
from warpgrasp.hands.touch_shapes import bulk_of
from warpgrasp.parameters import ContactTable, HandTable

_SAMPLES, _ROUNDS = 65, 6


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
        self.radius = np.array([c.radius for c in hand.capsules[finger]])
        bulks = [bulk_of(joint.shapes) for joint in model.joints]
        self.weight = 9.81 * table.link_density_kg_m3 * contact.weight * np.array(
            [bulk.volume_m3 for bulk in bulks])
        self.centre = np.array([[*bulk.centre_m, 1.0] for bulk in bulks])

    def _padded(self, q: np.ndarray) -> np.ndarray:
        return np.pad(q, (0, self.hand.width - len(q)))

    def depths(self, q: np.ndarray) -> np.ndarray:
        """How deep body and table press into each capsule [m], (capsule, 2); negative: free."""
        ends = capsule_ends(self.hand, self.finger, self._padded(q))
        ends = ends @ self.pose[:3, :3].T + self.pose[:3, 3]
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

    def rest(self, command: np.ndarray, start: np.ndarray) -> np.ndarray:
        """The drives of least energy near `start`."""
        # Stiff across the skin and soft along it: steps of a simplex of a thousandth of a radian.
        found = minimize(lambda d: 1e3 * self.energy(start + 1e-2 * d, command),
                         np.zeros(len(start)), method="Nelder-Mead",
                         options={"xatol": 1e-5, "fatol": 1e-11, "maxiter": 1200,
                                  "initial_simplex": np.vstack([np.zeros(len(start)),
                                                                0.1 * np.eye(len(start))])})
        return start + 1e-2 * found.x
