"""Processes with known hyperparameters: they pass through touches and stay out of free space."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from fit.fit_status import FitStatus
from fit.implicit.known import (
    KnownProcess,
    fit_known,
    known_deviations,
    known_kernel,
    known_rows,
    known_slopes,
    shared_error_means,
)
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


def test_the_rms_is_that_of_the_distance_at_touches() -> None:
    points, normals = ball(20)
    fit = fitted(points + 0.001 * np.random.default_rng(1).normal(size=points.shape), normals)
    value, _ = known_slopes(fit, 0, PROCESS, fit.points_m[0, :20])
    assert fit.rms_m[0] == pytest.approx(np.sqrt((value**2).mean()), rel=1e-6)
    assert fit.rms_m[0] > 1e-5


def test_variances_are_scaled_to_make_touches_likeliest() -> None:
    points, normals = ball(12)
    sigma = np.full(12, 0.0005)
    fit = fitted(points, normals)
    at, away, noise, _ = known_rows(points[0], normals[0], sigma, PROCESS)
    scale = (fit.amplitude_m[0] / PROCESS.amplitude_m) ** 2
    covariance = scale * (known_kernel(PROCESS, at, at) + np.diag(noise))
    less, here, more = (multivariate_normal.logpdf(away - PROCESS.mean_m, cov=share * covariance)
                        for share in (0.98, 1.0, 1.02))
    assert here > max(less, more)
    np.testing.assert_allclose(fit.noise_m2[0, :24], scale * noise)


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
    unmasked = fit_known(points, kept, normals, sigma, PROCESS, free_points=free, free_radius=0.008)
    np.testing.assert_array_equal(unmasked.alpha_per_m, within.alpha_per_m)


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


def test_deviations_of_one_body_are_those_of_all() -> None:
    """By the programs of the general fit, which know nothing of these; none where none is felt."""
    points, normals = ball(40)
    kept = np.ones((2, 40), bool)
    kept[1, 2:] = False
    fits = fit_known(points.repeat(2, 0), kept, normals.repeat(2, 0), np.full(kept.shape, 0.0005),
                     PROCESS)
    asked = np.random.default_rng(3).uniform(-0.06, 0.06, (2, 50, 3))
    other = implicit_distance(fits, asked, PROCESS.mean).std_m
    np.testing.assert_allclose(known_deviations(fits, 0, PROCESS, asked[0]), other[0], rtol=1e-4)
    np.testing.assert_array_equal(known_deviations(fits, 1, PROCESS, asked[1]),
                                  PROCESS.amplitude_m)


def test_wrong_numbers_are_named() -> None:
    with pytest.raises(ValueError, match=r"length_m: 0\.0, should be positive"):
        KnownProcess(length_m=0.0)


def two_fingers(error_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Touches of a ball by two fingers, of which the first reads `error_m` too far outwards; one
    error for each, of 2 mm along the normal."""
    points, normals = ball(80)
    first = np.arange(80) % 2 == 0
    points = points + np.where(first, error_m, 0.0)[:, None] * normals
    shared = 0.002 * np.stack([first, ~first], axis=-1).astype(float)[None]
    return points, normals, shared


@pytest.mark.parametrize("error_m", [-0.003, 0.0, 0.002])
def test_fingers_that_contradict_one_another_tell_of_their_errors(error_m: float) -> None:
    points, normals, shared = two_fingers(error_m)
    mask = np.ones(points.shape[:2], bool)
    first, second = shared_error_means(
        points, mask, normals, np.full(mask.shape, 0.0005), shared, PROCESS)[0]
    assert 0.002 * (second - first) == pytest.approx(error_m, abs=0.0003)


def test_shared_errors_are_the_mean_of_the_joint_distribution() -> None:
    """Against the conditional mean of a joint normal distribution written out in full."""
    points, normals, shared = two_fingers(0.001)
    points, normals, shared = points[:, :12], normals[:, :12], shared[:, :12]
    mask = np.ones((1, 12), bool)
    mask[0, 3] = False
    found = shared_error_means(points, mask, normals, np.full((1, 12), 0.0005), shared, PROCESS)[0]
    own = np.flatnonzero(mask[0])
    at = np.concatenate([points[0, own], points[0, own] + PROCESS.offset_m * normals[0, own]])
    r = np.sqrt(3) * np.linalg.norm(at[:, None] - at[None], axis=-1) / PROCESS.length_m
    kernel = PROCESS.amplitude_m**2 * (1 + r) * np.exp(-r)
    both = np.concatenate([shared[0, own]] * 2)
    # Unknowns: the process at the rows, the two errors, the noise of each row.
    prior = np.block([[kernel, np.zeros((22, 24))], [np.zeros((24, 22)), np.eye(24)]])
    noise = np.sqrt(np.repeat([0.0005**2, 0.0005**2 + (PROCESS.slope * PROCESS.offset_m) ** 2], 11))
    observed = np.concatenate([np.eye(22), both, np.diag(noise)], axis=1)
    told = np.repeat([0.0, PROCESS.offset_m], 11) - PROCESS.mean_m
    mean = prior @ observed.T @ np.linalg.solve(observed @ prior @ observed.T, told)
    np.testing.assert_allclose(found, mean[22:24], rtol=1e-6, atol=1e-9)


def test_too_few_touches_tell_nothing_of_errors() -> None:
    points, normals, shared = two_fingers(0.001)
    mask = np.arange(80)[None] < 3
    assert not shared_error_means(points, mask, normals, np.full((1, 80), 0.0005), shared,
                                  PROCESS).any()


def test_a_body_that_agrees_badly_is_less_sure() -> None:
    points, normals = ball(96)
    rough = points * (1.0 + np.random.default_rng(2).normal(0.0, 0.1, (1, 96, 1)))
    at = points[:, :1] * 1.1
    smooth_std, rough_std = (implicit_distance(fitted(p, normals), at, PROCESS.mean).std_m[0, 0]
                             for p in (points, rough))
    assert rough_std > 2.0 * smooth_std


def test_the_scale_of_all_variances_is_the_likeliest() -> None:
    """Of the scales around it none makes the touches likelier."""
    points, normals = ball(40)
    fit = fitted(points, normals)
    used = fit.noise_m2[0] >= 0.0
    at, noise = fit.points_m[0][used], fit.noise_m2[0][used]
    r = np.sqrt(3) * np.linalg.norm(at[:, None] - at[None], axis=-1) / PROCESS.length_m
    covariance = fit.amplitude_m[0] ** 2 * (1 + r) * np.exp(-r) + np.diag(noise)
    told = covariance @ fit.alpha_per_m[0][used]

    def cost(scale: float) -> float:
        return 0.5 * told @ np.linalg.solve(scale * covariance, told) + 0.5 * np.linalg.slogdet(
            scale * covariance)[1]

    assert cost(1.0) < min(cost(0.97), cost(1.03))


def test_about_a_body_the_process_explains_what_remains() -> None:
    """Touches of the lower half of a ball, and of a bump on it: what was not felt is the body's."""
    points, normals = ball(200)
    points = points[:, points[0, :, 2] < 0.0]
    normals = points / np.linalg.norm(points, axis=2, keepdims=True)
    bump = np.clip(1.0 - np.linalg.norm(points / RADIUS_M + [0, 0, 1.0], axis=2) / 0.7, 0.0, 1.0)
    points = points + 0.006 * bump[..., None] * normals

    def whole(at: np.ndarray, rows: np.ndarray) -> np.ndarray:
        return np.linalg.norm(at - [[0.0, 0.0, 0.0]], axis=-1) - RADIUS_M

    fit = fitted(points, normals, mean=whole)
    about = np.abs(implicit_values(fit, points, whole)).max()
    top = np.array([[[0.0, 0.0, RADIUS_M]]])
    assert about < 0.001 < np.abs(whole(points, np.zeros(1, int))).max()
    alone = fitted(points, normals)
    assert (abs(implicit_values(fit, top, whole)[0, 0]) < 0.004
            < abs(implicit_values(alone, top, PROCESS.mean)[0, 0]))
