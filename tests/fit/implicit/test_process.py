"""One process against plain NumPy: marginal likelihood, its gradient, posterior, variances."""

import jax
import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from fit.implicit.fit import fit_implicit
from fit.implicit.outliers import outlier_weights
from fit.implicit.process import (
    LEAST_AMPLITUDE,
    LOG_LENGTH,
    LOG_NOISE_STD,
    LOG_SLOPE,
    ProcessData,
    normal_equations,
    posterior,
)
from fit.implicit.query import implicit_distance, implicit_values, sphere_mean

THETA = np.array([0.2, -0.5, -3.5])
equations = jax.jit(normal_equations)


def kernel(a: np.ndarray, b: np.ndarray, length: float, amplitude: float) -> np.ndarray:
    """Matern 3/2, by the textbook."""
    scaled = np.sqrt(3.0) * np.linalg.norm(a[:, None] - b[None], axis=2) / length
    return amplitude**2 * (1.0 + scaled) * np.exp(-scaled)


def problem(rows: int = 12, padding: int = 4) -> ProcessData:
    """A process of random points and targets; the padded rows hold anything."""
    draw = np.random.default_rng(0)
    used = (np.arange(rows + padding) < rows).astype(float)
    return ProcessData(
        draw.normal(size=(rows + padding, 3)), 0.3 * draw.normal(size=rows + padding),
        draw.uniform(1e-4, 1e-3, rows + padding), (np.arange(rows + padding) % 4 > 0).astype(float),
        draw.uniform(0.2, 1.0, rows + padding), used, np.arange(rows + padding), np.float64(-4.0))


def covariance(theta: np.ndarray, data: ProcessData, rows: int = 12) -> np.ndarray:
    length = np.exp(theta[0])
    amplitude = np.sqrt(np.exp(2 * theta[1]) * length**3 + LEAST_AMPLITUDE**2)
    noise = (data.variance + data.noisy * np.exp(2 * theta[2])) / data.weight
    points = np.asarray(data.points)[:rows]
    return kernel(points, points, length, amplitude) + np.diag(np.asarray(noise)[:rows])


def cost(theta: np.ndarray, data: ProcessData, rows: int = 12) -> float:
    """Minus the logarithm of likelihood times prior, up to a constant."""
    prior = norm.logpdf(theta, [LOG_LENGTH[0], LOG_SLOPE[0], float(data.log_noise)],
                        [LOG_LENGTH[1], LOG_SLOPE[1], LOG_NOISE_STD]).sum()
    return -prior - multivariate_normal.logpdf(
        np.asarray(data.target)[:rows], np.zeros(rows), covariance(theta, data, rows))


def test_cost_is_the_negative_log_marginal_likelihood_and_prior() -> None:
    data, other = problem(), THETA + [0.3, -0.2, 0.4]
    with jax.enable_x64(True):
        found = [float(equations(t, data).cost) for t in (THETA, other)]
    assert found[1] - found[0] == pytest.approx(cost(other, data) - cost(THETA, data), abs=1e-8)
    assert min(found) > 0.0


def test_gradient_is_that_of_differences_and_the_matrix_is_definite() -> None:
    data, step = problem(), 1e-5
    with jax.enable_x64(True):
        found = equations(THETA, data)
    for k, e in enumerate(step * np.eye(3)):
        slope = (cost(THETA + e, data) - cost(THETA - e, data)) / (2 * step)
        assert float(found.gradient[k]) == pytest.approx(slope, rel=1e-5, abs=1e-6)
    assert np.linalg.eigvalsh(np.asarray(found.matrix)).min() > 0.0


def test_deleted_residuals_are_those_of_fits_without_the_row() -> None:
    data = problem(padding=0)
    with jax.enable_x64(True):
        found = jax.jit(posterior)(THETA, data)
    whole, target = covariance(THETA, data), np.asarray(data.target)
    for row in (0, 5):
        rest = np.arange(12) != row
        across = whole[row, rest] @ np.linalg.inv(whole[np.ix_(rest, rest)])
        assert float(found.deleted[row]) == pytest.approx(across @ target[rest] - target[row])
        noise = float(found.noise[row])
        variance = whole[row, row] - noise - across @ whole[rest, row]
        assert float(found.deleted_variance[row]) == pytest.approx(variance, rel=1e-6)


def test_values_gradients_and_deviations_are_those_of_a_plain_process() -> None:
    draw = np.random.default_rng(1)
    points = draw.normal(size=(2, 40, 3))
    points *= 0.04 * np.array([1.0, 1.5])[:, None, None] / np.linalg.norm(points, axis=2,
                                                                          keepdims=True)
    fits = fit_implicit(points)
    queries = draw.uniform(-0.06, 0.06, (2, 700, 3))
    found = implicit_distance(fits, queries)
    assert np.abs(implicit_values(fits, queries) - found.distance_m).max() < 5e-6
    mean = sphere_mean(fits)
    for k in range(2):
        used = fits.noise_m2[k] >= 0
        rows = fits.points_m[k][used]
        plain = (kernel(rows, rows, fits.length_m[k], fits.amplitude_m[k])
                 + np.diag(fits.noise_m2[k][used]))
        across = kernel(queries[k], rows, fits.length_m[k], fits.amplitude_m[k])
        value = mean(queries[k:k + 1], np.array([k]))[0] + across @ fits.alpha_per_m[k][used]
        assert np.abs(found.distance_m[k] - value).max() < 1e-9
        target = plain @ fits.alpha_per_m[k][used]
        own = mean(rows[None], np.array([k]))[0]
        assert np.abs(target + own)[: fits.n_points[k]].max() < 1e-9  # touches: f = 0
        variance = fits.amplitude_m[k] ** 2 - np.einsum(
            "qr,rq->q", across, np.linalg.solve(plain, across.T))
        assert np.abs(found.std_m[k] ** 2 - variance).max() < 1e-9
    step = 1e-6
    for axis, e in enumerate(step * np.eye(3)):
        ahead, behind = (implicit_distance(fits, queries + s * e).distance_m for s in (1, -1))
        slope = (ahead - behind) / (2 * step)
        near = np.linalg.norm(queries, axis=2) > 0.01  # the sphere's centre is a kink
        assert np.abs(slope - found.gradient[..., axis])[near].max() < 1e-4


def test_outlier_weights_follow_bayes() -> None:
    deleted, variance = np.array([[0.0, 0.5, 5.0, 50.0]]), np.full((1, 4), 0.5)
    weight = outlier_weights(deleted, variance, np.full((1, 4), 1.0), 0.05, np.array([[10.0]]))
    assert (np.diff(weight[0]) < 0).all()
    inside, outside = (norm.pdf(deleted, 0.0, np.sqrt(v)) for v in (1.5, 101.5))
    expected = 0.05 * outside / (0.05 * outside + 0.95 * inside)
    assert np.allclose(weight, 1.0 - expected * (1.0 - 1.0 / 101.0), atol=1e-9)
    first = outlier_weights(deleted, variance, np.full((1, 4), 1.0), 0.05, np.array([[10.0]]),
                            at_first=True)
    assert np.allclose(1.0 / first, 1.0 + expected * 100.0)
    assert weight[0, 0] > 0.99
    assert weight[0, 3] == pytest.approx(1.0 / 101.0)
