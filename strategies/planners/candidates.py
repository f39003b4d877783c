"""Hand poses an adaptive strategy chooses from, and what each would touch if belief were right."""

from dataclasses import replace
from math import radians

import numpy as np

from fit.superquadric.geometry import Superquadric
from strategies.foresight.first_touch import first_touches
from strategies.poses.hand_poses import waypoint_poses
from strategies.poses.waypoints import BoundingCylinder, Placement, Top
from strategies.procedures.possible import check_foreseeable
from strategies.procedures.touches import TABLE_MARGIN_M
from strategies.ready_made import AROUND, CLOSE, RIM, RIM_TURNED
from strategies.recovery.belief import Belief
from strategies.recovery.upright import stand_upright
from warpgrasp.mechanism.arm_reach import pose_reachable

POOL: tuple[Placement, ...] = (
    RIM, RIM_TURNED, AROUND, CLOSE,
    replace(AROUND, aim=0.25, azimuth_rad=radians(15)),
    replace(AROUND, aim=0.8, azimuth_rad=radians(45)),
    Top(count=2),
)
"""Rims from two sides, rings at three heights and two distances, two from above: 38 poses."""
MOST_TAPER = 0.75
"""Of a body that touches are predicted on: beyond, first-order distances to it are so much too
small a little way off that every hand would seem to strike it."""


def candidate_poses(
    belief: Belief, *, about: str = "belief", margin_m: np.ndarray | float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Hand poses (world, candidate, 7) and whether the arm reaches them, bool (world, candidate).

    They stand about the recovered body, or about the prior (`about` "prior"); about one larger
    all around by `margin_m` (world,).
    """
    cylinder = belief.prior
    if about == "belief":
        stands = stand_upright(belief.body)
        cylinder = BoundingCylinder(
            stands.centre_m[:, 0], stands.centre_m[:, 1],
            np.clip(stands.radius_m + margin_m, 0.010, cylinder.radius_m + cylinder.margin_m),
            np.clip(stands.top_m + np.maximum(margin_m, 0.0), 0.020,
                    cylinder.height_m + cylinder.margin_m))
    poses = waypoint_poses(POOL, cylinder, belief.hand, belief.seed)
    return poses, pose_reachable(belief.arm, belief.hand, poses)


def predicted_touches(
    belief: Belief, hand_pose: np.ndarray, wanted: np.ndarray, device: str = "cpu",
) -> tuple[np.ndarray, np.ndarray]:
    """Where the fingers would first meet the body believed.

    `hand_pose` (world, candidate, 7). Returns points [m] (world, candidate, touch, 3) and whether
    there is one, bool (world, candidate, touch): all fingers for each of `belief.closings`, one
    after the other. A finger moves freely until a link meets the body, and rests there. Where the
    open hand would strike body or table on its way, and where a finger would meet the table or
    the body so low that the touch would be taken for the table's, there is none; nor where a link
    grazes the body, which slips past it. Fingers do not meet one another. Raises NotPossible for a
    hand that feels nothing.
    """
    check_foreseeable(belief.hand)
    bodies = belief.body
    points = first_touches(
        Superquadric(*bodies)._replace(taper=np.clip(bodies.taper, -MOST_TAPER, MOST_TAPER)),
        belief.hand, belief.closings, hand_pose, wanted, device)
    points = points.reshape(*hand_pose.shape[:2], -1, 3)
    found = np.nan_to_num(points[..., 2]) > TABLE_MARGIN_M
    return np.where(found[..., None], points, 0.0), found
