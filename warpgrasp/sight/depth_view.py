"""What a pair of cameras sees of an object from one side: a depth image, with errors and gaps.

Stereo matches patches of one camera's image with those of the other. A disparity that is wrong by
so many pixels is a depth z that is wrong by z^2 / (focal length x baseline) times as much, and
where no match is found nothing is known.
"""

from dataclasses import dataclass, replace

import numpy as np

from warpgrasp.core.random import Purpose, counter_key, counter_normal, counter_uniform
from warpgrasp.geometry.scene import Scene
from warpgrasp.parameters import StereoTable
from warpgrasp.sight.silhouette import Cameras, depths

MATCHED = 4
"""Pixels of an image, each way, that are matched as one [est]."""
PATCH = 8
"""Matched pixels, each way, that are missing together [est]."""
_NOISE, _MISSING = 5, 6  # streams of the camera's; `silhouette_faults` has 1 to 4


@dataclass(frozen=True)
class DepthView:
    """A depth image of each world's object."""

    centre_m: np.ndarray
    """Of the camera, base frame, (world, 3)."""
    axes: np.ndarray
    """Right, down and forward as columns, (world, 3, 3)."""
    focal_pixels: np.ndarray
    """(world,)."""
    depth_m: np.ndarray
    """Along forward, (world, row, column); infinite where a pixel sees past the object, NaN where
    nothing is known."""

    def points(self) -> np.ndarray:
        """Places on the object that were seen, base frame (world, pixel, 3); NaN elsewhere."""
        pixels = self.depth_m.shape[1]
        at = (np.arange(pixels) + 0.5 - pixels / 2)[None] / self.focal_pixels[:, None]
        depth = np.where(np.isfinite(self.depth_m), self.depth_m, np.nan)
        own = np.stack([depth * at[:, None, :], depth * at[:, :, None], depth], -1)
        return self.centre_m[:, None] + own.reshape(len(own), -1, 3) @ self.axes.transpose(0, 2, 1)


def seen_depths(
    scene: Scene, body: np.ndarray, body_pose: np.ndarray, cameras: Cameras, table: StereoTable,
    key: np.ndarray, *, device: str = "cpu",
) -> DepthView:
    """What the first of two cameras (world, camera 2) and stereo tell; `key` (world,) uint64 seeds
    errors and gaps. Raises as `silhouettes`."""
    first = replace(cameras, centre_m=cameras.centre_m[:, :1], axes=cameras.axes[:, :1],
                    focal_pixels=cameras.focal_pixels / MATCHED,
                    pixels=max(cameras.pixels // MATCHED, 1))
    depth = depths(scene, body, body_pose, first, device=device)[:, 0]
    stream = counter_key(key, int(Purpose.CAMERA), 0)[:, None, None]
    number = np.arange(first.pixels**2).reshape(first.pixels, first.pixels)
    wrong = table.pixel_noise * counter_normal(counter_key(stream, _NOISE, number))
    matched = np.isfinite(depth)
    near = np.where(matched, depth, 0.0)
    depth = np.where(matched, near + near**2 / (cameras.focal_pixels * table.baseline_m) * wrong,
                     depth)
    patch = number // first.pixels // PATCH * first.pixels + number % first.pixels // PATCH
    draw = counter_uniform(counter_key(stream, _MISSING, patch))
    depth = np.where(draw < table.missing_depth, np.nan, depth)
    return DepthView(first.centre_m[:, 0], first.axes[:, 0],
                     np.full(len(depth), first.focal_pixels), depth)
