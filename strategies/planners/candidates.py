"""Hand poses an adaptive strategy chooses from, and what each would touch if belief were right."""

from dataclasses import replace
from math import radians

import numpy as np

from strategies.poses.hand_poses import waypoint_poses
from strategies.poses.waypoints import PRIOR_MARGIN_M, BoundingCylinder, Placement, Ring, Top
from strategies.procedures.containment import padded_commands
from strategies.recovery.belief import Belief
from strategies.recovery.upright import stand_upright
from warpgrasp.geometry.body import Body, Part
from warpgrasp.geometry.scene import Shape
from warpgrasp.mechanism.arm_reach import pose_reachable
from warpgrasp.parameters import ErrorTable
from warpgrasp.robot import Robot, Truth

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
MOST_TAPER = 0.75
"""Of a body that touches are predicted on: beyond, the simulator's distances to it are so much too
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
            np.clip(stands.radius_m + margin_m, 0.010, belief.prior.radius_m + PRIOR_MARGIN_M),
            np.clip(stands.top_m + np.maximum(margin_m, 0.0), 0.020,
                    belief.prior.height_m + PRIOR_MARGIN_M))
    poses = waypoint_poses(POOL, cylinder, belief.hand, belief.seed)
    return poses, pose_reachable(belief.arm, belief.hand, poses)


def predicted_touches(
    belief: Belief, hand_pose: np.ndarray, wanted: np.ndarray, device: str = "cpu",
) -> tuple[np.ndarray, np.ndarray]:
    """Where the fingers would touch the body believed, without noise.

    `hand_pose` (world, candidate, 7). Returns points [m] (world, candidate, touch, 3) and whether
    there is one, bool (world, candidate, touch): four fingers for each of `belief.closings`, one
    after the other. The closing is that of the simulator, with the threshold that the robot has,
    against the believed superquadric; the true object is not used.
    """
    bodies = [_body_of(belief, world) for world in range(belief.worlds)]
    truth = Truth(np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (belief.worlds, 1)))
    quiet = replace(belief.sensors, tension_noise_N=0.0, joint_noise_rad=0.0, tension_step_N=0.0)
    exact = replace(belief.arm, repeatability_m=0.0)
    robot = Robot(bodies, np.arange(belief.worlds), truth, np.zeros(belief.worlds, np.uint64),
                  exact, belief.hand, quiet, errors=ErrorTable.none(), device=device)
    robot.grasp(hand_pose, wanted, *padded_commands(belief.closings))
    found = truth.closings[-1].point_m
    points = found.reshape(*found.shape[:2], -1, 3)
    return np.nan_to_num(points), np.asarray(np.isfinite(points).all(-1))


def _body_of(belief: Belief, world: int) -> Body:
    """In the base frame: a body's frame has the table at its z = 0."""
    body = belief.body
    taper = np.clip(body.taper, -MOST_TAPER, MOST_TAPER)
    numbers = [float(v) for row in (body.size_m, body.exponents, taper, body.bend)
               for v in row[world]]
    middle = [float(v) for v in body.position_m[world]]
    reach = 2 * float(np.linalg.norm(body.size_m[world]))
    low = (middle[0] - reach, middle[1] - reach, middle[2] - reach)
    high = (middle[0] + reach, middle[1] + reach, middle[2] + reach)
    return Body("believed", (Part(Shape.SUPERQUADRIC, superquadric=tuple(numbers), place=(
        *middle, *(float(v) for v in body.quaternion_xyzw[world]))),), low, high)
