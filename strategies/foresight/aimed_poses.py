"""Hand poses aimed at the prior's inside and at places beside contacts, clear of the table."""

import numpy as np

from strategies.foresight.aimed_poses_kernel import Aims, aimed_poses_kernel
from strategies.foresight.cpu_launch import launch_on_cpu
from strategies.foresight.hand_samples import HandSamples
from strategies.poses.waypoints import BoundingCylinder
from warpgrasp.core.array_checks import check_array
from warpgrasp.core.random import counter_key

ABOUT_FELT = 0.6
"""Share of the poses about what was felt, once anything was [est]."""
BESIDE_M = 0.045
"""How far from a contact they are aimed at, along each axis [est]."""
CLEARANCE_M = 0.003, 0.009
"""Between the open hand and the table, at least and at most more than that."""
STEEPEST_COS = -0.17
"""Approaches come from above down to ten degrees from below level."""
PALM_AWAY = 0.35, 0.75
"""From the aim to the palm, at least and at most more than that, in reaches of the hand [est]."""
_SHAPES = {"key": "world", "x": "world", "y": "world", "radius": "world", "height": "world",
           "felt": "world contact", "felt_count": "world", "corner": "corner",
           "hand_pose": "world pose"}


def draw_aimed_poses(
    seed: np.ndarray, step: int, count: int, prior: BoundingCylinder, contact_m: np.ndarray,
    felt: np.ndarray, samples: HandSamples, reach_m: float,
) -> np.ndarray:
    """`count` poses of every world, (world, count, 7), by its `seed` uint64 (world,) and the step.

    `contact_m` (world, contact, 3), those that are `felt` (world, contact); `reach_m` is how far
    from the palm fingers reach. Raises TypeError and ValueError for other arrays of contacts.
    """
    worlds = len(seed)
    check_array("felt", felt, "bool", "world contact", world=worlds)
    check_array("contact_m", contact_m, "numbers", "world contact 3", world=worlds,
                contact=felt.shape[1])
    # The contacts of a world in front, so that slots without one do not matter.
    order = np.argsort(~felt, axis=1, kind="stable")[:, :max(felt.sum(1).max(initial=0), 1)]
    in_front = (np.take_along_axis(contact_m, order[..., None], 1) if order.size
                else np.zeros((worlds, 1, 3)))
    poses = np.empty((worlds, count, 7))
    launch_on_cpu(aimed_poses_kernel, {"world": worlds, "pose": count}, _SHAPES,
                  ("hand_pose",), key=counter_key(seed, step), x=prior.x_m, y=prior.y_m,
                  radius=prior.radius_m, height=prior.height_m, felt=in_front,
                  felt_count=felt.sum(1), corner=samples.outermost_m,
                  aims=_aims(samples.radius_m, reach_m), hand_pose=poses)
    return poses


def _aims(radius_m: float, reach_m: float) -> Aims:
    aims = Aims()
    aims.about_felt, aims.beside = ABOUT_FELT, BESIDE_M
    aims.flattest = 1.0 - STEEPEST_COS
    aims.nearest, aims.deeper = (share * reach_m for share in PALM_AWAY)
    aims.clearance, aims.clearer = CLEARANCE_M
    aims.radius = radius_m
    return aims
