"""The axis of exploration from two cameras (the discussion of Allen and Michelman 1990).

Edges of the silhouettes, lines on the edges by Hough's transform. A line and its camera's centre
span a plane; the planes of two cameras meet in the line's direction. Lines are matched that have
the object on the same side; the longest wins. Where the other side of the object has a line of its
own that is nearly as long, the two are bisected: the sides of a tapering body lean in or out alike.
"""

from dataclasses import dataclass

import numpy as np

from warpgrasp.parameters import StereoTable
from warpgrasp.robot import Robot
from warpgrasp.touch.silhouette import Cameras, stereo_cameras
from warpgrasp.touch.silhouette_faults import object_regions, silhouette_edges
from warpgrasp.touch.tactile_image import hough_lines

_NEAR_PIXELS = 1.6  # edges this near to a Hough line belong to it
_CANDIDATES = 4
_COMPARABLE = 0.6
_LEAN_MOST_RAD = np.radians(50)
_LEAST_SINE = np.sin(np.radians(3))  # planes more alike than this do not meet in a direction


@dataclass(frozen=True)
class StereoAxis:
    """Orientations seen. Shapes start with (world,)."""

    direction: np.ndarray
    """Unit, upwards, (world, 3); vertical where `found` is False."""
    found: np.ndarray
    votes: np.ndarray
    """Edge pixels on the line of each camera, (world, camera 2)."""
    angle_between_planes_rad: np.ndarray
    """Near 0 the direction is worth little."""


def see_axis(robot: Robot, target_m: np.ndarray, table: StereoTable | None = None) -> StereoAxis:
    """Orientations of the objects, seen by two cameras turned to `target_m` (world, 3)."""
    table = table or StereoTable()
    cameras = stereo_cameras(table, np.asarray(target_m, float))
    worlds = len(target_m)
    seen = object_regions(robot.look(cameras, table).reshape(-1, table.pixels, table.pixels))
    noise = table.pixel_noise * robot.camera_noise(2 * table.pixels).reshape(2 * worlds, -1)
    normal, votes = longest_lines(seen, noise, cameras)
    planes = np.einsum("wcij,wcsj->wcsi", cameras.axes, normal.reshape(worlds, 2, 2, 3))
    votes = votes.reshape(worlds, 2, 2)
    along = np.cross(planes[:, 0], planes[:, 1])  # of the lines with the object on each side
    sine = np.linalg.norm(along, axis=-1)
    along = along / np.maximum(sine, 1e-12)[..., None] * np.where(along[..., 2:] < 0, -1.0, 1.0)
    length = np.where((sine > _LEAST_SINE) & (votes > 0).all(1), votes.sum(1), 0)
    best = length.argmax(1)
    rows = np.arange(worlds)
    found = length[rows, best] > 0
    direction, other = along[rows, best], along[rows, 1 - best]
    both = (length.min(1) > _COMPARABLE * length.max(1)) & (
        (direction * other).sum(1) > np.cos(_LEAN_MOST_RAD))
    direction = np.where(both[:, None], direction + other, direction)
    direction = direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
    return StereoAxis(np.where(found[:, None], direction, [0.0, 0.0, 1.0]), found,
                      votes[rows, :, best], np.arcsin(np.clip(sine[rows, best], 0.0, 1.0)))


def longest_lines(
    seen: np.ndarray, noise: np.ndarray, cameras: Cameras
) -> tuple[np.ndarray, np.ndarray]:
    """Planes of the longest line on either side of each silhouette, and their votes.

    `seen` is bool (n, row, column). Returns plane normals in the camera's frame, (n, side 2, 3):
    side 0 has the object towards falling columns (rows, for level lines), and votes (n, side 2),
    0 where there is no line. A Hough line is refined by total least squares over the edges near it,
    each moved along the line's normal by its own `noise` (n, any) [pixels].
    """
    edges = silhouette_edges(seen)
    lines = hough_lines(edges, count=_CANDIDATES, fewest=8)
    normals = np.zeros((len(edges), 2, 3))
    votes = np.zeros((len(edges), 2), int)
    middle = 0.5 * cameras.pixels
    for k, line in zip(*np.nonzero(lines.votes), strict=True):
        angle, offset = lines.angle_rad[k, line], lines.offset[k, line]
        way = np.array([np.cos(angle), np.sin(angle)])
        way = way if way[1] >= 0 else -way
        offset = offset if np.sin(angle) >= 0 else -offset
        points = np.argwhere(edges[k]).astype(float)
        points = points[np.abs(points @ way - offset) <= _NEAR_PIXELS]
        side = int(np.argwhere(seen[k]).mean(0) @ way > offset)
        if len(points) < 3 or votes[k, side] >= lines.votes[k, line]:
            continue
        points = points + np.resize(noise[k], len(points))[:, None] * way
        mean = points.mean(0)
        way = np.linalg.svd(points - mean, full_matrices=False)[2][1]
        # In units of the focal length, from the middle: row is y down, column x to the right.
        y, x = (mean + 0.5 - middle) / cameras.focal_pixels
        plane = np.array([way[1], way[0], -(way[0] * y + way[1] * x)])
        normals[k, side] = plane / np.linalg.norm(plane)
        votes[k, side] = lines.votes[k, line]
    return normals, votes
