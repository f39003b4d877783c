"""What touches leave of a mean's errors, against a process whose kernel has these errors in it."""

from dataclasses import replace

import numpy as np
from scipy.spatial.distance import cdist

from fit.arrays import rows_of
from fit.implicit import KnownProcess, errors_left, fit_known, implicit_meshes, implicit_volume
from fit.implicit.query import implicit_distance

PROCESS = KnownProcess(length_m=0.05, amplitude_m=0.0005)
RADIUS_M, SIGMA_M = 0.04, 0.0008


def ball(points: np.ndarray, rows: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points, axis=2) - RADIUS_M


def errors(points: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Of a ball: 10 mm of its radius, 5 mm of its place in z, and one that changes nothing."""
    up = points[..., 2] / np.maximum(np.linalg.norm(points, axis=2), 1e-9)
    return np.stack([np.full(up.shape, -0.010), -0.005 * up, 0.0 * up], -1)


def touched():
    """Balls that are touched from above alone."""
    draw = np.random.default_rng(4)
    way = draw.normal(size=(2, 30, 3))
    way[..., 2] = 0.5 + np.abs(way[..., 2])
    way /= np.linalg.norm(way, axis=2, keepdims=True)
    points = way * (RADIUS_M + SIGMA_M * draw.normal(size=(2, 30, 1)))
    mask = np.arange(30) < np.array([[30], [12]])
    return fit_known(points, mask, way, np.full(mask.shape, SIGMA_M), PROCESS, mean=ball)


def test_variances_are_those_of_a_process_whose_kernel_has_the_errors_in_it() -> None:
    """By the plain formula of a posterior covariance, kernel and errors together."""
    fits = touched()
    at = np.random.default_rng(5).uniform(-0.05, 0.05, (2, 40, 3))
    found = implicit_distance(fits, at, ball).std_m**2 + np.square(
        errors_left(fits, errors, at)).sum(2)
    for row in range(2):
        used = fits.noise_m2[row] >= 0

        def kernel(a: np.ndarray, b: np.ndarray, row: int = row) -> np.ndarray:
            scaled = np.sqrt(3) * cdist(a, b) / fits.length_m[row]
            e, f = (errors(p[None], np.zeros(1, int))[0] for p in (a, b))
            return fits.amplitude_m[row] ** 2 * (1 + scaled) * np.exp(-scaled) + e @ f.T

        rows = fits.points_m[row][used]
        inverse = np.linalg.inv(kernel(rows, rows) + np.diag(fits.noise_m2[row][used]))
        across = kernel(at[row], rows)
        true = np.diag(kernel(at[row], at[row]) - across @ inverse @ across.T)
        assert np.allclose(found[row], true, rtol=0.02, atol=1e-9)


def test_a_mean_with_errors_is_less_sure_where_nothing_was_felt() -> None:
    fits = touched()
    box = np.full((2, 3), 0.06)
    meshes = implicit_meshes(fits, ball, box_m=(-box, box))
    known = implicit_volume(fits, meshes, ball)
    wide = implicit_volume(fits, meshes, ball, errors=errors)
    assert np.array_equal(wide.volume_m3, known.volume_m3)
    below, above = known.surface_m[..., 2] < -0.03, known.surface_m[..., 2] > 0.03
    ratio = wide.surface_std_m / known.surface_std_m
    assert ratio[below].mean() > 1.5
    assert ratio[above].mean() < 0.7 * ratio[below].mean()
    assert (wide.std_m3 > 1.2 * known.std_m3).all()


def test_without_touches_all_errors_are_left() -> None:
    none = replace(rows_of(touched(), np.zeros(1, int)), noise_m2=np.full((1, 4), -1.0),
                   points_m=np.zeros((1, 4, 3)), alpha_per_m=np.zeros((1, 4)))
    at = np.random.default_rng(1).normal(size=(1, 5, 3))
    assert np.array_equal(errors_left(none, errors, at), errors(at, np.zeros(1, int)))
