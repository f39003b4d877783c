"""A Gaussian process of distances between surfaces, against conditioning by hand and densities."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from strategies.foresight.surface_process import SurfaceProcess, matern

SPREADS = (0.3, 0.6, 1.2, 2.5, 5.0)


def prior(places: np.ndarray, slopes: np.ndarray, spread: float) -> np.ndarray:
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
    return spread**2 * (1 + apart) * np.exp(-apart) + slopes @ slopes.T


@pytest.mark.parametrize("felt", [0, 7])
def test_what_poses_feel_together_is_the_covariance_given_the_touches(felt: int) -> None:
    rng = np.random.default_rng(3)
    places, slopes = 2.0 * rng.normal(size=(20, 3)), rng.normal(size=(20, 4))
    known, touches = np.arange(felt), np.arange(8, 20).reshape(3, 4)
    found = rng.uniform(size=touches.shape) < 0.7
    process = SurfaceProcess(places, slopes, known, rng.normal(size=felt), SPREADS, 2.0)
    together = process.felt_together(touches, found, process.told(touches[found]))

    whole = prior(places, slopes, process.spread)
    for pose, there in enumerate(found):
        at = touches[pose][there]
        across = whole[np.ix_(at, known)]
        inner = whole[np.ix_(known, known)] + np.eye(felt)
        right = whole[np.ix_(at, at)] - across @ np.linalg.solve(inner, across.T) + np.eye(len(at))
        np.testing.assert_allclose(together[pose][np.ix_(there, there)], right, atol=1e-9)
        np.testing.assert_array_equal(together[pose][~there], np.eye(4)[~there])


def test_the_spread_is_the_likeliest_and_grows_with_residuals() -> None:
    rng = np.random.default_rng(4)
    places, slopes = 3.0 * rng.normal(size=(40, 3)), rng.normal(size=(40, 2))
    found = []
    for size in (0.5, 2.0, 8.0):
        residual = size * rng.normal(size=40)
        densities = [multivariate_normal.logpdf(
            residual, np.zeros(40), prior(places, slopes, spread) + np.eye(40))
            for spread in SPREADS]
        process = SurfaceProcess(places, slopes, np.arange(40), residual, SPREADS, 1.0)
        assert process.spread == SPREADS[int(np.argmax(densities))]
        found.append(process.spread)
    assert found[0] < found[1] < found[2]


def test_single_precision_serves_for_correlations() -> None:
    rng = np.random.default_rng(5)
    one, other = rng.normal(size=(30, 3)), rng.normal(size=(50, 3))
    rough = matern(one.astype(np.float32), other.astype(np.float32))
    assert rough.dtype == np.float32
    np.testing.assert_allclose(rough, matern(one, other), atol=2e-6)
