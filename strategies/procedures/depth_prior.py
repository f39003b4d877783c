"""A prior box from one side: where an object stands, how wide and how high it is, by a depth view.

The camera's level axes are the box's. Its width is what is seen. How far an object goes on behind
what is seen, nobody sees: at least as far as its top does, and otherwise as a round one would.
"""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from strategies.poses.waypoints import BoundingBox
from warpgrasp.parameters import StereoTable
from warpgrasp.robot import Robot

if TYPE_CHECKING:
    from warpgrasp.sight.depth_view import DepthView
OUTERMOST = 0.005
"""Share of the points at either end of a direction that are left out, as depths may be wrong."""
LEAST_SEEN = 20
"""Points without which nothing is said of a world."""
ON_SURFACE = 0.9
"""Probability that a link's ball at a depth that was seen touches the object [est]."""
CLEARED = 0.02
"""Probability left where the camera sees past [est]."""


@dataclass(frozen=True)
class SeenBox(BoundingBox):
    """A box about what was seen, and the view."""

    view: "DepthView"


def see_box(robot: Robot, target_m: np.ndarray,
            table: StereoTable) -> tuple[SeenBox, np.ndarray]:
    """Boxes about what stereo sees of objects, cameras turned to `target_m` (world, 3).

    Also in which worlds the object is in the image and off its edges, bool (world,); the others'
    numbers mean nothing.
    """
    from warpgrasp.sight.silhouette import stereo_cameras  # with it the cameras' kernels

    view = robot.look_deep(stereo_cameras(table, np.asarray(target_m, float)), table)
    return box_of(view)


def box_of(view: "DepthView") -> tuple[SeenBox, np.ndarray]:
    """As `see_box`, of a view."""
    found = np.isfinite(view.depth_m)
    border = np.concatenate([found[:, 0], found[:, -1], found[:, :, 0], found[:, :, -1]], 1)
    whole = (found.sum((1, 2)) >= LEAST_SEEN) & ~border.any(1)
    right, forward = view.axes[:, :, 0], view.axes[:, :, 2].copy()
    forward[:, 2] = 0.0
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    points = np.where(whole[:, None, None], view.points(), 0.0)
    ends = [np.nanquantile((points * way[:, None]).sum(2), (OUTERMOST, 1 - OUTERMOST), axis=1)
            for way in (right, forward)]
    height = np.nanquantile(points[..., 2], 1 - OUTERMOST, axis=1)
    half_width, seen_deep = ((high - low) / 2 for low, high in ends)
    # Beside the outermost pixel the object goes on, by half of one in the mean.
    depth = np.where(found, view.depth_m, np.nan)
    pixel = np.nanmedian(np.where(whole[:, None, None], depth, 0.0), (1, 2)) / view.focal_pixels
    height = height + _unseen_top(view, points, height, pixel)
    half_width = half_width + pixel / 2
    half_deep = np.maximum(seen_deep, np.minimum(half_width, height / 2))
    place = (right[:, :2] * (ends[0].sum(0) / 2)[:, None]
             + forward[:, :2] * (ends[1][0] + half_deep)[:, None])
    half = np.stack([half_width, half_deep], 1)
    return SeenBox(place[:, 0], place[:, 1], np.hypot(half_width, half_deep), height, half,
                   np.arctan2(right[:, 1], right[:, 0]), view), whole


def _unseen_top(view: "DepthView", points: np.ndarray, height: np.ndarray, pixel: np.ndarray
                ) -> np.ndarray:
    """How far objects go on above the highest places seen, `height`, in the mean [m], (world,).

    `points` (world, pixel, 3) are the places seen, and pixels are `pixel` (world,) wide there. A
    camera above the object sees its top, if that is as high in the image as a row of pixels is. Of
    a lower top only a share of the rows would hit it; where none does, the edge lies between two
    rows. A top is about as deep as it is wide.
    """
    along = (points * view.axes[:, None, :, 0]).sum(2)
    high = points[..., 2] > (height - pixel)[:, None]
    deep = (along.max(1, initial=-np.inf, where=high)
            - along.min(1, initial=np.inf, where=high) + pixel)
    down = (view.centre_m[:, 2] - height) / np.maximum(pixel * view.focal_pixels, 1e-9)
    rows = np.clip(deep * down / np.maximum(pixel, 1e-9), 0.0, 1.0)
    return np.asarray(pixel / 2 * (1.0 - rows) ** 2)


def believed_after(view: "DepthView", believed: np.ndarray, middle_m: np.ndarray,
                   radius_m: float) -> np.ndarray:
    """Probabilities (world, cell) that balls of a radius about `middle_m` (world, cell, 3) touch
    the object, after the view: hardly where the camera sees past a ball, likely at a depth seen."""
    after = believed.copy()
    from scipy.ndimage import minimum_filter

    pixels = view.depth_m.shape[1]
    for w, depth in enumerate(view.depth_m):
        own = (middle_m[w] - view.centre_m[w]) @ view.axes[w]
        away = np.maximum(own[:, 2], 1e-6)
        # A ball at the camera, or behind it, may fill the image.
        wide = 2 * min(int(np.ceil(view.focal_pixels[w] * radius_m / away.min())), pixels) + 1
        # The nearest depth beside a pixel; what is not known may be as near as the camera.
        nearest = minimum_filter(np.nan_to_num(depth, nan=0.0, posinf=np.inf), wide,
                                 mode="constant", cval=0.0)
        at = np.floor(own[:, :2] * view.focal_pixels[w] / away[:, None] + pixels / 2).astype(int)
        inside = ((at >= 0) & (at < pixels)).all(1) & (own[:, 2] > 0.0)
        column, row = np.clip(at, 0, pixels - 1).T
        past = inside & (own[:, 2] + radius_m < nearest[row, column])
        on = inside & (np.abs(own[:, 2] - depth[row, column]) < radius_m)
        after[w] = np.where(past, np.minimum(believed[w], CLEARED), believed[w])
        after[w] = np.where(on, np.maximum(after[w], ON_SURFACE), after[w])
    return after


def or_drawn(seen: SeenBox, whole: np.ndarray, drawn: BoundingBox) -> SeenBox:
    """The boxes seen, and where none is whole the drawn ones, with views of which nothing is
    known."""
    def choose(new: np.ndarray, old: np.ndarray) -> np.ndarray:
        return np.where(whole.reshape(-1, *[1] * (new.ndim - 1)), new, old)

    return SeenBox(
        choose(seen.x_m, drawn.x_m), choose(seen.y_m, drawn.y_m),
        choose(seen.radius_m, drawn.radius_m), choose(seen.height_m, drawn.height_m),
        choose(seen.half_m, drawn.half_m), choose(seen.yaw_rad, drawn.yaw_rad),
        replace(seen.view, depth_m=choose(seen.view.depth_m, np.full(1, np.nan))))
