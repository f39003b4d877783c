"""Coverage of intervals, and covariances of symmetric bodies."""

import numpy as np
import pytest
from quality_bodies import standing_bodies, touches

from fit.rotation import matrix_of_quaternion
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.geometry import superquadric, superquadric_surface, superquadric_volume
from fit.superquadric.record import SuperquadricOptions
from fit.superquadric.slopes import displaced
from fit.superquadric.uncertainty import (
    _table_slope,
    distance_slopes,
    superquadric_uncertainty,
    surface_distance,
    surface_std,
)


def coverage(n: int, count: int, noise: float, common: float = 0.0) -> tuple[float, float]:
    """Share of 90 % intervals that hold the true volume, and the true surface; `common` is the
    standard deviation of an error along the normal that the touches of a body share [m]."""
    rng = np.random.default_rng(5)
    body = standing_bodies(n, rng)
    shared = common * rng.normal(size=(n, 1))
    points = touches(body._replace(size_m=body.size_m + shared), count, noise, rng)
    covariance = np.broadcast_to(np.eye(3) * noise**2, (n, count, 3, 3))
    evidence = {"covariance": covariance, "table_z": 0.0}
    options = SuperquadricOptions(sigma_floor_m=1e-4)
    fit = fit_superquadric(points, options=options, **evidence)
    known = superquadric_uncertainty(fit, points, sigma_floor_m=1e-4,
                                    shared_m=np.full((n, count, 1), common),
                                     **evidence)
    low, high = known.volume_interval_m3().T
    true = superquadric_volume(body)
    surface, _, _ = superquadric_surface(body, 150)
    away, _ = surface_distance(fit, surface)
    held = np.abs(away) < 1.645 * surface_std(fit, known, surface)
    return float(np.mean((low < true) & (true < high))), float(held.mean())


@pytest.mark.slow
def test_intervals_hold_the_truth_about_as_often_as_they_say() -> None:
    for common in (0.0, 1.5e-3):
        volume, surface = coverage(60, 60, 1e-3, common)
        assert 0.8 <= volume <= 1.0
        assert 0.82 <= surface <= 0.97


@pytest.mark.slow
@pytest.mark.parametrize(("count", "noise"), [(60, 1e-3), (30, 2e-3)])
def test_ninety_percent_intervals_are_calibrated(count: int, noise: float) -> None:
    volume, surface = coverage(400, count, noise)
    print(f"{count} touches, {noise * 1e3:.0f} mm: volume {volume:.3f}, surface {surface:.3f}")
    assert 0.85 <= volume <= 0.95
    assert 0.85 <= surface <= 0.95


@pytest.mark.slow
def test_rotation_about_a_symmetry_axis_is_uncertain() -> None:
    rng = np.random.default_rng(1)
    body = superquadric([[0.03, 0.03, 0.05], [0.025, 0.035, 0.05]], [[0.1, 1.0], [0.1, 0.1]],
                        [[0.45, 0, 0.05]] * 2)
    points = touches(body, 80, 5e-4, rng)
    fit = fit_superquadric(points, table_z=0.0)
    known = superquadric_uncertainty(fit, points, table_z=0.0)
    turn_std = np.sqrt(known.covariance[:, 7, 7])
    assert turn_std[0] > 5 * turn_std[1]
    assert turn_std[1] < 0.05
    assert np.isfinite(known.covariance).all()


@pytest.mark.parametrize("noise", [1e-4, 3e-4])
def test_noise_that_is_not_given_is_that_of_the_residuals(noise: float) -> None:
    """All touches are off by as much; eleven parameters take their part of it."""
    rng = np.random.default_rng(6)
    body, count = standing_bodies(4, rng), 60
    points = touches(body, count, 0.0, rng)
    covariance = np.tile(noise**2 * count / (count - 11) * np.eye(3), (4, count, 1, 1))
    known = superquadric_uncertainty(body, points, covariance=covariance, sigma_floor_m=0.0)
    _, normal = surface_distance(body, points)
    off = noise * np.where(np.arange(count) % 2, 1.0, -1.0)[:, None] * normal
    found = superquadric_uncertainty(body, points + off)
    np.testing.assert_allclose(found.log_volume_std, known.log_volume_std, rtol=0.1)


def test_padding_changes_no_bit() -> None:
    rng = np.random.default_rng(3)
    body = standing_bodies(6, rng)
    points = touches(body, 37, 1e-3, rng)
    padded = np.full((6, 300, 3), np.nan)
    padded[:, :37] = points
    for common in (0.0, 5e-4):
        plain, again = (superquadric_uncertainty(
            body, p, table_z=0.0, shared_m=np.full((*p.shape[:2], 1), common))
                        for p in (points, padded))
        for name, value in vars(plain).items():
            assert np.array_equal(getattr(again, name), value), name


@pytest.mark.parametrize("none", [
    np.full((3, 3), np.nan), np.diag([1e-6, np.inf, 1e-6]), -1e-6 * np.eye(3)])
def test_a_touch_of_no_known_noise_counts_as_not_made(none: np.ndarray) -> None:
    """It would count as one without noise: the less is known, the surer."""
    rng = np.random.default_rng(3)
    body = standing_bodies(2, rng)
    points = touches(body, 37, 1e-3, rng)
    covariance = np.tile(np.eye(3) * 1e-6, (2, 37, 1, 1))
    shared = np.full((2, 37, 1), 1e-4)
    mask = np.ones((2, 37), bool)
    mask[1, :9] = False
    masked = superquadric_uncertainty(body, points, mask, covariance=covariance, shared_m=shared)
    covariance[1, :9], shared[1, :9] = none, np.nan
    known = superquadric_uncertainty(body, points, covariance=covariance, shared_m=shared)
    for name, value in vars(masked).items():
        assert np.array_equal(getattr(known, name), value), name


def test_the_centre_is_as_deep_as_the_least_half_extent() -> None:
    body = superquadric([0.03, 0.04, 0.06], [[1.0, 1.0], [0.1, 0.1]], [0.4, 0, 0.06])
    away, normal = surface_distance(body, body.position_m[:, None])
    assert away == pytest.approx(-0.03, rel=1e-6)
    assert np.isfinite(normal).all()


def test_a_step_along_the_tangent_moves_the_surface_as_the_slopes_say() -> None:
    body = superquadric([0.03, 0.04, 0.06], [0.5, 0.8], [0.1, 0, 0], [0, 0, 0.6, 0.8], [0.2, -0.1],
                        [3.0, 0.5])
    step = np.zeros((1, 15))
    step[0, 8:11] = [1e-6, -2e-6, 3e-6]
    surface, normal, _ = superquadric_surface(body, 200)
    away, _ = surface_distance(displaced(body, step), surface)
    # What is left is of second order: a step squared times the curvature at an edge.
    assert np.allclose(away, -normal @ step[0, 8:11], atol=2e-9)


def test_slopes_at_the_surface_are_how_far_it_moves() -> None:
    """All coordinates, at points that lie on the surface to the last digit; their slopes were those
    of the ray through the centre, by half too large at corners."""
    body = superquadric([0.03, 0.04, 0.06], [0.5, 0.8], [0.1, 0, 0.2],
                        np.array([[0.3, 0, 0.6, 0.8]]) / np.sqrt(1.09), [0.2, -0.1], [3.0, 0.5])
    surface, _, _ = superquadric_surface(body, 200)
    slopes = distance_slopes(body, surface)
    for k in range(15):
        step = np.zeros((1, 15))
        step[0, k] = 1e-6
        ahead, back = (surface_distance(displaced(body, sign * step), surface)[0]
                       for sign in (1, -1))
        assert np.allclose(slopes[0, :, k], (ahead - back)[0] / 2e-6, rtol=0, atol=1e-8), k


def test_the_table_is_a_touch_of_the_lowest_point() -> None:
    """Of a tilted ellipsoid, whose lowest height is in closed form."""
    tilted = np.array([[0.3, -0.2, 0.1, 1.0]])
    body = superquadric([0.03, 0.04, 0.06], [1.0, 1.0], [0.4, 0, 0.06],
                        tilted / np.linalg.norm(tilted))

    def lowest(b) -> float:
        up = matrix_of_quaternion(b.quaternion_xyzw)[0, 2]
        return float(b.position_m[0, 2] - np.linalg.norm(up * b.size_m[0]))

    slope = _table_slope(body, np.ones((1, 15)))[0]
    for k in (0, 1, 2, 5, 6, 7, 8, 9, 10):
        step = np.zeros((1, 15))
        step[0, k] = 1e-6
        rise = (lowest(displaced(body, step)) - lowest(displaced(body, -step))) / 2e-6
        # The mean of a small cap, whose normals lean by up to 0.2 rad.
        assert slope[k] == pytest.approx(rise, abs=0.002 if k < 8 else 0.03), k


def test_what_is_no_fit_has_no_interval() -> None:
    ways = np.random.default_rng(0).normal(size=(3, 40, 3))
    points = 0.04 * ways / np.linalg.norm(ways, axis=2, keepdims=True)
    points[1, 0] = np.inf
    points[2, :, 2] = 0.0
    fits = fit_superquadric(points)
    found = superquadric_uncertainty(fits, points)
    for values in (found.volume_m3, found.volume_interval_m3()[:, 0], found.covariance[:, 0, 0]):
        assert np.isfinite(values).tolist() == [True, False, False]
