"""Counter-based randomness: kernel and host agree, streams are even and independent."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from scipy import stats

from warpgrasp.core import random
from warpgrasp.core.random_kernel import (
    counter_key,
    counter_normal,
    counter_normal_is_negative,
    counter_uniform,
)


@wp.kernel(enable_backward=False)
def draw(key: wp.uint64, uniform: wp.array[wp.float64], normal: wp.array[wp.float64],
         falls: wp.array[wp.bool]):
    i = wp.tid()
    k = counter_key(counter_key(key, i), -3)
    uniform[i] = counter_uniform(k)
    normal[i] = counter_normal(k)
    falls[i] = counter_normal_is_negative(k)


def test_kernel_and_host_draw_the_same() -> None:
    uniform = wp.empty(1000, dtype=wp.float64, device="cpu")
    normal = wp.empty(1000, dtype=wp.float64, device="cpu")
    falls = wp.empty(1000, dtype=wp.bool, device="cpu")
    wp.launch(draw, 1000, inputs=[wp.uint64(7), uniform, normal, falls], device="cpu")
    keys = random.counter_key(7, np.arange(1000), -3)
    assert np.array_equal(uniform.numpy(), random.counter_uniform(keys))
    assert np.allclose(normal.numpy(), random.counter_normal(keys), rtol=1e-12)
    assert np.array_equal(falls.numpy(), normal.numpy() < 0.0)


def test_no_two_purposes_share_a_stream() -> None:
    names = random.Purpose.__members__
    assert len({int(purpose) for purpose in names.values()}) == len(names)


def test_streams_are_even_and_uncorrelated() -> None:
    keys = random.counter_key(1, np.arange(200)[:, None], np.arange(500)[None])
    u = random.counter_uniform(keys)
    assert stats.kstest(u.ravel(), "uniform").pvalue > 0.001
    assert stats.kstest(random.counter_normal(keys).ravel(), "norm").pvalue > 0.001
    assert abs(np.corrcoef(u[:-1].ravel(), u[1:].ravel())[0, 1]) < 0.015
    assert abs(np.corrcoef(u[:, :-1].ravel(), u[:, 1:].ravel())[0, 1]) < 0.015
    assert len(np.unique(keys)) == keys.size


@pytest.mark.parametrize(("key", "counter"), [(7.9, 0), (7, 0.5), (np.ones(2), 1), (7, "a")])
def test_keys_and_counters_are_whole_numbers(key: Any, counter: Any) -> None:
    """Shares and times were cut, so that all of a second gave the same numbers."""
    with pytest.raises(TypeError, match="should be whole numbers"):
        random.counter_key(key, counter)
    with pytest.raises(ValueError, match=r"key: is \[ 3 -1\]; should be from 0 to"):
        random.counter_key(np.array([3, -1]), 0)
    for wrong in (-1, 2**64):
        with pytest.raises(ValueError, match=f"key: is {wrong}; should be from 0 to"):
            random.counter_key(wrong, 0)
