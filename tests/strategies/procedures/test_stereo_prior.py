"""The cylinder that two cameras see, by the silhouettes of one that rays meet exactly."""

from dataclasses import replace

import numpy as np
import pytest

from strategies.procedures.stereo_prior import cylinder_of
from warpgrasp.parameters import StereoTable
from warpgrasp.sight.silhouette import Cameras, stereo_cameras

TABLE = StereoTable(pixels=256)
TRUE = np.array([0.47, -0.03, 0.035, 0.14])
"""Place, radius and height [m]."""


def silhouettes(cameras: Cameras, x: float, y: float, radius: float, height: float) -> np.ndarray:
    """Which rays pass an upright cylinder on the table between its sides and its ends."""
    at = (np.arange(cameras.pixels) + 0.5) / cameras.focal_pixels
    at = at - at.mean()
    across, down = np.meshgrid(at, at)
    own = np.stack([across, down, np.ones_like(across)], -1)
    way = np.einsum("wcij,rsj->wcrsi", cameras.axes, own)
    begin = cameras.centre_m[:, :, None, None] - [x, y, 0.0]
    a, b = (way[..., :2] ** 2).sum(-1), (way[..., :2] * begin[..., :2]).sum(-1)
    root = b**2 - a * ((begin[..., :2] ** 2).sum(-1) - radius**2)
    reach = np.sqrt(np.maximum(root, 0.0))
    ends = np.sort([-begin[..., 2] / way[..., 2], (height - begin[..., 2]) / way[..., 2]], axis=0)
    first, last = np.maximum((-b - reach) / a, ends[0]), np.minimum((-b + reach) / a, ends[1])
    return (root > 0.0) & (first < last)


def found(elevation_deg: float, noise: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Place, radius and height of one world's cylinder, and whether it was seen whole."""
    table = replace(TABLE, elevation_rad=np.radians(elevation_deg))
    cameras = stereo_cameras(table, np.array([[0.45, 0.0, 0.07]]))
    seen, whole = cylinder_of(silhouettes(cameras, *TRUE), np.zeros((1, 2, 3)) + noise, cameras)
    return np.array([seen.x_m[0], seen.y_m[0], seen.radius_m[0], seen.height_m[0]]), whole


@pytest.mark.parametrize("elevation_deg", [30.0, 2.0])
def test_a_cylinder_is_seen_where_it_stands_from_above_and_from_below_its_top(
        elevation_deg: float) -> None:
    """From above, its highest pixel is of the far rim; from below, of the near one."""
    cylinder, whole = found(elevation_deg)
    assert whole.tolist() == [True]
    np.testing.assert_allclose(cylinder, TRUE, atol=0.002)


def test_noise_moves_each_edge_of_a_silhouette_outwards() -> None:
    """Ten pixels on both sides widen the body, on one side shift it; the upper edge raises it."""
    cylinder, _ = found(15.0)
    wider, shifted, taller = (found(15.0, 10.0 * np.array(edges))[0] - cylinder
                              for edges in ([1, 1, 0], [1, -1, 0], [0, 0, 1]))
    pixel = 2.0 * np.tan(TABLE.field_of_view_rad / 2.0) / TABLE.pixels
    away = np.hypot(TABLE.distance_m, TABLE.baseline_m / 2.0)
    np.testing.assert_allclose([wider[2], taller[3]], 10.0 * pixel * away, rtol=0.1)
    # The first is the right edge: of cameras on the side of -y, towards +x.
    np.testing.assert_allclose(shifted[:3], [10.0 * pixel * away, 0.0, 0.0], atol=0.003)
    np.testing.assert_allclose(wider[[0, 1, 3]], 0.0, atol=0.003)


def test_a_silhouette_that_an_image_cuts_off_is_not_whole() -> None:
    cameras = stereo_cameras(TABLE, np.array([[0.45, 0.0, 0.07]] * 2))
    seen = np.concatenate([silhouettes(cameras, *TRUE)[:1],
                           silhouettes(cameras, 0.65, 0.0, 0.035, 0.14)[1:]])
    assert cylinder_of(seen, np.zeros((2, 2, 3)), cameras)[1].tolist() == [True, False]
    seen[1, 0] = seen[0, 0]
    seen[1, 1] = False  # nothing in the other image
    assert cylinder_of(seen, np.zeros((2, 2, 3)), cameras)[1].tolist() == [True, False]
