"""Strategies as a user may write them, good and broken; read by the tests, never imported."""

from dataclasses import replace

import numpy as np

from strategies.planners.probes import CrossFaces, FollowContour, Grasp
from strategies.planners.register import planner
from strategies.poses.hand_poses import waypoint_poses
from strategies.poses.waypoints import Ring
from strategies.procedures.contour_record import Axis
from strategies.procedures.planar_record import PlanarOptions


def one_ring(belief):
    poses = waypoint_poses((Ring(count=6),), belief.prior, belief.hand, belief.seed)
    return [Grasp(poses)] if belief.step == 0 else []


class Several:
    def __init__(self, count: int = 2) -> None:
        self.count = count

    def __call__(self, belief):
        poses = waypoint_poses((Ring(count=6),), belief.prior, belief.hand, belief.seed)
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
    return [Grasp(waypoint_poses((Ring(count=6),), belief.prior, belief.hand, belief.seed)[:, :1])]


@planner("registered-by-a-test", "one ring")
def registered(belief):
    return one_ring(belief)


def answers_with_none(belief):
    return None


def one_grasp(belief):
    return one_ring(belief)[0]


def a_word(belief):
    return "grasp"


def a_list_of_words(belief):
    return ["grasp"]


def leaves(belief):
    raise SystemExit(3)


def unknown_closing(belief):
    poses = waypoint_poses((Ring(count=2),), belief.prior, belief.hand, belief.seed)
    return [Grasp(poses, closings=("curl99",))]


def face_of_nan(belief):
    point, normal = np.full((belief.worlds, 1, 3), 0.1), np.zeros((belief.worlds, 1, 3))
    normal[0] = np.nan
    normal[1:, :, 2] = 1.0
    return [CrossFaces(point, normal, np.full((belief.worlds, 1), belief.step == 0))]


def axis_without_length(belief):
    axis = Axis.upright(*(belief.prior.x_m, belief.prior.y_m, belief.prior.height_m,
                          belief.prior.radius_m))
    return [FollowContour(replace(axis, direction=0.0 * axis.direction))]


def _six(belief):
    return waypoint_poses((Ring(count=6),), belief.prior, belief.hand, belief.seed)


def rounded(belief):
    """Quaternions as a user writes them down."""
    return [Grasp(np.round(_six(belief), 3))] if belief.step == 0 else []


def a_set_of_closings(belief):
    return [Grasp(_six(belief), closings={"curl40", "curl25"})]


def no_interval(belief):
    return [CrossFaces(np.zeros((belief.worlds, 1, 3)), np.ones((belief.worlds, 1, 3)),
                       options=PlanarOptions(interval_m=0.0))]


def face_without_end(belief):
    return [CrossFaces(np.zeros((belief.worlds, 1, 3)), np.full((belief.worlds, 1, 3), 1e300))]


def writes_to_its_uncertainty(belief):
    if belief.step == 0:
        return [Grasp(_six(belief))]
    belief.uncertainty.log_volume_std[:] = 0.0
    return []


def axis_without_radius(belief):
    axis = Axis.upright(*(belief.prior.x_m, belief.prior.y_m, belief.prior.height_m,
                          0.0 * belief.prior.radius_m))
    return [FollowContour(axis)]


def axis_of_words(belief):
    axis = Axis.upright(*(belief.prior.x_m, belief.prior.y_m, belief.prior.height_m,
                          belief.prior.radius_m))
    return [FollowContour(replace(axis, radius_m=np.full(belief.worlds, "wide")))]


def too_many_poses(belief):
    return [Grasp(np.broadcast_to(np.array([0.45, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0]),
                                  (belief.worlds, 300_000_000, 7)))]


def masked_pose(belief):
    return [Grasp(np.ma.masked_array(_six(belief), mask=True))]
