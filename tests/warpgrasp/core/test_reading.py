"""Means of readings against readings drawn one by one, with noise above and below half a step."""

import numpy as np
import pytest
import warp as wp

from warpgrasp.core.kernel_launch import array_of, launch
from warpgrasp.core.random import counter_key
from warpgrasp.core.reading_kernel import mean_read, mean_variance

READINGS, COUNT = 16, 4000


@wp.kernel(enable_backward=False)
def _read_kernel(first: int, value: wp.array[wp.float64], noise: wp.float64, step: wp.float64,
                 key: wp.array[wp.uint64], mean: wp.array[wp.float64],
                 variance: wp.array[wp.float64]):
    i = wp.tid()
    i += first
    mean[i] = mean_read(value[i], noise, step, READINGS, key[i])
    variance[i] = mean_variance(noise, step, READINGS)


def read(value: np.ndarray, noise: float, step: float) -> tuple[np.ndarray, float]:
    """Means, and the variance that is told."""
    mean, variance = (wp.empty(len(value), dtype=wp.float64, device="cpu") for _ in range(2))
    launch(_read_kernel, {"i": len(value)}, dict.fromkeys(
        ("value", "key", "mean", "variance"), "i"), {
        "value": array_of(value, wp.float64, "cpu"), "noise": noise, "step": step,
        "key": array_of(counter_key(5, np.arange(len(value))), wp.uint64, "cpu"),
        "mean": mean, "variance": variance}, device="cpu")
    return mean.numpy(), float(variance.numpy()[0])


@pytest.mark.parametrize(("noise", "step", "most"), [
    (0.3, 0.05, 1.5), (0.3, 0.6, 1.5), (0.3, 0.0, 1.5), (0.1, 1.0, 1.5), (0.2, 1.0, 2.3),
    (0.0, 1.0, 1.5), (0.0, 0.0, 1.5)])
def test_means_err_as_readings_drawn_one_by_one_do(noise: float, step: float, most: float
                                                   ) -> None:
    rng = np.random.default_rng(3)
    value = rng.uniform(-20.0, 20.0, COUNT)
    each = value[:, None] + noise * rng.normal(size=(COUNT, READINGS))
    drawn = (step * np.floor(each / step + 0.5) if step else each).mean(1) - value
    mean, told = read(value, noise, step)
    off = mean - value
    assert off.std() == pytest.approx(drawn.std(), rel=0.06, abs=1e-12)
    # Between the two laws the deviation told is larger than it is, by the factor `most` or less.
    assert 0.95 * off.std() <= np.sqrt(told) + 1e-12
    assert np.sqrt(told) <= most * off.std() + 1e-12


def test_without_noise_all_readings_are_the_same() -> None:
    mean, _ = read(np.array([3.0, 7.4, -12.0]), 0.0, 10.0)
    assert mean.tolist() == [0.0, 10.0, -10.0]
