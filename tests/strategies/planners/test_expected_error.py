"""The expected error falls by touches as a Gaussian process says, most where little was felt."""

from dataclasses import replace

import numpy as np
from beliefs import BODY, belief, on_side

from strategies.foresight.surface_process import SurfaceProcess
from strategies.planners.candidates import candidate_poses, predicted_touches
from strategies.planners.expected_error import ExpectedError, _falls, parameter_prior


def test_the_fall_is_that_of_conditioning_by_hand() -> None:
    rng = np.random.default_rng(2)
    places, slopes = 2.0 * rng.normal(size=(30, 3)), 4.0 * rng.normal(size=(30, 4))
    known, touches, surface = np.arange(6), np.arange(6, 14).reshape(2, 4), np.arange(14, 30)
    found = np.array([[True, True, False, True], [True] * 4])
    weight = rng.uniform(size=16)
    process = SurfaceProcess(places, slopes, known, rng.normal(size=6), (0.5, 2.0), 3.0)
    falls = _falls(process, touches, found, surface, weight, across=np.float64)

    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
    prior = process.spread**2 * (1 + apart) * np.exp(-apart) + slopes @ slopes.T

    def mean_std(felt: np.ndarray) -> float:
        across = prior[np.ix_(surface, felt)]
        inner = prior[np.ix_(felt, felt)] + np.eye(len(felt))
        left = prior[np.ix_(surface, surface)] - across @ np.linalg.solve(inner, across.T)
        return float(np.sqrt(np.diag(left)) @ weight / weight.sum())

    for row in range(2):
        after = np.concatenate([known, touches[row][found[row]]])
        assert np.isclose(falls[row], mean_std(known) - mean_std(after), rtol=1e-6)
    single = _falls(process, touches, found, surface, weight)
    assert np.allclose(single, falls, rtol=1e-3)


def test_every_pose_is_worth_less_once_all_around_was_felt() -> None:
    before, after = belief(on_side(0, 10, n=3)), belief(on_side(0, 360, n=60))
    poses, reachable = candidate_poses(before)
    first, then = (ExpectedError().gain(b, poses, reachable) for b in (before, after))
    assert (then[reachable] <= first[reachable]).all()
    assert then[reachable].max() < 0.5 * first[reachable].max()


def test_a_pose_that_touches_nothing_is_worth_nothing_and_time_divides_the_gain() -> None:
    here = belief(on_side(0, 360))
    poses, reachable = candidate_poses(here)
    gain = ExpectedError().gain(here, poses, reachable)
    _, found = predicted_touches(here, poses, reachable)
    assert np.allclose(gain[~found.any(-1)], 0.0)
    assert (gain[found.any(-1)] > 0).all()
    quick = ExpectedError(per_second=True)
    quick.last = poses[:, :1]
    rate = quick.gain(here, poses, reachable)
    assert (rate[reachable] <= gain[reachable] / 3.0 + 1e-15).all()


def test_poses_that_meet_nothing_gain_nothing() -> None:
    """Hands a metre above the object."""
    poses = np.tile([0.45, 0.0, 1.3, 1.0, 0.0, 0.0, 0.0], (2, 3, 1))
    gain = ExpectedError().gain(
        replace(belief(), closings=("curl40",)), poses, np.ones((2, 3), bool))
    np.testing.assert_array_equal(gain, 0.0)


def test_a_body_that_stands_may_turn_about_the_vertical_alone_and_taper_upwards_alone() -> None:
    """The second lies, its x upwards: by a quarter turn about y."""
    half = np.sqrt(0.5)
    body = BODY._replace(quaternion_xyzw=np.array([[0, 0, 0, 1], [0, half, 0, half]], float))
    prior = parameter_prior(body)
    assert prior[:, 5:8].argmax(1).tolist() == [2, 0]
    assert (np.sort(prior[:, 5:8], axis=1)[:, 1] < 0.1 * prior[:, 5:8].max(1)).all()
    assert (prior[:, 11:13] > 0.0).all(1).tolist() == [True, False]
    assert not prior[:, 13:].any()
