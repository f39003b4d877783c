"""The axis of exploration from two cameras (the discussion of Allen and Michelman 1990).

Edges of the silhouettes, lines on the edges by Hough's transform. A line and its camera's centre
span a plane; the planes of two cameras meet in the line's direction. Lines are matched that have
the object on the same side and lie at the same height; the longest wins. Where the other side of
the object has a line there that is nearly as long, the two are bisected: the sides of a tapering
body lean in or out alike. A direction that lies rather than stands is no axis.
"""

from dataclasses import dataclass

import numpy as np

from warpgrasp.parameters import StereoTable
from warpgrasp.robot import Robot
from warpgrasp.sight.silhouette import Cameras, stereo_cameras
from warpgrasp.sight.silhouette_faults import object_regions, silhouette_edges
from warpgrasp.touch.tactile_image import hough_lines

_NEAR_PIXELS = 1.6  # edges this near to a Hough line belong to it
_CANDIDATES = 8
_EDGES = 4  # edge pixels of an image that have noise of their own, for each of its rows
_COMPARABLE = 0.6
_LEAN_MOST_RAD = np.radians(40)
"""Of an axis that stands, and of the two sides from each other: the contour follower's limit."""
_SAME_HEIGHT = 0.05
"""Lines of both images are matched whose middles differ by less than this share of the rows: the
cameras stand at one height [est]."""
_LEAST_SINE = np.sin(np.radians(3))  # planes more alike than this do not meet in a direction


@dataclass(frozen=True)
class StereoAxis:
    """Orientations seen. Shapes start with (world,)."""

    direction: np.ndarray
    """Unit, upwards, (world, 3); vertical where `found` is False."""
    found: np.ndarray
    votes: np.ndarray
    """Edge pixels on the line of each camera, (world, camera 2)."""


def see_axis(robot: Robot, target_m: np.ndarray, table: StereoTable | None = None) -> StereoAxis:
    """Orientations of the objects, seen by two cameras turned to `target_m` (world, 3)."""
    table = table or StereoTable()
    cameras = stereo_cameras(table, np.asarray(target_m, float))
    worlds = len(target_m)
    seen = object_regions(robot.look(cameras, table).reshape(-1, table.pixels, table.pixels))
    noise = table.pixel_noise * robot.camera_noise(2 * _EDGES * table.pixels, axis=True).reshape(
        2 * worlds, -1)
    lines = longest_lines(seen, noise, cameras).reshaped(worlds)
    planes = np.einsum("wcij,wckj->wcki", cameras.axes, lines.normal)
    along = np.cross(planes[:, 0, :, None], planes[:, 1, None])  # of each pair, (world, k, k, 3)
    sine = np.linalg.norm(along, axis=-1)
    along = along / np.maximum(sine, 1e-12)[..., None] * np.where(along[..., 2:] < 0, -1.0, 1.0)
    length = _pairs(lines, table.pixels) * (sine > _LEAST_SINE) * (
        along[..., 2] > np.cos(_LEAN_MOST_RAD))
    # Of pairs in one row each: the longest alone, or with its counterpart on the other side.
    length, along = (v.reshape(worlds, -1, *v.shape[3:]) for v in (length, along))
    one, other, total = _two_sided(length, along, lines, table.pixels)
    rows = np.arange(worlds)
    best = np.where(total > length.max(1), one, length.argmax(1))
    both = total > length.max(1)
    direction = along[rows, best] + np.where(both[:, None], along[rows, other], 0.0)
    direction = direction / np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
    found = length[rows, best] > 0
    votes = np.stack([lines.votes[rows, camera, line] for camera, line in enumerate(
        np.divmod(best, lines.votes.shape[2]))], 1)
    return StereoAxis(np.where(found[:, None], direction, [0.0, 0.0, 1.0]), found,
                      np.where(found[:, None], votes, 0))


def _pairs(lines: "EdgeLines", pixels: int) -> np.ndarray:
    """Edge pixels of both lines of each pair that may be one edge, 0 of others, (world, k, k)."""
    (side, sides), (row, rows), (votes, more) = (
        (v[:, 0, :, None], v[:, 1, None]) for v in (lines.side, lines.row, lines.votes))
    same = (side == sides) & (np.abs(row - rows) < _SAME_HEIGHT * pixels)
    return (votes + more) * (same & (votes > 0) & (more > 0))


def _two_sided(
    length: np.ndarray, along: np.ndarray, lines: "EdgeLines", pixels: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The longest two pairs that may be the two sides of a body, and their length together.

    They have the object between them, lie at the same height, are nearly as long as each other,
    and do not lean far from each other. `length` is (world, pair) and `along` (world, pair, 3);
    returned are the numbers of the pairs and their length, (world,) each.
    """
    worlds, count = length.shape
    row = (0.5 * (lines.row[:, 0, :, None] + lines.row[:, 1, None])).reshape(worlds, -1)
    side = np.repeat(lines.side[:, 0], lines.side.shape[2], axis=1)
    a, b = length[:, :, None], length[:, None]
    fits = ((side[:, :, None] != side[:, None])
            & (np.minimum(a, b) > _COMPARABLE * np.maximum(a, b))
            & (np.abs(row[:, :, None] - row[:, None]) < _SAME_HEIGHT * pixels)
            & (np.einsum("wpi,wqi->wpq", along, along) > np.cos(_LEAN_MOST_RAD)))
    total = np.where(fits, a + b, 0).reshape(worlds, -1)
    best = total.argmax(1)
    return *np.divmod(best, count), total[np.arange(worlds), best]


@dataclass(frozen=True)
class EdgeLines:
    """Straight lines on the edges of silhouettes. Shapes start with (image, line)."""

    normal: np.ndarray
    """Of the plane through the line and the camera's centre, camera's frame, unit, (..., 3)."""
    side: np.ndarray
    """1 where the object lies towards rising columns (rows, for level lines), else 0."""
    row: np.ndarray
    """Of the middle of the edge pixels on it."""
    votes: np.ndarray
    """How many there are; 0: no line."""

    def reshaped(self, worlds: int) -> "EdgeLines":
        """With (world, camera, line) in place of (image, line)."""
        return EdgeLines(*(v.reshape(worlds, -1, *v.shape[1:]) for v in (
            self.normal, self.side, self.row, self.votes)))


def longest_lines(seen: np.ndarray, noise: np.ndarray, cameras: Cameras) -> EdgeLines:
    """The longest lines on the edges of each silhouette.

    `seen` is bool (n, row, column). A Hough line is refined by total least squares over the edges
    near it, each moved along the line's normal by its own `noise` (n, any) [pixels]: that of its
    number among the edges.
    """
    edges = silhouette_edges(seen)
    lines = hough_lines(edges, count=_CANDIDATES, fewest=8)
    normals = np.zeros((*lines.votes.shape, 3))
    side, row, votes = (np.zeros(lines.votes.shape, kind) for kind in (int, float, int))
    middle = 0.5 * cameras.pixels
    for k, line in zip(*np.nonzero(lines.votes), strict=True):
        angle, offset = lines.angle_rad[k, line], lines.offset[k, line]
        way = np.array([np.cos(angle), np.sin(angle)])
        way = way if way[1] >= 0 else -way
        offset = offset if np.sin(angle) >= 0 else -offset
        points = np.argwhere(edges[k]).astype(float)
        moved = np.resize(noise[k], len(points))
        near = np.abs(points @ way - offset) <= _NEAR_PIXELS
        points, moved = points[near], moved[near]
        if len(points) < 3:
            continue
        side[k, line] = int(np.argwhere(seen[k]).mean(0) @ way > offset)
        points = points + moved[:, None] * way
        mean = points.mean(0)
        way = np.linalg.svd(points - mean, full_matrices=False)[2][1]
        # In units of the focal length, from the middle: row is y down, column x to the right.
        y, x = (mean + 0.5 - middle) / cameras.focal_pixels
        plane = np.array([way[1], way[0], -(way[0] * y + way[1] * x)])
        normals[k, line] = plane / np.linalg.norm(plane)
        row[k, line], votes[k, line] = mean[0], lines.votes[k, line]
    return EdgeLines(normals, side, row, votes)
