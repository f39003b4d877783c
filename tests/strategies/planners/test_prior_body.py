"""What planners go by while little was felt, and what they learn from grasps that went wrong."""

from dataclasses import replace

import numpy as np
from beliefs import belief, on_side

from fit.superquadric.fit import fit_superquadric
from fit.superquadric.geometry import superquadric_points
from strategies.planners.adaptive import GreedyCoverage
from strategies.planners.prior_body import planning_belief, prior_surface
from strategies.poses.waypoints import BoundingBox
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import or_prior, prior_superquadric
from strategies.recovery.upright import stand_upright


def with_fits(points: np.ndarray) -> Belief:
    here = belief(points)
    fits = fit_superquadric(here.evidence.points_m, here.evidence.mask, table_z=0.0)
    return replace(here, fits=fits, body=or_prior(fits, here.prior, np.ones(2, bool)))


def test_nothing_felt_is_the_told_cylinder() -> None:
    here, trusted = planning_belief(replace(belief(), fitted=np.zeros(2, bool)))
    assert not trusted.any()
    assert np.allclose(here.body.size_m[:, 0], 0.035)
    untrusted = replace(belief(), fitted=np.zeros(2, bool))
    larger, _ = planning_belief(untrusted, np.array([0.01, -0.01]))
    assert np.allclose(larger.body.size_m[:, 0], [0.045, 0.025])


def test_a_box_that_is_told_stands_turned_by_its_yaw() -> None:
    half, yaw = np.array([[0.06, 0.02], [0.03, 0.05]]), np.array([0.5, -1.1])
    box = BoundingBox(np.array([0.4, 0.5]), np.array([0.1, 0.0]), np.hypot(*half.T),
                      np.array([0.1, 0.2]), half, yaw)
    arm = superquadric_points(prior_superquadric(box), 2400) - np.stack(
        [box.x_m, box.y_m, box.height_m / 2], 1)[:, None]
    along, across = (np.stack([np.cos(a), np.sin(a)], 1)[:, None] for a in (yaw, yaw + np.pi / 2))
    for way, most in ((along, half[:, 0]), (across, half[:, 1])):
        np.testing.assert_allclose((arm[..., :2] * way).sum(2).max(1), most, rtol=0.02)
    np.testing.assert_allclose(arm[..., 2].max(1), box.height_m / 2, rtol=0.02)


def test_few_touches_move_what_was_told() -> None:
    """Told 15 mm beside the truth, a few touches of one side pull the guide towards them."""
    here = with_fits(on_side(-30, 30, n=6))
    aside = replace(here.prior, x_m=here.prior.x_m - 0.015)
    here, trusted = planning_belief(replace(here, prior=aside))
    assert not trusted.any()
    stands = stand_upright(here.body)
    front = stands.centre_m[:, 0] + stands.radius_m
    assert (np.abs(front - 0.485) < np.abs(aside.x_m + 0.035 - 0.485)).all()
    assert (np.abs(stands.top_m - 0.14) < 0.03).all()


def test_a_fit_to_many_touches_is_trusted_unless_they_lie_beside_it() -> None:
    here = with_fits(on_side(0, 360, n=48))
    assert planning_belief(here)[1].all()
    away = replace(here.fits, position_m=here.fits.position_m + 0.02)
    assert not planning_belief(replace(here, fits=away))[1].any()


def test_told_surface_lies_on_the_cylinder() -> None:
    prior = belief().prior
    points = prior_surface(prior)
    away = np.hypot(points[..., 0] - prior.x_m[:, None], points[..., 1] - prior.y_m[:, None])
    assert (np.isclose(away, 0.035) | np.isclose(points[..., 2], 0.14)).all()


def test_a_barred_hand_makes_the_object_larger_and_an_empty_one_smaller() -> None:
    planner, here = GreedyCoverage(), replace(belief(), fitted=np.zeros(2, bool))
    planner(here)
    planner(replace(here, step=1, touches=np.array([0, 8])))
    assert np.all(np.sign(planner.larger_m) == [1, -1])
    felt = belief(on_side(0, 90, n=8)).evidence
    planner(replace(here, step=2, touches=np.array([8, 16]), evidence=felt))
    assert (np.abs(planner.larger_m) < [0.006, 0.010]).all()


def test_an_object_never_met_is_looked_for_at_all_sizes_in_turn() -> None:
    planner, here = GreedyCoverage(), replace(belief(), fitted=np.zeros(2, bool))
    margin, sizes = here.prior.margin_m, []
    for step in range(12):
        planner(replace(here, step=step, touches=np.full(2, 8 * step)))
        sizes.append(planner.larger_m)
    assert np.allclose(np.min(sizes, 0), -margin)
    again = np.diff(np.array(sizes)[:, 0]) > 0.0
    assert again.any()
    assert (np.array(sizes)[1:][again] == 0.0).all()


def test_where_no_pose_promises_a_touch_the_one_farthest_from_those_taken_is_next() -> None:
    """The hand takes another side, not the next pose of the list."""
    planner, here = GreedyCoverage(), replace(belief(), fitted=np.zeros(2, bool))
    planner.gain = lambda belief, poses, free: np.zeros(free.shape)
    taken = [planner(replace(here, step=step))[0].hand_pose[:, 0] for step in range(4)]
    apart = [np.linalg.norm(one[:, :3] - other[:, :3], axis=1)
             for k, one in enumerate(taken) for other in taken[:k]]
    assert np.min(apart) > 0.08
