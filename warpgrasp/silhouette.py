"""Silhouettes: what two pinhole cameras see of an object, sphere-traced from its distance field."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from warpgrasp.launch import check_range, launch
from warpgrasp.parameters import StereoTable
from warpgrasp.real import HALF, ONE, mat33, real, transform, vec3
from warpgrasp.scene import Scene, body_distance

_MARCHES = wp.constant(200)
_HIT = wp.constant(real(2e-4))  # [m]


@dataclass(frozen=True)
class Cameras:
    """Pinhole cameras of each world. Shapes start with (world, camera)."""

    centre_m: np.ndarray
    """Base frame, (..., 3)."""
    axes: np.ndarray
    """Right, down and forward as columns, (..., 3, 3)."""
    focal_pixels: float
    pixels: int


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


@wp.kernel(enable_backward=False)
def _silhouette_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    march_scale: real,
    # Camera in:
    centre: wp.array2d[vec3],
    axes: wp.array2d[mat33],
    focal: real,
    reach: real,
    # Image out:
    seen: wp.array4d[wp.uint8],
):
    w, camera, row, column = wp.tid()
    w += first
    to_body = wp.transform_inverse(body_pose[w])
    middle = real(seen.shape[2]) * HALF
    x = (real(column) + HALF - middle) / focal
    y = (real(row) + HALF - middle) / focal
    ray = wp.transform_vector(to_body, wp.normalize(axes[w, camera] * vec3(x, y, ONE)))
    start = wp.transform_point(to_body, centre[w, camera])
    t = real(0.0)
    seen[w, camera, row, column] = wp.uint8(0)
    for _ in range(_MARCHES):
        d = body_distance(scene, body[w], start + ray * t)
        if d < _HIT:
            seen[w, camera, row, column] = wp.uint8(1)
            return
        t += wp.max(d * march_scale, _HIT * HALF)
        if t > reach:
            return


def silhouettes(
    scene: Scene, body: np.ndarray, body_pose: np.ndarray, cameras: Cameras, *,
    march_scale: float = 1.0, device: str = "cpu",
) -> np.ndarray:
    """Which pixels see the object, bool (world, camera, row, column). Raises ShapeError,
    and ValueError for a body that the scene has not.
    """
    check_range("body", body, 0, scene.bodies - 1)
    worlds, count = cameras.centre_m.shape[:2]
    n = cameras.pixels
    seen = wp.empty((worlds, count, n, n), dtype=wp.uint8, device=device)
    reach = 2.0 * float(np.linalg.norm(
        cameras.centre_m - np.asarray(body_pose)[:, None, :3], axis=-1).max(initial=0.0))
    launch(_silhouette_kernel, {"world": worlds, "camera": count, "row": n, "column": n}, {
        "body": "world", "body_pose": "world", "centre": "world camera", "axes": "world camera",
        "seen": "world camera row column"}, {
        "scene": scene, "body": wp.array(np.broadcast_to(body, worlds), dtype=int, device=device),
        "body_pose": wp.array(body_pose, dtype=transform, device=device),
        "march_scale": march_scale,
        "centre": wp.array(cameras.centre_m, dtype=vec3, device=device),
        "axes": wp.array(cameras.axes, dtype=mat33, device=device),
        "focal": cameras.focal_pixels, "reach": reach, "seen": seen}, device=device)
    return seen.numpy().astype(bool)
