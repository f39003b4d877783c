# type: ignore  # Warp functions, which type checkers cannot follow
"""Taxels read side by side give what they give one by one; counts, images and noise of pads."""

import numpy as np
import pytest
import warp as wp

from warpgrasp.core.dtypes import real, vec2
from warpgrasp.core.random_kernel import counter_key
from warpgrasp.parameters import HandTable, PadTable
from warpgrasp.touch.pad import pad_of
from warpgrasp.touch.pad_kernel import (
    Pad,
    depth_read,
    taxel_count,
    taxel_spring,
    unloaded_count,
)
from warpgrasp.touch.pad_readout import image_centroid
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


@wp.kernel(enable_backward=False)
def told(pad: Pad, depth: wp.array[real], count: wp.array[real], read: wp.array2d[real]):
    i = wp.tid()
    half = real(0.5)
    count[i] = real(taxel_count(pad, taxel_spring(pad, depth[i])[0], wp.uint64(1), wp.uint64(2)))
    read[i, 0] = depth_read(pad, count[i] - half)
    read[i, 1] = depth_read(pad, count[i] + half)


@pytest.mark.parametrize("law", ["exponential", "inverse_power"])
def test_a_count_tells_how_deep_its_taxel_is_pressed(law: str) -> None:
    """Within half a count, also of one that is pressed flat."""
    pad = pad_of(PadTable(law=law, saturation_N=3.0, force_scale_N=1.0, gain_spread=0.0,
                          repeatability=0.0, noise_counts=0.0, dead_fraction=0.0), HandTable())
    depth = np.linspace(0.1, 1.09, 500) * PadTable().thickness_m
    count = wp.zeros(len(depth), dtype=real, device="cpu")
    read = wp.zeros((len(depth), 2), dtype=real, device="cpu")
    wp.launch(told, len(depth), [pad, wp.array(depth, dtype=real, device="cpu"), count, read],
              device="cpu")
    low, high = read.numpy().T
    known = count.numpy() < 255
    assert (known & (depth > PadTable().thickness_m)).sum() > 20
    assert (low <= depth + 1e-12)[known].all()
    assert (depth <= high + 1e-12)[known].all()


@wp.kernel(enable_backward=False)
def middles(image: wp.array3d[wp.uint8], peak: wp.array[int], least: real, out: wp.array[vec2]):
    i = wp.tid()
    out[i] = image_centroid(image, i, peak[i], least)


def test_a_centroid_is_that_of_the_counts_around_the_strongest_taxel() -> None:
    """Of no more than three taxels each way, and of none that noise may have raised."""
    rng = np.random.default_rng(6)
    images = rng.integers(0, 200, (300, 16, 16)).astype(np.uint8)
    peaks = rng.integers(0, 256, 300)
    images.reshape(300, -1)[np.arange(300), peaks] = 250
    out = wp.zeros(300, dtype=vec2, device="cpu")
    wp.launch(middles, 300, [wp.array(images, device="cpu"), wp.full(300, 250, dtype=int,
                                                                     device="cpu"), 60.0, out],
              device="cpu")
    for image, peak, found in zip(images, peaks, out.numpy(), strict=True):
        row, column = np.mgrid[:16, :16]
        near = np.maximum(abs(row - peak // 16), abs(column - peak % 16)) <= 3
        weight = np.where(near & (image >= 60), image, 0.0)
        wanted = [(weight * place).sum() / weight.sum() for place in (row, column)]
        np.testing.assert_allclose(found, wanted, rtol=1e-12)
