"""Silhouettes and depths: what pinhole cameras see of an object, sphere-traced from its distance
field."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpgrasp.core.array_checks import check_array, check_finite, check_poses, check_range
from warpgrasp.core.dtypes import mat33, real, transform, uint8, vec3
from warpgrasp.core.kernel_launch import ShapeError, launch
from warpgrasp.geometry.scene import Scene
from warpgrasp.parameters import StereoTable
from warpgrasp.sight.silhouette_kernel import _range_kernel, _silhouette_kernel

_MOST_PIXELS = 4096


@dataclass(frozen=True)
class Cameras:
    """Pinhole cameras of each world. Shapes start with (world, camera).

    Raises TypeError and ValueError for other arrays, for numbers that are not finite, and for
    images of no pixels or no focal length.
    """

    centre_m: np.ndarray
    """Base frame, (..., 3)."""
    axes: np.ndarray
    """Right, down and forward as columns, (..., 3, 3)."""
    focal_pixels: float
    pixels: int

    def __post_init__(self) -> None:
        check_array("centre_m", self.centre_m, "numbers", "world camera 3")
        worlds, count = self.centre_m.shape[:2]
        check_array("axes", self.axes, "numbers", "world camera 3 3", world=worlds, camera=count)
        for name in ("centre_m", "axes"):
            check_finite(name, getattr(self, name))
        check_range("pixels", self.pixels, 1, _MOST_PIXELS)
        if not 0.0 < self.focal_pixels < np.inf:
            raise ValueError(f"focal_pixels {self.focal_pixels}: should be above 0 and finite")


def stereo_cameras(table: StereoTable, target_m: np.ndarray) -> Cameras:
    """Two cameras a baseline apart, each turned towards its world's `target_m` (world, 3)."""
    bearing, up = table.azimuth_rad, table.elevation_rad
    away = np.array([np.cos(up) * np.cos(bearing), np.cos(up) * np.sin(bearing), np.sin(up)])
    side = np.cross([0.0, 0.0, 1.0], away)
    side /= np.linalg.norm(side)
    offsets = table.distance_m * away + 0.5 * table.baseline_m * np.stack([-side, side])
    forward = -offsets / np.linalg.norm(offsets, axis=1, keepdims=True)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    axes = np.stack([right, np.cross(forward, right), forward], -1)
    focal = 0.5 * table.pixels / np.tan(0.5 * table.field_of_view_rad)
    return Cameras(target_m[:, None] + offsets, np.tile(axes, (len(target_m), 1, 1, 1)),
                   float(focal), table.pixels)


def silhouettes(
    scene: Scene, body: np.ndarray, body_pose: np.ndarray, cameras: Cameras, *,
    device: str = "cpu",
) -> np.ndarray:
    """Which pixels see the object, bool (world, camera, row, column). Raises ShapeError, and
    ValueError for a body that the scene has not, or a pose that is no place and unit quaternion.
    """
    seen = _traced(_silhouette_kernel, "seen", uint8, scene, body, body_pose, cameras, device)
    return seen.astype(bool)


def depths(
    scene: Scene, body: np.ndarray, body_pose: np.ndarray, cameras: Cameras, *,
    device: str = "cpu",
) -> np.ndarray:
    """How far along each camera's forward axis the object is [m], (world, camera, row, column);
    infinite where a pixel sees past it. Raises as `silhouettes`.
    """
    far = _traced(_range_kernel, "far", real, scene, body, body_pose, cameras, device)
    at = (np.arange(cameras.pixels) + 0.5 - cameras.pixels / 2) / cameras.focal_pixels
    return np.where(far < 0.0, np.inf, far / np.sqrt(1.0 + at**2 + at[:, None] ** 2))


def _traced(
    kernel: Any, name: str, kind: type, scene: Scene, body: np.ndarray, body_pose: np.ndarray,
    cameras: Cameras, device: str,
) -> np.ndarray:
    """What a kernel writes to its argument `name`, (world, camera, row, column)."""
    check_range("body", body, 0, scene.bodies - 1)
    worlds, count = cameras.centre_m.shape[:2]
    if np.shape(body_pose) != (worlds, 7):
        raise ShapeError(f"body_pose: of shape {np.shape(body_pose)}; should be (world {worlds}, "
                         "7)")
    check_poses("body_pose", np.asarray(body_pose))
    n = cameras.pixels
    image = wp.empty((worlds, count, n, n), dtype=kind, device=device)
    reach = 2.0 * float(np.linalg.norm(
        cameras.centre_m - np.asarray(body_pose)[:, None, :3], axis=-1).max(initial=0.0))
    launch(kernel, {"world": worlds, "camera": count, "row": n, "column": n}, {
        "body": "world", "body_pose": "world", "centre": "world camera", "axes": "world camera",
        name: "world camera row column"}, {
        "scene": scene, "body": wp.array(np.broadcast_to(body, worlds), dtype=int, device=device),
        "body_pose": wp.array(body_pose, dtype=transform, device=device),
        "centre": wp.array(cameras.centre_m, dtype=vec3, device=device),
        "axes": wp.array(cameras.axes, dtype=mat33, device=device),
        "focal": cameras.focal_pixels, "reach": reach, name: image}, device=device)
    return image.numpy().copy()
