"""Processes with known hyperparameters: they pass through touches and stay out of free space."""

import numpy as np
import pytest

from fit.fit_status import FitStatus
from fit.implicit.known import KnownProcess, fit_known, known_slopes
from fit.implicit.mesh import implicit_meshes
from fit.implicit.query import implicit_distance, implicit_slopes, implicit_values

RADIUS_M = 0.04
PROCESS = KnownProcess()


def ball(touches: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    way = np.random.default_rng(seed).normal(size=(1, touches, 3))
    way /= np.linalg.norm(way, axis=2, keepdims=True)
    return RADIUS_M * way, way


def fitted(points: np.ndarray, normals: np.ndarray, **given):
    mask = np.ones(points.shape[:2], bool)
    return fit_known(points, mask, normals, np.full(mask.shape, 0.0005), PROCESS, **given)


def test_touches_of_a_ball_give_the_ball() -> None:
    fit = fitted(*ball(96))
    mesh, = implicit_meshes(fit, PROCESS.mean)
    away = np.linalg.norm(mesh.vertices_m, axis=1) - RADIUS_M
    assert np.abs(away).mean() < 0.0008
    assert mesh.volume_m3 == pytest.approx(4 / 3 * np.pi * RADIUS_M**3, rel=0.05)
    assert fit.status[0] == FitStatus.converged


def test_far_from_touches_there_is_no_body() -> None:
    points, normals = ball(96)
    upper = points[..., 2] > 0.02
    fit = fit_known(points, upper, normals, np.full(upper.shape, 0.0005), PROCESS)
    far = np.array([[[0.0, 0.0, -0.2]]])
    assert implicit_values(fit, far, PROCESS.mean)[0, 0] == pytest.approx(PROCESS.mean_m, rel=0.2)


def test_the_surface_leaves_balls_of_free_space() -> None:
    points, normals = ball(96)
    kept = points[..., 0] < 0.02  # a cap that nothing felt
    free = np.array([[[0.036, 0.0, 0.0], [0.0, 0.0, 0.2]]])
    given = {"free_points": free, "free_radius": 0.008, "free_mask": np.ones((1, 2), bool)}
    sigma = np.full(kept.shape, 0.0005)
    without = fit_known(points, kept, normals, sigma, PROCESS)
    within = fit_known(points, kept, normals, sigma, PROCESS, **given)
    before, after = (implicit_values(fit, free[:, :1], PROCESS.mean)[0, 0]
                     for fit in (without, within))
    assert before < 0.004
    assert after > 0.006


def test_other_bodies_and_slots_beside_it_change_no_coefficient() -> None:
    points, normals = ball(40)
    alone = fitted(points, normals)
    more, ways = ball(96, seed=1)
    room = np.zeros((2, 96, 3))
    room[0, :40], room[1] = points, more
    way = np.full((2, 96, 3), np.nan)
    way[0, :40], way[1] = normals, ways
    mask = np.arange(96) < np.array([[40], [96]])
    both = fit_known(room, mask, way, np.full(mask.shape, 0.0005), PROCESS)
    assert (both.alpha_per_m[0, :80] == alone.alpha_per_m[0]).all()
    assert (both.alpha_per_m[0, 80:] == 0.0).all()


def test_too_few_touches_are_a_status() -> None:
    fit = fitted(*ball(3))
    assert fit.status[0] == FitStatus.too_few_points
    assert implicit_meshes(fit, PROCESS.mean)[0].volume_m3 == 0.0


def test_slopes_are_those_of_the_distance() -> None:
    fit = fitted(*ball(48))
    asked = 0.05 * np.random.default_rng(2).normal(size=(1, 30, 3))
    value, slope = implicit_slopes(fit, asked, PROCESS.mean)
    other = implicit_distance(fit, asked, PROCESS.mean)
    assert np.allclose(value, other.distance_m, atol=1e-5)
    assert np.allclose(slope, other.gradient, atol=1e-6)


def test_slopes_of_one_body_are_those_of_all() -> None:
    points, normals = ball(40)
    kept = np.ones((2, 40), bool)
    kept[1, 7:] = False
    fits = fit_known(points.repeat(2, 0), kept, normals.repeat(2, 0), np.full(kept.shape, 0.0005),
                     PROCESS)
    asked = np.random.default_rng(3).uniform(-0.06, 0.06, (2, 50, 3))
    value, slope = implicit_slopes(fits, asked, PROCESS.mean)
    for row in range(2):
        own_value, own_slope = known_slopes(fits, row, PROCESS, asked[row])
        np.testing.assert_allclose(own_value, value[row], atol=3e-6)
        np.testing.assert_allclose(own_slope, slope[row], atol=3e-4)


def test_wrong_numbers_are_named() -> None:
    with pytest.raises(ValueError, match=r"length_m: 0\.0, should be positive"):
        KnownProcess(length_m=0.0)
