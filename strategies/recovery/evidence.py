"""What has been felt, gathered for fitting: contacts, the links they may be on, and free space."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from strategies.procedures.touches import MissedTips, TouchTable
from warpgrasp.closing.contact_estimate import ContactEstimate
from warpgrasp.probe_status import FELT_TO_THE_END, ProbeStatus
from warpgrasp.robot import Grasps

TABLE_MARGIN_M = 0.006
"""Contacts believed lower than this are taken to be the table."""
SURE_LINK = 0.9
"""Probability of its likeliest link from which on a contact counts as of that link [est]."""
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
    felt_normals: np.ndarray
    """As torques or pads tell, (..., point, 3), also where a fit has placed the contact; NaN where
    torques leave in doubt which link touched."""


@dataclass(frozen=True)
class TouchedLinks:
    """For each contact, where on the axis of each link it would be. Shapes (world, point, link 3).

    A round link touches a body where its axis is nearest to it, one link radius away: the axis is
    known from the joint angles, so a place on it is more certain than a point on the skin.
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
    closed = np.isin(status, FELT_TO_THE_END)
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
        felt_normals=_sure_normals(estimate).reshape(worlds, -1, 3),
    )


def _sure_normals(estimate: ContactEstimate) -> np.ndarray:
    sure = estimate.link_weight.max(axis=-1, keepdims=True) >= SURE_LINK
    return np.where(sure, estimate.normal, np.nan)


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


FACE_TOUCHES = 48
"""Touches of one face kept for a fit, evenly over all that were made."""
CONTOUR_TOUCHES = 96
FREE_TIPS = 16
"""Places of a procedure kept where a fingertip touched nothing, likewise."""
NORMAL_SIGMA_M = 0.0006
"""Spread of a pad's touch along the normal: skin, mount, repeatability [est]."""
TANGENT_SIGMA_M = 0.0015
"""Across it: where on the pad [est]."""


def evidence_from_touches(table: TouchTable, missed: MissedTips | None, worlds: int, slots: int,
                          like: Evidence) -> Evidence:
    """Touches of pads as evidence with `slots` points a world, thinned evenly where more were made.

    Normals are those of the pads. Where a fingertip touched nothing its ball is free, with the
    radius of those in `like`.
    """
    keep = np.isfinite(table.point_m).all(1) & np.isfinite(table.normal).all(1)
    keep &= np.nan_to_num(table.point_m[:, 2]) > TABLE_MARGIN_M
    chosen, at = _slots(table.world[keep], worlds, slots)
    points = np.zeros((worlds, slots, 3))
    normals = np.full((worlds, slots, 3), np.nan)
    covariance = np.tile(np.eye(3), (worlds, slots, 1, 1))
    mask = np.zeros((worlds, slots), bool)
    n = table.normal[keep][chosen]
    along = n[:, :, None] * n[:, None, :]
    points[at], normals[at], mask[at] = table.point_m[keep][chosen], n, True
    covariance[at] = (NORMAL_SIGMA_M**2 * along + TANGENT_SIGMA_M**2 * (np.eye(3) - along))
    room = 0 if missed is None else FREE_TIPS
    free, free_mask = np.zeros((worlds, room, 3)), np.zeros((worlds, room), bool)
    if missed is not None:
        chosen, at = _slots(missed.world, worlds, room)
        free[at], free_mask[at] = missed.tip_m[chosen], True
    return Evidence(points, mask, covariance, normals, free, like.free_radius_m, free_mask,
                    mask.copy(), normals.copy())


def _slots(world: np.ndarray, worlds: int, slots: int) -> tuple[np.ndarray, tuple]:
    """Which rows (of `world`, each) are kept, evenly over all of its world, and their places in
    arrays (world, slot)."""
    order = np.argsort(world, kind="stable")
    count = np.bincount(world, minlength=worlds)
    number = np.empty(len(world), int)
    number[order] = np.arange(len(world)) - np.repeat(count.cumsum() - count, count)
    share = slots / np.maximum(count, slots)[world]
    slot = np.floor(number * share).astype(int)
    chosen = np.floor((number + 1) * share).astype(int) > slot
    return chosen, (world[chosen], slot[chosen])


def no_evidence(worlds: int, free_radius_m: float) -> Evidence:
    """Nothing felt yet."""
    return Evidence(np.zeros((worlds, 0, 3)), np.zeros((worlds, 0), bool),
                    np.zeros((worlds, 0, 3, 3)), np.zeros((worlds, 0, 3)),
                    np.zeros((worlds, 0, 3)), free_radius_m, np.zeros((worlds, 0), bool),
                    np.zeros((worlds, 0), bool), np.zeros((worlds, 0, 3)))


def no_links(worlds: int, slots: int, radius_m: float) -> TouchedLinks:
    """Of touches of pads, whose place does not depend on which link touched."""
    wide = np.zeros((worlds, slots, 3, 3))
    narrow = np.ones((worlds, slots, 3))
    return TouchedLinks(wide, wide, narrow, narrow, radius_m, np.zeros((worlds, slots), bool))


def joined_evidence(*parts: Evidence) -> Evidence:
    """The slots of all parts, in order."""
    values: dict[str, Any] = {
        f.name: parts[0].free_radius_m if f.name == "free_radius_m" else np.concatenate(
            [getattr(part, f.name) for part in parts], axis=1) for f in fields(Evidence)}
    return Evidence(**values)


def joined_links(*parts: TouchedLinks) -> TouchedLinks:
    """The slots of all parts, in order."""
    values: dict[str, Any] = {
        f.name: parts[0].radius_m if f.name == "radius_m" else np.concatenate(
            [getattr(part, f.name) for part in parts], axis=1) for f in fields(TouchedLinks)}
    return TouchedLinks(**values)
