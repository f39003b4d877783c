"""Faults of silhouettes: as many as asked for, and what of the object is found in spite of them."""

import numpy as np
import pytest

from warpgrasp.core.random import counter_key
from warpgrasp.parameters import StereoTable
from warpgrasp.sight.silhouette_faults import (
    CLUTTER_HEIGHT,
    CLUTTER_WIDTH,
    LINE_LENGTH,
    LINE_WIDTH,
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


def test_things_and_lines_are_as_large_as_their_shares_of_the_width() -> None:
    """In empty images each is alone; what is cut at the border may be smaller."""
    key = counter_key(9, np.arange(100))
    empty = np.zeros((100, 2, PIXELS, PIXELS), bool)
    for table, height, width in (
            (StereoTable(clutter=1), CLUTTER_HEIGHT, CLUTTER_WIDTH),
            (StereoTable(spurious_edges=1), (0.0, LINE_LENGTH[1]), (0.0, LINE_LENGTH[1]))):
        images = faulty_silhouettes(empty, key, table).reshape(-1, PIXELS, PIXELS)
        whole = [np.ptp(np.argwhere(image), axis=0) + 1 for image in images if image.any()
                 and not (image[[0, -1]].any() or image[:, [0, -1]].any())]
        sides = np.array(whole) / PIXELS
        for side, (least, most) in zip(sides.T, (height, width), strict=True):
            assert least - 0.01 < side.min()
            assert 0.85 * most < side.max() < most + LINE_WIDTH + 0.01
        if table.spurious_edges:
            assert np.hypot(*sides.T).min() > LINE_LENGTH[0] - 0.01


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


def test_an_object_in_the_middle_is_found_beside_a_larger_thing() -> None:
    seen = disc(16.0)[0, 0]
    image = seen.copy()
    image[:40, :60] = True
    found, = object_regions(image[None])
    assert found[60:68, 60:68].all()
    assert not found[:40, :60].any()


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
