"""How much of an object the hand has found: the share of its surface that lies near a contact.

The surface is what a touch can tell from the table's: the points of the body's sample that are
higher than `TABLE_MARGIN_M`. Insides, as a mug's, count like everything else.
"""

from collections.abc import Iterable

import numpy as np

from fit.rotation import matrix_of_quaternion
from strategies.recovery.evidence import TABLE_MARGIN_M
from warpgrasp.geometry.body import Body
from warpgrasp.geometry.body_sampling import sample_body

NEAR_M = 0.010
"""A touch tells of the surface up to here."""
POINTS = 512
"""Of the surface: a share is then right to a few hundredths of its own spread."""


def open_surface(body: Body, points: int = POINTS) -> np.ndarray:
    """Points spread evenly over what the table does not hide, in the body's frame, (point, 3)."""
    surface = sample_body(body, surface=points).surface_m
    return surface[surface[:, 2] > TABLE_MARGIN_M]


def touched_points(
    surface_m: np.ndarray, points_m: np.ndarray, near_m: float = NEAR_M
) -> np.ndarray:
    """Which points of a surface (point, 3) [m] lie within `near_m` of one of `points_m` (k, 3),
    bool (point,)."""
    from scipy.spatial import KDTree

    if len(points_m) == 0:
        return np.zeros(len(surface_m), bool)
    return np.isfinite(KDTree(points_m).query(surface_m, distance_upper_bound=near_m)[0])


def touched_share(
    bodies: Iterable[tuple[Body, np.ndarray]], body_pose: np.ndarray, points_m: np.ndarray,
    mask: np.ndarray
) -> np.ndarray:
    """The share of each world's open surface within `NEAR_M` of a contact, (world,).

    `bodies` are pairs of a body and its worlds, `body_pose` (world, 7) their true poses, `points_m`
    (world, point, 3) [m] contacts in the base frame, of which `mask` (world, point) count. NaN
    where all of a body is hidden by the table.
    """
    share = np.full(len(body_pose), np.nan)
    turn = matrix_of_quaternion(body_pose[:, 3:])
    for body, worlds in bodies:
        surface = open_surface(body)
        for world in worlds if len(surface) else ():
            felt = points_m[world][mask[world]]
            share[world] = touched_points(
                surface, (felt - body_pose[world, :3]) @ turn[world]).mean()
    return share
