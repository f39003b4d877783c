"""Faults of silhouettes: as many as asked for, and what of the object is found in spite of them."""

import numpy as np
import pytest

from warpgrasp.core.random import counter_key
from warpgrasp.parameters import StereoTable
from warpgrasp.sight.silhouette_faults import (
    faulty_silhouettes,
    object_regions,
    silhouette_edges,
)

PIXELS = 128
KEY = counter_key(8, np.arange(6))


def disc(radius: float = 30.0) -> np.ndarray:
    rows, columns = np.ogrid[:PIXELS, :PIXELS]
    image = (rows - 63.5) ** 2 + (columns - 63.5) ** 2 <= radius**2
    return np.tile(image, (len(KEY), 2, 1, 1))


def test_no_fault_is_no_change() -> None:
    seen = disc()
    np.testing.assert_array_equal(faulty_silhouettes(seen, KEY, StereoTable()), seen)


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_as_much_of_the_edge_is_missing_as_asked_for(share: float) -> None:
    seen = disc()
    faulty = faulty_silhouettes(seen, KEY, StereoTable(missing_edges=share))
    assert not (faulty & ~seen).any()
    lost = silhouette_edges(seen) & ~faulty
    found = lost.sum((2, 3)) / silhouette_edges(seen).sum((2, 3))
    assert (found >= share).all()
    assert found.max() < share + 0.06  # a gap is 2 x 3 % of the width long


def test_pixels_are_flipped_independently() -> None:
    seen = disc()
    faulty = faulty_silhouettes(seen, KEY, StereoTable(flipped_pixels=0.1))
    flipped = faulty != seen
    assert flipped.mean() == pytest.approx(0.1, abs=0.003)
    assert (flipped[0, 0] & flipped[0, 1]).mean() == pytest.approx(0.01, abs=0.004)


def test_clutter_adds_and_lines_cut() -> None:
    seen = disc()
    cluttered = faulty_silhouettes(seen, KEY, StereoTable(clutter=4))
    assert not (seen & ~cluttered).any()
    assert (cluttered & ~seen).any((2, 3)).all()
    lined = faulty_silhouettes(seen, KEY, StereoTable(spurious_edges=20))
    assert (seen & ~lined).any()
    assert (lined & ~seen).any()


def test_faults_depend_on_the_world_alone() -> None:
    table = StereoTable(missing_edges=0.2, spurious_edges=3, clutter=2, flipped_pixels=0.05)
    whole = faulty_silhouettes(disc(), KEY, table)
    np.testing.assert_array_equal(whole[3:4], faulty_silhouettes(disc()[3:4], KEY[3:4], table))
    assert (whole[0] != whole[1]).any()
    assert (whole[:, 0] != whole[:, 1]).any()


def test_the_object_is_found_among_lines_flips_and_things_apart() -> None:
    seen = disc()
    table = StereoTable(spurious_edges=4, flipped_pixels=0.05)
    images = faulty_silhouettes(seen, KEY, table)
    images[:, :, :20, :30] = True  # larger than nothing, and farther from the middle
    found = object_regions(images.reshape(-1, PIXELS, PIXELS)).reshape(seen.shape)
    iou = (found & seen).sum((2, 3)) / (found | seen).sum((2, 3))
    assert np.median(iou) > 0.95
    raw = (images & seen).sum((2, 3)) / (images | seen).sum((2, 3))
    assert (iou > raw).all()


def test_a_clean_object_stays_and_nothing_is_nothing() -> None:
    seen = disc()[:1].reshape(-1, PIXELS, PIXELS)
    found = object_regions(seen)
    assert (found != seen).sum() <= 0.01 * seen.sum()
    assert not object_regions(np.zeros((1, PIXELS, PIXELS), bool)).any()
    edge = np.zeros((1, PIXELS, PIXELS), bool)
    edge[:, 40:, 50:80] = True  # down to the border: it must still touch it
    assert object_regions(edge)[0, -1, 55:75].all()


def test_a_batch_may_be_empty() -> None:
    table = StereoTable(flipped_pixels=0.1, missing_edges=0.1)
    for worlds, cameras in ((0, 2), (6, 0)):
        seen = disc()[:worlds, :cameras]
        assert faulty_silhouettes(seen, KEY[:worlds], table).shape == seen.shape
