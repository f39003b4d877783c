"""What has been felt, gathered for fitting: contacts and free space."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from strategies.contacts.felt import Felt
from strategies.contacts.finger_touch import TouchedLinks, links_of_touches
from strategies.procedures.touches import TABLE_MARGIN_M, MissedTips, TouchTable
from warpgrasp.parameters import HandTable
from warpgrasp.probe_status import FELT_TO_THE_END, ProbeStatus
from warpgrasp.robot import Grasps

SURE_LINK = 0.9
"""Probability of its likeliest link from which on a contact counts as of that link [est]."""
CONTRADICTED_FROM = 10.0
"""Chi-square of torques and body, of about three degrees of freedom, from which on they contradict
one another [est]."""
PLACED = ("points_m", "covariance_m2", "normals", "contradiction")
"""What of evidence depends on the body that its contacts are placed on."""
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
    contradiction: np.ndarray
    """Chi-square of torques and body at the contact's likeliest place, (..., point): infinite where
    which link touched is in doubt; 0 for pads and before a body is known."""

    @property
    def felt(self) -> Felt:
        """The contacts as uncertainty takes them."""
        return Felt(self.points_m, self.mask, self.covariance_m2,
                    self.mask & (self.contradiction > CONTRADICTED_FROM), self.by_pad)


def evidence_from_grasps(grasps: Grasps, link_radius_m: float) -> Evidence:
    """Contacts off the table, and free balls along the believed links of every closed finger."""
    status, estimate = grasps.closing.status, grasps.estimate
    worlds = len(status)
    points = estimate.point_m.reshape(worlds, -1, 3)
    felt = (status == ProbeStatus.CONTACT).reshape(worlds, -1)
    mask = felt & np.isfinite(points).all(-1) & (np.nan_to_num(points[..., 2]) > TABLE_MARGIN_M)
    balls = estimate.inside_m()
    closed = np.isin(status, FELT_TO_THE_END)
    free_mask = np.broadcast_to(closed[..., None], balls.shape[:-1]).reshape(worlds, -1)
    free_mask = free_mask & np.isfinite(balls).all(-1).reshape(worlds, -1)
    # Sure, if the place that torques explain best is on the link that most places speak for.
    sure = ((estimate.link_weight.max(axis=-1) >= SURE_LINK)
            & (estimate.link == estimate.link_weight.argmax(axis=-1)))
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
        contradiction=np.where(sure, 0.0, np.inf).reshape(worlds, -1),
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


def evidence_from_touches(
    table: TouchTable, missed: MissedTips | None, worlds: int, slots: int, like: Evidence,
    hand: HandTable,
) -> tuple[Evidence, TouchedLinks]:
    """Touches of pads as evidence with `slots` points a world, thinned evenly where more were made.

    Beside it how the robot stood. Normals are those of the pads. Where a fingertip touched nothing
    its ball is free, with the radius of those in `like`.
    """
    rows, at = slots_of_touches(table, worlds, slots)
    points = np.zeros((worlds, slots, 3))
    normals = np.full((worlds, slots, 3), np.nan)
    covariance = np.tile(np.eye(3), (worlds, slots, 1, 1))
    mask = np.zeros((worlds, slots), bool)
    n = table.normal[rows]
    along = n[:, :, None] * n[:, None, :]
    points[at], normals[at], mask[at] = table.point_m[rows], n, True
    covariance[at] = (NORMAL_SIGMA_M**2 * along + TANGENT_SIGMA_M**2 * (np.eye(3) - along))
    room = 0 if missed is None else FREE_TIPS
    free, free_mask = np.zeros((worlds, room, 3)), np.zeros((worlds, room), bool)
    if missed is not None:
        which, place = _slots(missed.world, worlds, room)
        free[place], free_mask[place] = missed.tip_m[which], True
    links = links_of_touches(table, rows, at, worlds, slots, hand)
    return Evidence(points, mask, covariance, normals, free, like.free_radius_m, free_mask,
                    mask.copy(), np.zeros(mask.shape)), links


def slots_of_touches(table: TouchTable, worlds: int, slots: int
                     ) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Which rows of the table are kept as evidence, (kept,), and at which (world, slot) each."""
    keep = np.isfinite(table.point_m).all(1) & np.isfinite(table.normal).all(1)
    keep &= table.above_table()
    chosen, at = _slots(table.world[keep], worlds, slots)
    return np.flatnonzero(keep)[chosen], at


def _slots(world: np.ndarray, worlds: int, slots: int
           ) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Which rows (of `world`, each) are kept, evenly over all of its world, and their places in
    arrays (world, slot)."""
    order = np.argsort(world, kind="stable")
    count = np.bincount(world, minlength=worlds)
    number = np.empty(len(world), int)
    number[order] = np.arange(len(world)) - np.repeat(count.cumsum() - count, count)
    share = slots / np.maximum(count, slots)[world]
    slot = np.floor(number * share).astype(int)
    # All slots by the last row: a product that rounds to less would leave one empty.
    last = number + 1 == count[world]
    chosen = np.where(last, np.minimum(count, slots)[world], np.floor((number + 1) * share)) > slot
    return chosen, (world[chosen], slot[chosen])


def no_evidence(worlds: int, free_radius_m: float) -> Evidence:
    """Nothing felt yet."""
    return Evidence(np.zeros((worlds, 0, 3)), np.zeros((worlds, 0), bool),
                    np.zeros((worlds, 0, 3, 3)), np.zeros((worlds, 0, 3)),
                    np.zeros((worlds, 0, 3)), free_radius_m, np.zeros((worlds, 0), bool),
                    np.zeros((worlds, 0), bool), np.zeros((worlds, 0)))


def joined_evidence(*parts: Evidence) -> Evidence:
    """The slots of all parts, in order."""
    values: dict[str, Any] = {
        f.name: parts[0].free_radius_m if f.name == "free_radius_m" else np.concatenate(
            [getattr(part, f.name) for part in parts], axis=1) for f in fields(Evidence)}
    return Evidence(**values)
