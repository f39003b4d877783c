"""Adaptive planners choose what they say they choose."""

from dataclasses import replace

import numpy as np
import pytest
from beliefs import BODY, belief, on_side

from fit.superquadric.geometry import superquadric_inside_outside
from strategies.planners.adaptive import (
    GreedyCoverage,
    MostInformation,
    MostUncertain,
    SurfaceGaussianProcess,
)
from strategies.planners.candidates import POOL, candidate_poses, predicted_touches
from strategies.planners.planner_file import PlannerError
from strategies.planners.probes import Grasp
from strategies.planners.registry import make_planner

CURLED = replace(belief(), closings=("curl40",))


def test_candidates_are_reachable_hand_poses() -> None:
    poses, reachable = candidate_poses(belief())
    assert poses.shape == (2, sum(f.count for f in POOL), 7)
    assert np.allclose(np.linalg.norm(poses[..., 3:], axis=-1), 1.0)
    assert reachable.mean() > 0.3


def test_predicted_touches_lie_on_the_body_believed() -> None:
    poses, reachable = candidate_poses(belief())
    points, found = predicted_touches(CURLED, poses, reachable)
    assert found.any(-1)[reachable].mean() > 0.5
    assert not found[~reachable].any()
    gauge = superquadric_inside_outside(BODY, points.reshape(2, -1, 3)).reshape(found.shape)
    assert np.abs(gauge[found] - 1).max() < 0.02


def test_both_closings_are_predicted_one_after_the_other() -> None:
    poses, reachable = candidate_poses(belief())
    points, found = predicted_touches(belief(), poses, reachable)
    first, first_found = predicted_touches(CURLED, poses, reachable)
    assert found.shape[2] == 8
    assert np.array_equal(points[:, :, :4], first)
    assert np.array_equal(found[:, :, :4], first_found)
    assert found[:, :, 4:].any()


@pytest.mark.parametrize("make", [GreedyCoverage, SurfaceGaussianProcess, MostUncertain])
def test_the_untouched_side_is_worth_more(make: type) -> None:
    """With one half of the body felt, the best pose touches mostly the other half."""
    here = belief(on_side(90, 270))
    poses, reachable = candidate_poses(here)
    gain = np.where(reachable, make().gain(here, poses, reachable), -np.inf)
    points, found = predicted_touches(here, poses, reachable)
    new = np.where(found, points[..., 0] - BODY.position_m[:, None, None, 0] > 0, False).sum(-1)
    for world in range(2):
        order = np.argsort(-gain[world])[:5]
        others = np.flatnonzero(reachable[world])
        assert new[world, order].mean() > new[world, others].mean()


def test_information_is_that_of_the_linear_model() -> None:
    """One touch along a direction of known variance: 1/2 log(1 + variance / noise)."""
    here = belief(on_side(0, 360))
    uncertainty = here.parameter_uncertainty
    only_x = np.zeros((2, 15, 15))
    only_x[:, 8, 8] = 1e-4  # the place along x, 10 mm
    here.__dict__["parameter_uncertainty"] = replace(uncertainty, covariance=only_x)
    poses, reachable = candidate_poses(here)
    points, found = predicted_touches(here, poses, reachable)
    gain = MostInformation().gain(here, poses, reachable)
    normal = (points - BODY.position_m[:, None, None])[..., :2] / 0.035
    side = found & (np.abs(points[..., 2] - 0.07) < 0.06)
    just_sides = side.any(-1) & (side == found).all(-1)
    spread = np.where(found, normal[..., 0] ** 2, 0.0).sum(-1) * 1e-4 / 0.0015**2
    assert just_sides.sum() > 5
    assert np.allclose(gain[just_sides], 0.5 * np.log1p(spread)[just_sides], rtol=0.05, atol=0.02)


def test_a_covariance_that_is_none_spoils_the_information_of_its_own_world_alone() -> None:
    here = belief(on_side(0, 360))
    poses, reachable = candidate_poses(here)
    alone = MostInformation().gain(here, poses, reachable)
    spoilt = here.parameter_uncertainty.covariance.copy()
    spoilt[0] = np.nan
    here.__dict__["parameter_uncertainty"] = replace(here.parameter_uncertainty, covariance=spoilt)
    np.testing.assert_array_equal(MostInformation().gain(here, poses, reachable)[1], alone[1])


def test_options_a_planner_cannot_use_are_refused_by_name() -> None:
    for value in ("wide", True, 2.0):
        with pytest.raises(PlannerError, match=r"length_m.*should be a number from 0\.001 to 1"):
            make_planner("gaussian-process", {"length_m": value})
    with pytest.raises(PlannerError, match="breadth"):
        make_planner("even", {"breadth": 1})


def test_worlds_that_have_ended_are_not_planned_for() -> None:
    class Watched(GreedyCoverage):
        def gain(self, belief, poses, free):
            looked_at.append(belief.seed.tolist())
            return super().gain(belief, poses, free)

    looked_at: list[list[int]] = []
    here = belief(on_side(-60, 60, 16))
    both, one = Watched(), Watched()
    (first,) = both(here)
    (again,) = one(replace(here, active=np.array([False, True])))
    assert looked_at == [[0, 1], [1]]
    assert isinstance(first, Grasp)
    assert isinstance(again, Grasp)
    assert again.wanted is not None
    assert again.wanted.tolist() == [[False], [True]]
    assert np.array_equal(again.hand_pose[1], first.hand_pose[1])
