"""The likelihood of touches about means: that of their joint normal distribution, and what it
prefers."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from fit.implicit.known import KnownProcess, known_kernel, known_rows, log_evidence

PROCESS = KnownProcess(length_m=0.05)
AMPLITUDES_M = (0.03, 0.004, 0.0005)
MIDDLE = np.array([0.4, 0.1, 0.05])


def sphere(radius_m: float) -> Callable[[np.ndarray], np.ndarray]:
    return lambda points: np.linalg.norm(points - MIDDLE, axis=1) - radius_m


def nothing(points: np.ndarray) -> np.ndarray:
    return np.full(len(points), PROCESS.mean_m)


def touched(count: int, noise_m: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on a sphere of 40 mm, outward normals of every second, deviations."""
    rng = np.random.default_rng(seed)
    way = rng.normal(size=(count, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    normals = np.where(np.arange(count)[:, None] % 2, np.nan, way)
    away = 0.04 + rng.normal(0.0, noise_m, count)
    return MIDDLE + away[:, None] * way, normals, np.full(count, 0.001)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), count=st.integers(4, 40))
def test_it_is_the_density_of_the_rows(seed: int, count: int) -> None:
    felt = touched(count, 0.001, seed)
    means = [nothing, sphere(0.03)]
    found = log_evidence(*felt, PROCESS, means, AMPLITUDES_M)
    at, away, noise, _ = known_rows(*felt, PROCESS)
    for mean, row in zip(means, found, strict=True):
        for amplitude, value in zip(AMPLITUDES_M, row, strict=True):
            covariance = ((amplitude / PROCESS.amplitude_m) ** 2 * known_kernel(PROCESS, at, at)
                          + np.diag(noise))
            assert value == pytest.approx(
                multivariate_normal(np.zeros(len(at)), covariance).logpdf(away - mean(at)))


def test_the_body_that_was_touched_is_likelier_than_none_and_leaves_little() -> None:
    felt = touched(60, 0.0005, 3)
    none, right, wrong = log_evidence(*felt, PROCESS, [nothing, sphere(0.04), sphere(0.03)],
                                       AMPLITUDES_M)
    assert right.max() > none.max() + 50.0
    assert right.argmax() == 2
    assert right.max() > wrong.max()


def test_a_body_that_was_not_touched_is_likelier_than_none_by_no_means() -> None:
    felt = touched(60, 0.0005, 4)

    def plate(points: np.ndarray) -> np.ndarray:
        return points[:, 2] - 0.2

    none, other = log_evidence(*felt, PROCESS, [nothing, plate], AMPLITUDES_M)
    assert none.max() > other.max() + 20.0
