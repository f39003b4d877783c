"""What has been felt, gathered for fitting: contacts, the links they may be on, and free space."""

from dataclasses import dataclass

import numpy as np

from warpgrasp.robot import Grasps
from warpgrasp.status import ProbeStatus

TABLE_MARGIN_M = 0.006
"""Contacts believed lower than this are taken to be the table."""
FREE_SLACK_M = 0.002
"""Links reported free are thinned by this: their places are known no better."""


@dataclass(frozen=True)
class Evidence:
    """Contacts and free space, base frame, ready for a fit. Shapes start with (world,)."""

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
    by_pad: np.ndarray
    """Contacts felt by a pad, whose normal was measured, (..., point)."""


@dataclass(frozen=True)
class TouchedLinks:
    """For each contact, where on the axis of each link it would be. Shapes (world, point, link 3).

    A round link touches a body where its axis is nearest to it, one link radius away: the axis is
    known from the joint angles, so a place on it says more than a point on the skin.
    """

    centre_m: np.ndarray
    """Most likely place on the link's axis, (..., 3)."""
    direction: np.ndarray
    """Along the link, unit, (..., 3)."""
    weight: np.ndarray
    """Probability that it is this link."""
    variance_m2: np.ndarray
    """Of the place along the axis."""
    radius_m: float
    linked: np.ndarray
    """Which contacts were felt by tendons, bool (...); pads know their place already."""


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
        by_pad=np.zeros_like(mask),
    )


def touched_links(grasps: Grasps, link_radius_m: float) -> TouchedLinks:
    """The links each contact may be on, in the order of `evidence_from_grasps`' points."""
    estimate = grasps.estimate
    worlds = len(grasps.closing.status)
    joints = np.nan_to_num(estimate.link_points_m)
    along = joints[..., 1:, :] - joints[..., :-1, :]
    length = np.linalg.norm(along, axis=-1, keepdims=True)
    direction = along / np.maximum(length, 1e-9)
    centre = joints[..., :-1, :] + direction * estimate.along_m[..., None]
    return TouchedLinks(
        centre_m=centre.reshape(worlds, -1, 3, 3),
        direction=direction.reshape(worlds, -1, 3, 3),
        weight=estimate.link_weight.reshape(worlds, -1, 3),
        variance_m2=estimate.along_variance_m2.reshape(worlds, -1, 3),
        radius_m=link_radius_m,
        linked=np.ones((worlds, estimate.along_m[0, ..., 0].size), bool),
    )
