"""Strategies that want different things of worlds, or see what they must not; never imported."""

import numpy as np

from strategies.planners.oracle import Oracle
from strategies.planners.probes import CrossFaces, Grasp
from strategies.poses.hand_poses import waypoint_poses
from strategies.poses.waypoints import Ring


class Mixed:
    """Worlds of odd seed cross the top first and grasp afterwards, the others grasp at once."""

    def __init__(self) -> None:
        self.asked = 0

    def __call__(self, belief):
        self.asked += 1
        if self.asked > 2:
            return []
        prior, odd = belief.prior, belief.seed % np.uint64(2) == 1
        poses = waypoint_poses((Ring(count=3),), prior, belief.hand, belief.seed)
        grasps = Grasp(poses, np.repeat((odd == (self.asked == 2))[:, None], 3, 1))
        top = np.stack([prior.x_m, prior.y_m, prior.height_m], 1)[:, None]
        up = np.tile([0.0, 0.0, 1.0], (belief.worlds, 1, 1))
        return [grasps, CrossFaces(top, up, odd[:, None] & (self.asked == 1))]


class Seer:
    """Has what the oracle has, and would use it."""

    def __init__(self) -> None:
        self.foresee = None
        self.error = None

    def let_see(self, error) -> None:
        self.error = error

    def __call__(self, belief):
        if self.foresee is not None or self.error is not None:
            raise RuntimeError("sees the truth")
        return []


class OracleOfMine(Oracle):
    """The oracle under another name."""
