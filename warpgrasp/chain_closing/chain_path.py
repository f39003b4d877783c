"""Closing paths of chains as kernels see them: commands, and how far each capsule can have come."""

import numpy as np

from warpgrasp.chain.chain_hand import ChainHand, chain_rows, joint_reaches, weight_moments
from warpgrasp.chain.chain_kernel import CAPSULES, JOINTS
from warpgrasp.hands.hand_checks import MOST_MEETING
from warpgrasp.mechanism.calibration import Calibration, no_errors
from warpgrasp.parameters import ContactTable, HandTable

_MOST_SAG = 0.5
"""Radians that weight may turn joints by for a radian of the others; more is refused."""


def no_chain_errors(hand: ChainHand) -> Calibration:
    """The hand that is believed."""
    return no_errors(hand.fingers, JOINTS, JOINTS)


def closing_misfit(hand: ChainHand, table: HandTable, contact: ContactTable) -> str:
    """Why a hand, as it is believed, cannot be closed; empty where it can."""
    if contact.self_contact and hand.fingers > MOST_MEETING:
        return (f"{hand.model.name} has {hand.fingers} fingers; {MOST_MEETING} at most can meet: "
                "[contact] self_contact should be false")
    chains, joints, _ = chain_rows(hand, table, contact, no_chain_errors(hand))
    for f in range(hand.fingers):
        if contact.weight and _weight_yields(chains[0, f], joints[:, f]).sum() > _MOST_SAG:
            return _sags(hand, f)
    return ""


def _sags(hand: ChainHand, finger: int) -> str:
    return (f"finger {hand.model.fingers[finger].name} sags by its own weight; its servos should "
            "be stiffer (stiffness_Nm_rad in the hand's file) or its links lighter ([hand] "
            "link_density_kg_m3)")


def _weight_yields(chain: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """How far a finger's weight turns each drive while its joints turn by a radian, at most
    [rad/rad], of its rows of Chain and ChainJoint (world or 1, joint)."""
    moment, row = weight_moments(joints).max(0), joints[0]
    found = np.zeros(JOINTS)
    for j in range(int(chain["joint_count"])):
        d = int(row["drive"][j])
        found[d] += abs(row["factor"][j]) * moment[j] / chain["stiffness"][d]
    return found


def come_bounds(
    hand: ChainHand, table: HandTable, contact: ContactTable, errors: Calibration,
    commands_rad: np.ndarray
) -> np.ndarray:
    """How far any place of each capsule can have moved since the first command [m], (grasp, finger,
    `CAPSULES`, step), of commands (grasp, finger, step, width), whatever the world's errors.

    A drive's turn moves a place by no more than its longest distance from the joint. What a link's
    weight turns joints by changes with the turns of all joints, by no more than the torque it can
    make over the servo's stiffness each radian. Raises ValueError for what `closing_misfit` says,
    and for servos that yield so much in one of the worlds.
    """
    if wrong := closing_misfit(hand, table, contact):
        raise ValueError(wrong)
    chains, joints, capsules = (rows.copy() for rows in chain_rows(hand, table, contact, errors))
    grasps, fingers, steps, width = commands_rad.shape
    found = np.zeros((grasps, fingers, CAPSULES, steps))
    for f in range(fingers):
        arm, row = joints[:, f]["arm"].max(0), joints[0, f]
        far = capsules[:, f]["far"].max(0)
        between = joint_reaches(arm)
        turns = np.zeros((grasps, steps - 1, width))
        turns[:] = np.abs(np.diff(commands_rad[:, f], axis=1))
        if contact.weight:
            yields = _weight_yields(chains[0, f], joints[:, f])[:width]
            if yields.sum() > _MOST_SAG:
                raise ValueError(_sags(hand, f))
            turns = turns + turns.sum(-1, keepdims=True) * yields / (1.0 - yields.sum())
        for c in range(int(chains[0, f]["capsule_count"])):
            bearing = int(capsules[0, f]["joint"][c])
            lever = np.zeros(width)
            for i in range(bearing + 1):
                lever[int(row["drive"][i])] += abs(row["factor"][i]) * (between[i, bearing]
                                                                        + far[c])
            found[:, f, c, 1:] = (turns @ lever).cumsum(-1)
    return found
