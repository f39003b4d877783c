"""Hand poses that an adaptive strategy chooses from."""

from dataclasses import replace
from math import radians

import numpy as np

from strategies.poses.hand_poses import waypoint_poses
from strategies.poses.waypoints import PRIOR_MARGIN_M, BoundingCylinder, Placement, Ring, Top
from strategies.recovery.belief import Belief
from strategies.recovery.upright import stand_upright
from warpgrasp.mechanism.arm_reach import pose_reachable

_RIM = Ring(count=6, tilt_rad=radians(50), roll_rad=radians(90), aim=1.0, aim_out=1.0,
            palm_clearance_m=0.080, clearance_per_radius=0.0)
_AROUND = Ring(count=6, tilt_rad=radians(50), palm_clearance_m=0.045, clearance_per_radius=1.0)
POOL: tuple[Placement, ...] = (
    _RIM, replace(_RIM, roll_rad=radians(-90), azimuth_rad=radians(30)), _AROUND,
    replace(_AROUND, azimuth_rad=radians(30), palm_clearance_m=0.030, clearance_per_radius=0.5),
    replace(_AROUND, aim=0.25, azimuth_rad=radians(15)),
    replace(_AROUND, aim=0.8, azimuth_rad=radians(45)),
    Top(count=2),
)
"""Rims from two sides, rings at three heights and two distances, two from above: 38 poses."""

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
            np.clip(stands.radius_m + margin_m, 0.010, belief.prior.radius_m + PRIOR_MARGIN_M),
            np.clip(stands.top_m + np.maximum(margin_m, 0.0), 0.020,
                    belief.prior.height_m + PRIOR_MARGIN_M))
    poses = waypoint_poses(POOL, cylinder, belief.hand, belief.seed)
    return poses, pose_reachable(belief.arm, belief.hand, poses)
