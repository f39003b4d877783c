"""All evidence of an episode in one: contacts of grasps and touches of pads, side by side.

Slots are of fixed number for each procedure, so that a world's arrays do not depend on the worlds
beside it.
"""

from dataclasses import fields
from typing import Any

import numpy as np

from strategies.evidence import TABLE_MARGIN_M, Evidence, TouchedLinks
from strategies.touches import MissedTips, TouchTable

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
                    mask.copy())


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
                    np.zeros((worlds, 0), bool))


def no_links(worlds: int, slots: int, radius_m: float) -> TouchedLinks:
    """For touches of pads: their place needs no link to be told."""
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
