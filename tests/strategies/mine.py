"""Strategies as a user may write them, good and broken; read by the tests, never imported."""

import numpy as np

from strategies.oracle import Oracle
from strategies.probes import CrossFaces, Grasp
from strategies.registry import planner
from strategies.waypoint_poses import waypoint_poses
from strategies.waypoints import Ring


def one_ring(belief):
    poses = waypoint_poses((Ring(count=6),), belief.told, belief.hand, belief.seed)
    return [Grasp(poses)] if belief.step == 0 else []


class Several:
    def __init__(self, count: int = 2) -> None:
        self.count = count

    def __call__(self, belief):
        poses = waypoint_poses((Ring(count=6),), belief.told, belief.hand, belief.seed)
        return [Grasp(poses[:, belief.step:belief.step + 1])] if belief.step < self.count else []


def raises(belief):
    poses = one_ring(belief)
    return poses[belief.step + 7]


def wrong_shape(belief):
    return [Grasp(np.zeros((belief.worlds, 7)))]


def not_finite(belief):
    if belief.step > 0:
        return []
    probe = one_ring(belief)[0]
    probe.hand_pose[1::2, 2, 0] = np.nan
    return [probe]


def through_the_table(belief):
    if belief.step > 0:
        return []
    probe = one_ring(belief)[0]
    probe.hand_pose[0, 0, 2] = -0.05
    return [probe]


def never_ends(belief):
    return [Grasp(waypoint_poses((Ring(count=6),), belief.told, belief.hand, belief.seed)[:, :1])]


class Mixed:
    """Worlds of odd seed cross the top first and grasp afterwards, the others grasp at once."""

    def __init__(self) -> None:
        self.asked = 0

    def __call__(self, belief):
        self.asked += 1
        if self.asked > 2:
            return []
        told, odd = belief.told, belief.seed % np.uint64(2) == 1
        poses = waypoint_poses((Ring(count=3),), told, belief.hand, belief.seed)
        grasps = Grasp(poses, np.repeat((odd == (self.asked == 2))[:, None], 3, 1))
        top = np.stack([told.x_m, told.y_m, told.height_m], 1)[:, None]
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
        return one_ring(belief)


class OracleOfMine(Oracle):
    """The oracle under another name."""


@planner("registered-by-a-test", "one ring")
def registered(belief):
    return one_ring(belief)
