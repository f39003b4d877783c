"""Grasping by containment (Allen and Michelman 1990, section IV-C): the first procedure.

The hand goes to each waypoint and closes along each path until every finger's tendons say contact.
What is felt becomes evidence for a fit: contact points with covariance and normal, and balls along
the links that touched nothing and so lie outside the body.
"""

from dataclasses import dataclass

import numpy as np

from strategies.closing_paths import CLOSING_PATHS, closing_commands
from warpgrasp.robot import Grasps, Robot
from warpgrasp.status import ProbeStatus

TABLE_MARGIN_M = 0.006
"""Contacts believed lower than this are taken to be the table."""
FREE_SLACK_M = 0.002
"""Links reported free are thinned by this: their places are known no better."""


@dataclass(frozen=True)
class Evidence:
    """What has been felt, base frame, ready for a fit. Shapes start with (world,)."""

    points_m: np.ndarray
    """(..., point, 3)."""
    mask: np.ndarray
    """(..., point): which slots hold a contact."""
    covariance_m2: np.ndarray
    """(..., point, 3, 3)."""
    normals: np.ndarray
    """Outward, (..., point, 3)."""
    free_m: np.ndarray
    """Centres of balls that lie outside the body, (..., free, 3)."""
    free_radius_m: float
    free_mask: np.ndarray
    """(..., free)."""


def padded_commands(closings: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Commands of several paths, (grasp, finger, step, 4) [rad], and how many steps each has."""
    paths = [closing_commands(CLOSING_PATHS[name]) for name in closings]
    longest = max(p.shape[1] for p in paths)
    padded = np.stack([np.pad(p, ((0, 0), (0, longest - p.shape[1]), (0, 0)), mode="edge")
                       for p in paths])
    return padded, np.array([p.shape[1] for p in paths])


def explore_by_containment(
    robot: Robot, hand_pose: np.ndarray, wanted: np.ndarray, closings: tuple[str, ...]
) -> Grasps:
    """Grasp at every wanted pose (world, probe, 7) along every named closing path."""
    commands, count = padded_commands(closings)
    return robot.grasp(hand_pose, wanted, commands, count)


def evidence_from_grasps(grasps: Grasps, link_radius_m: float) -> Evidence:
    """Contacts off the table, and free balls along the believed links of every closed finger."""
    status, estimate = grasps.closing.status, grasps.estimate
    worlds = len(status)
    points = estimate.point_m.reshape(worlds, -1, 3)
    felt = (status == ProbeStatus.CONTACT).reshape(worlds, -1)
    mask = felt & np.isfinite(points).all(-1) & (np.nan_to_num(points[..., 2]) > TABLE_MARGIN_M)
    joints = estimate.link_points_m
    balls = np.concatenate([0.5 * (joints[..., :-1, :] + joints[..., 1:, :]), joints[..., 1:, :]],
                           axis=-2)
    closed = np.isin(status, (ProbeStatus.CONTACT, ProbeStatus.NO_CONTACT))
    free_mask = np.broadcast_to(closed[..., None], balls.shape[:-1]).reshape(worlds, -1)
    free_mask = free_mask & np.isfinite(balls).all(-1).reshape(worlds, -1)
    return Evidence(
        points_m=np.where(mask[..., None], points, 0.0),
        mask=mask,
        covariance_m2=np.where(mask[..., None, None],
                               estimate.covariance_m2.reshape(worlds, -1, 3, 3), np.eye(3)),
        normals=np.where(mask[..., None], estimate.normal.reshape(worlds, -1, 3), np.nan),
        free_m=np.nan_to_num(balls.reshape(worlds, -1, 3)),
        free_radius_m=link_radius_m - FREE_SLACK_M,
        free_mask=free_mask,
    )
