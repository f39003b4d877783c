"""How the robot stood at each contact, and what its joints felt: where on which link it may be."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from strategies.poses.hand_outline import outline_of
from strategies.procedures.touches import TouchTable
from warpgrasp.parameters import ContactTable, HandTable
from warpgrasp.robot import Grasps

SHARED = ("hand",)
"""Fields that all worlds share."""


@dataclass(frozen=True)
class TouchedLinks:
    """Of each contact the finger, its joints and torques. Shapes start with (world, point)."""

    linked: np.ndarray
    """Which contacts were felt by tendons, bool (...); pads know their place already."""
    hand_pose: np.ndarray
    """Believed, [m] and quaternion xyzw, (..., 7)."""
    q_rad: np.ndarray
    """Joints of the finger as read, (..., joint)."""
    finger: np.ndarray
    """Its number; of the Utah-MIT hand 3 is the thumb, int (...)."""
    link: np.ndarray
    """Believed in touch: 0 proximal to 2 distal, of other hands its joint's number, int (...)."""
    torque_Nm: np.ndarray
    """By which the contact turns the joints, (..., joint)."""
    torque_sigma_Nm: np.ndarray
    """Its standard deviation, (..., joint)."""
    step_rad: np.ndarray
    """The last step of the finger's command, (..., joint); zeros where it is not known."""
    weight: np.ndarray
    """Probability of each link by torques alone, (..., link)."""
    friction: np.ndarray
    """Coefficient of the skin, (...)."""
    hand: HandTable
    """As the tables have it."""


def touched_links(grasps: Grasps, hand: HandTable, contact: ContactTable) -> TouchedLinks:
    """The links each contact may be on, in the order of `evidence_from_grasps`' points."""
    estimate, closing = grasps.estimate, grasps.closing
    shape = closing.status.shape
    worlds = len(closing.status)

    def flat(values: np.ndarray, *last: int) -> np.ndarray:
        return np.broadcast_to(values, (*shape, *last)).reshape(worlds, -1, *last)

    pose = grasps.moves.believed_pose[:, :, None, None]
    return TouchedLinks(
        linked=np.ones((worlds, closing.status[0].size), bool),
        hand_pose=np.where(np.isfinite(flat(pose, 7)), flat(pose, 7), 0.0),
        q_rad=np.nan_to_num(flat(closing.q_rad, closing.q_rad.shape[-1])),
        finger=flat(np.arange(shape[3])).copy(),
        link=np.maximum(flat(estimate.link), 0),
        torque_Nm=flat(estimate.torque_Nm, estimate.torque_Nm.shape[-1]),
        torque_sigma_Nm=flat(estimate.torque_sigma_Nm, estimate.torque_Nm.shape[-1]),
        step_rad=flat(estimate.step_rad, estimate.step_rad.shape[-1]),
        weight=flat(estimate.link_weight, estimate.link_weight.shape[-1]),
        friction=flat(np.array(contact.friction)).copy(), hand=hand)


def no_links(worlds: int, slots: int, hand: HandTable) -> TouchedLinks:
    """Of slots without a contact."""
    def zeros(*last: int, dtype: type = float) -> np.ndarray:
        return np.zeros((worlds, slots, *last), dtype)

    outline = outline_of(hand)
    joints, links = outline.drives, outline.links
    return TouchedLinks(zeros(dtype=bool), zeros(7), zeros(joints), zeros(dtype=int),
                        zeros(dtype=int), zeros(joints), zeros(joints) + 1.0, zeros(joints),
                        zeros(links), zeros(), hand)


def links_of_touches(table: TouchTable, rows: np.ndarray, at: tuple, worlds: int, slots: int,
                     hand: HandTable) -> TouchedLinks:
    """Of touches of pads, whose place does not depend on which link touched: `rows` of the table
    in the slots `at`."""
    links = no_links(worlds, slots, hand)
    for name in ("hand_pose", "q_rad", "finger", "link"):
        getattr(links, name)[at] = getattr(table, name)[rows]
    return links


def joined_links(*parts: TouchedLinks) -> TouchedLinks:
    """The slots of all parts, in order."""
    values: dict[str, Any] = {
        f.name: getattr(parts[0], f.name) if f.name in SHARED else np.concatenate(
            [getattr(part, f.name) for part in parts], axis=1) for f in fields(TouchedLinks)}
    return TouchedLinks(**values)
