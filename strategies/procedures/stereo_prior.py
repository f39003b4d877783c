"""A prior cylinder from two cameras: where an object stands, how wide and how high it is.

Seen from above, an upright cylinder lies between two vertical planes through a camera's centre.
Halfway between them is a plane through its axis; the axis is where these planes of two cameras
meet, and the radius is the distance times the sine of half the angle between the two.
"""

from typing import TYPE_CHECKING

import numpy as np

from strategies.poses.waypoints import BoundingCylinder
from warpgrasp.parameters import StereoTable
from warpgrasp.robot import Robot

if TYPE_CHECKING:
    from warpgrasp.sight.silhouette import Cameras
_READ = 3
"""Numbers read off each image: right, left, top."""


def see_cylinder(robot: Robot, target_m: np.ndarray,
                 table: StereoTable) -> tuple[BoundingCylinder, np.ndarray]:
    """Cylinders around what cameras turned to `target_m` (world, 3) see of the objects.

    Also in which worlds both silhouettes are there and off the images' edges, bool (world,); the
    others' numbers mean nothing.
    """
    from warpgrasp.sight.silhouette import stereo_cameras  # with it the cameras' kernels
    from warpgrasp.sight.silhouette_faults import object_regions

    cameras = stereo_cameras(table, np.asarray(target_m, float))
    images = robot.look(cameras, table)
    seen = object_regions(images.reshape(-1, *images.shape[2:])).reshape(images.shape)
    noise = table.pixel_noise * robot.camera_noise(2 * _READ).reshape(-1, 2, _READ)
    return cylinder_of(seen, noise, cameras)


def cylinder_of(seen: np.ndarray, noise: np.ndarray,
                cameras: "Cameras") -> tuple[BoundingCylinder, np.ndarray]:
    """As `see_cylinder`, of silhouettes (world, camera 2, row, column).

    `noise` (world, camera 2, 3) [pixels] moves the right, left and upper edge outwards.
    """
    border = np.concatenate([seen[..., 0, :], seen[..., -1, :], seen[..., 0], seen[..., -1]], -1)
    whole = np.all(seen.any((2, 3)) & ~border.any(-1), axis=1)
    azimuth, rise = _rays(cameras)  # of every pixel
    step = 1.0 / cameras.focal_pixels  # angle of a pixel at the middle of an image
    # One of many rows has its outermost pixel at the very edge: no half a pixel more.
    low = np.where(seen, azimuth, np.inf).min((2, 3)) - step * noise[..., 0]
    high = np.where(seen, azimuth, -np.inf).max((2, 3)) + step * noise[..., 1]
    top = np.where(seen, rise, -np.inf).max((2, 3)) + step * (0.5 + noise[..., 2])
    low, high, top = (np.where(whole[:, None], v, 0.0) for v in (low, high, top))
    half = np.clip((high - low) / 2, 0.0, np.pi / 3)
    forward = np.arctan2(cameras.axes[..., 1, 2], cameras.axes[..., 0, 2])
    axis, away = _meeting(cameras.centre_m[..., :2], forward + (low + high) / 2)
    radius = (away * np.sin(half)).mean(1)
    # What is highest in the image is the far rim seen from above, the near one from below.
    rim = away + np.where(top < 0, radius[:, None], -radius[:, None])
    height = (cameras.centre_m[..., 2] + rim * top).mean(1)
    return BoundingCylinder(axis[:, 0], axis[:, 1], radius, height), np.asarray(whole)


def _rays(cameras: "Cameras") -> tuple[np.ndarray, np.ndarray]:
    """Of each pixel's ray: its azimuth from the camera's forward [rad], and how much it rises for
    each metre of level way; (world, camera, row, column)."""
    at = (np.arange(cameras.pixels) + 0.5 - cameras.pixels / 2) / cameras.focal_pixels
    own = np.stack([*np.meshgrid(at, at), np.ones((len(at), len(at)))], -1)  # right, down, forward
    ray = np.einsum("wcij,rsj->wcrsi", cameras.axes, own)
    forward = np.arctan2(cameras.axes[..., 1, 2], cameras.axes[..., 0, 2])[..., None, None]
    azimuth = np.arctan2(ray[..., 1], ray[..., 0]) - forward
    azimuth = (azimuth + np.pi) % (2 * np.pi) - np.pi
    return azimuth, ray[..., 2] / np.linalg.norm(ray[..., :2], axis=-1)


def _meeting(centre: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the level lines of two cameras meet, (world, 2), and how far from each, (world, 2).

    `centre` (world, camera 2, 2), `azimuth` (world, camera 2).
    """
    way = np.stack([np.cos(azimuth), np.sin(azimuth)], -1)
    between = centre[:, 1] - centre[:, 0]
    cross = way[:, 0, 0] * way[:, 1, 1] - way[:, 0, 1] * way[:, 1, 0]
    cross = np.where(np.abs(cross) < 1e-6, 1e-6, cross)
    first = (between[:, 0] * way[:, 1, 1] - between[:, 1] * way[:, 1, 0]) / cross
    axis = centre[:, 0] + first[:, None] * way[:, 0]
    return axis, np.linalg.norm(axis[:, None] - centre, axis=-1)
