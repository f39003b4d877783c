"""Strategies as a user may write them, good and broken; read by the tests, never imported."""

import numpy as np

from strategies.probes import Grasp
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


@planner("registered-by-a-test", "one ring")
def registered(belief):
    return one_ring(belief)
