"""Tactile primitives against scipy.ndimage and against shapes whose answer is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy import ndimage

from warpgrasp.touch.tactile_image import (
    hough_lines,
    laplacian_of_gaussian,
    mean_filter,
    median_filter,
    moments,
    sobel,
    sobel_edges,
    zero_crossings,
)

IMAGES = arrays(np.uint8, (3, 16, 16), elements=st.integers(0, 255))


def each(images: np.ndarray, operate) -> np.ndarray:
    return np.stack([operate(image.astype(float)) for image in images])


def test_a_mean_of_nothing_is_nothing() -> None:
    """Exactly: contact counts as values above zero."""
    images = np.zeros((1, 16, 16))
    images[:, 2:6, 2:6] = np.random.default_rng(0).integers(1, 4000, (4, 4))
    assert (mean_filter(images)[:, 7:] == 0.0).all()
    assert (mean_filter(images)[:, :, 7:] == 0.0).all()


@settings(max_examples=30)
@given(IMAGES)
def test_filters_and_edges_match_scipy(images: np.ndarray) -> None:
    np.testing.assert_allclose(mean_filter(images, 5), each(
        images, lambda i: ndimage.uniform_filter(i, 5, mode="nearest")), atol=1e-9)
    np.testing.assert_array_equal(median_filter(images), each(
        images, lambda i: ndimage.median_filter(i, 3, mode="nearest")))
    along_row, along_column = sobel(images)
    np.testing.assert_allclose(along_row, each(
        images, lambda i: ndimage.sobel(i, 0, mode="nearest")), atol=1e-9)
    np.testing.assert_allclose(along_column, each(
        images, lambda i: ndimage.sobel(i, 1, mode="nearest")), atol=1e-9)


@pytest.mark.parametrize("sigma", [0.8, 1.0, 1.5])
def test_laplacian_of_gaussian_matches_scipy_on_smooth_images(sigma: float) -> None:
    # scipy's second derivative kernel is made to sum to zero; on a smooth image both agree.
    r, c = np.mgrid[:48, :48]
    images = 100 * np.exp(-((r - 24) ** 2 + 0.5 * (c - 23) ** 2) / 40)[None]
    ours = laplacian_of_gaussian(images, sigma)
    theirs = each(images, lambda i: ndimage.gaussian_laplace(i, sigma, mode="nearest"))
    np.testing.assert_allclose(ours, theirs, atol=0.02 * np.abs(theirs).max())


@settings(max_examples=30)
@given(IMAGES, st.integers(0, 254))
def test_moments_match_scipy(images: np.ndarray, level: int) -> None:
    m = moments(images, level)
    for k, image in enumerate(images):
        kept = np.where(image > level, image.astype(float), 0.0)
        assert m.area[k] == (image > level).sum()
        if kept.sum() > 0:
            np.testing.assert_allclose(m.centroid[k], ndimage.center_of_mass(kept), atol=1e-9)
        else:
            assert np.isnan(m.centroid[k]).all()
            assert np.isnan(m.eccentricity[k])


@pytest.mark.parametrize("angle_deg", [0, 20, 45, 80, -30, -60])
def test_principal_axis_and_eccentricity_of_an_ellipse(angle_deg: float) -> None:
    a = np.radians(angle_deg)
    r, c = np.mgrid[:101, :101] - 50.0
    along, across = r * np.cos(a) + c * np.sin(a), c * np.cos(a) - r * np.sin(a)
    m = moments(((along / 40) ** 2 + (across / 20) ** 2 <= 1)[None] * 7.0)
    assert m.axis_rad[0] == pytest.approx(a, abs=0.01)
    assert m.eccentricity[0] == pytest.approx(np.sqrt(1 - 0.25), abs=0.005)
    assert m.second[0].sum() - m.second[0, 1] == pytest.approx((40**2 + 20**2) / 4, rel=0.01)


def test_shift_moves_only_the_centroid() -> None:
    image = np.zeros((1, 16, 16))
    image[0, 3:6, 4:9] = np.arange(15).reshape(3, 5)
    there, here = moments(np.roll(image, (5, 2), (1, 2))), moments(image)
    np.testing.assert_allclose(there.centroid - here.centroid, [[5, 2]])
    np.testing.assert_allclose(there.second, here.second, atol=1e-12)


def test_zero_crossings_follow_an_edge() -> None:
    image = np.zeros((1, 16, 16))
    image[:, :, 8:] = 100.0
    crossing = zero_crossings(laplacian_of_gaussian(image, 1.0), level=5.0)
    assert crossing[0, :, 7].all()
    assert crossing.sum() == 16


def test_hough_finds_two_lines_and_no_third() -> None:
    edges = np.zeros((2, 16, 16), bool)
    edges[0, 4] = True  # row = 4
    edges[0, np.arange(2, 14), np.arange(2, 14)] = True  # the diagonal
    lines = hough_lines(edges, count=3, fewest=6)
    assert lines.votes[0, 0] >= 15
    assert lines.angle_rad[0, 0] == pytest.approx(0, abs=np.radians(1))
    assert lines.offset[0, 0] == 4
    assert lines.angle_rad[0, 1] == pytest.approx(np.radians(135), abs=np.radians(4))
    assert abs(lines.offset[0, 1]) <= 1
    assert lines.votes[0, 2] == 0
    assert np.isnan(lines.angle_rad[1]).all()


def test_edges_of_a_square_make_four_sides() -> None:
    image = np.zeros((1, 16, 16))
    image[:, 4:12, 4:12] = 50
    lines = hough_lines(zero_crossings(laplacian_of_gaussian(image, 0.8), 5.0), count=4)
    angles = np.sort(lines.angle_rad[0])
    np.testing.assert_allclose(angles, np.radians([0, 0, 90, 90]), atol=np.radians(8))


def test_sobel_edges_frame_a_step() -> None:
    image = np.zeros((1, 16, 16))
    image[:, :, 8:] = 50.0
    edges = sobel_edges(image, 150.0)
    assert edges[0, :, 7:9].all()
    assert edges.sum() == 32


@pytest.mark.parametrize("sigma", [0.3, 0.5, 0.7, 1.0])
def test_the_laplacian_of_a_constant_is_nothing(sigma: float) -> None:
    response = laplacian_of_gaussian(np.full((1, 16, 16), 100.0), sigma)
    np.testing.assert_allclose(response, 0.0, atol=1e-9)


def test_no_images_give_no_results() -> None:
    none = np.zeros((0, 16, 16))
    assert mean_filter(none).shape == median_filter(none).shape == none.shape
    assert laplacian_of_gaussian(none).shape == zero_crossings(none).shape == none.shape
    assert sobel_edges(none, 1.0).shape == none.shape
    assert moments(none).centroid.shape == (0, 2)
    assert hough_lines(none.astype(bool), count=2).votes.shape == (0, 2)


def test_shapes_are_checked() -> None:
    with pytest.raises(ValueError, match="row, column"):
        mean_filter(np.zeros((16, 16)))
    with pytest.raises(ValueError, match="odd"):
        median_filter(np.zeros((1, 16, 16)), 4)
    edges = np.ones((1, 8, 8), bool)
    for wrong in ({"angles": 0}, {"angles": 2.5}, {"count": -1}, {"fewest": 0}, {"cell": 0.0},
                  {"cell": -1.0}, {"cell": np.nan}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            hough_lines(edges, **wrong)  # type: ignore[arg-type]
