"""How much of an object the hand has found: the share of its surface that lies near a contact.

The surface is what a touch can tell from the table's: the points of the body's sample that are
higher than `TABLE_MARGIN_M`. Insides, as a mug's, count like everything else. Contacts are where
fingers and pads truly touched, so that the share says how well a strategy searches and nothing of
how well it then places its contacts or fits a body to them.
"""

from collections.abc import Iterable

import numpy as np
from scipy.spatial import KDTree

from fit.rotation import matrix_of_quaternion
from strategies.procedures.touches import TABLE_MARGIN_M
from warpgrasp.geometry.body import Body
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.robot import Truth

NEAR_M = 0.010
"""A touch tells of the surface up to here."""
POINTS = 512
"""Of the surface: the standard error of a share is at most 0.02."""
FEW_PAIRS = 32_768
"""Points of a surface times contacts up to which all distances are faster than a tree."""


def open_surface(body: Body, points: int = POINTS) -> np.ndarray:
    """Points spread evenly over what the table does not hide, in the body's frame, (point, 3)."""
    surface = sample_body(body, surface=points).surface_m
    return surface[surface[:, 2] > TABLE_MARGIN_M]


def touched_points(surface_m: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Which points of a surface (point, 3) [m] lie within `NEAR_M` of one of `points_m` (k, 3),
    bool (point,)."""
    if len(points_m) == 0:
        return np.zeros(len(surface_m), bool)
    if len(surface_m) * len(points_m) <= FEW_PAIRS:
        square = np.zeros((len(surface_m), len(points_m)))
        for axis in range(3):
            square += (surface_m[:, None, axis] - points_m[:, axis]) ** 2
        return np.any(square < NEAR_M**2, axis=1)
    return np.isfinite(KDTree(points_m).query(surface_m, distance_upper_bound=NEAR_M)[0])


class TouchedSurface:
    """The surfaces of a batch of objects, of which contacts cover more and more."""

    def __init__(self, bodies: Iterable[tuple[Body, slice]], body_pose: np.ndarray) -> None:
        """`bodies` are pairs of a body and its worlds; they truly stand at `body_pose` (world, 7).
        """
        turn = matrix_of_quaternion(body_pose[:, 3:])
        self._surface: list[np.ndarray] = []
        for body, worlds in bodies:
            local = open_surface(body)
            self._surface += [local @ matrix.T + pose[:3] for matrix, pose in zip(
                turn[worlds], body_pose[worlds], strict=True)]
        self._covered = [np.zeros(len(points), bool) for points in self._surface]
        self._closings = self._lines = 0

    def share(self, truth: Truth) -> np.ndarray:
        """The share covered by all that was touched so far, (world,); NaN where the table hides
        the whole body."""
        felt: list[tuple[np.ndarray, np.ndarray]] = []
        for closing in truth.closings[self._closings:]:
            there = (closing.link >= 0) & ~closing.on_table & ~closing.self_contact
            felt.append((np.nonzero(there)[0], closing.point_m[there]))
        for line in truth.lines[self._lines:]:
            there = np.isfinite(line.point_m).all(1) & ~line.on_table
            felt.append((line.rows[there], line.point_m[there]))
        self._closings, self._lines = len(truth.closings), len(truth.lines)
        if felt:
            self._cover(*(np.concatenate(parts) for parts in zip(*felt, strict=True)))
        return np.array([covered.mean() if len(covered) else np.nan for covered in self._covered])

    def _cover(self, world: np.ndarray, point_m: np.ndarray) -> None:
        order = np.argsort(world, kind="stable")
        points, count = point_m[order], np.bincount(world, minlength=len(self._covered))
        ends = count.cumsum()
        for w in np.flatnonzero(count):
            left = ~self._covered[w]
            self._covered[w][left] = touched_points(
                self._surface[w][left], points[ends[w] - count[w]:ends[w]])
