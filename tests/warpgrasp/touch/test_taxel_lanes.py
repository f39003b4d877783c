# type: ignore  # Warp functions, which type checkers cannot follow
"""Taxels read side by side say what they say one by one."""

import numpy as np
import pytest
import warp as wp

from warpgrasp.core.dtypes import real
from warpgrasp.core.random_kernel import counter_key
from warpgrasp.touch.pad_kernel import Pad, unloaded_count
from warpgrasp.touch.taxel_lanes import TAXELS_AT_ONCE, read_unloaded

wp.set_module_options({"max_unroll": 1})
_AT_ONCE = wp.constant(TAXELS_AT_ONCE)
READINGS = 500


@wp.kernel(enable_backward=False)
def both(
    noise: real, dead: real, pad: wp.array[wp.uint64], reading: wp.array[wp.uint64],
    together: wp.array3d[wp.uint8], alone: wp.array3d[wp.uint8], sure: wp.array2d[wp.bool],
):
    i = wp.tid()
    table = Pad()
    table.noise = noise
    table.dead = dead
    for group in range(256 // _AT_ONCE):
        sure[i, group] = read_unloaded(noise, dead, pad[i], reading[i], group * _AT_ONCE, together,
                                       i)
    for taxel in range(256):
        alone[i, taxel // 16, taxel % 16] = wp.uint8(unloaded_count(
            table, counter_key(pad[i], taxel), counter_key(reading[i], taxel)))


@pytest.mark.parametrize(("noise", "dead"), [
    (0.0, 0.0), (0.3, 0.0), (1.0, 0.005), (1.0, 1.0), (6.0, 0.5), (100.0, 0.1)])
def test_counts_are_those_of_one_taxel_at_a_time(noise: float, dead: float) -> None:
    rng = np.random.default_rng(5)
    pad, reading = (wp.array(rng.integers(0, 2**63, READINGS).astype(np.uint64), dtype=wp.uint64)
                    for _ in range(2))
    together, alone = (wp.zeros((READINGS, 16, 16), dtype=wp.uint8) for _ in range(2))
    sure = wp.zeros((READINGS, 256 // TAXELS_AT_ONCE), dtype=wp.bool)
    wp.launch(both, READINGS, [noise, dead, pad, reading, together, alone, sure], device="cpu")
    known = np.repeat(sure.numpy(), TAXELS_AT_ONCE, axis=1).reshape(-1, 16, 16)
    assert np.array_equal(together.numpy()[known], alone.numpy()[known])
    if noise < 50.0:
        assert known.all()
    else:  # counts beyond 255 are asked for one by one
        assert 0.1 < known.mean() < 0.9
    share = (alone.numpy() > 0).mean()
    expected = 0.0 if noise == 0.0 else (1.0 - dead) * float(
        (np.random.default_rng(0).standard_normal(400_000) * noise >= 0.5).mean())
    assert share == pytest.approx(expected, abs=0.01)
