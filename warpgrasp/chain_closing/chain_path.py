"""Closing paths of chains as kernels see them: commands, and how far each capsule can have come."""

import numpy as np

from warpgrasp.chain.chain_hand import ChainHand, chain_rows, joint_reaches, weight_moments
from warpgrasp.chain.chain_kernel import CAPSULES, JOINTS
from warpgrasp.mechanism.calibration import Calibration
from warpgrasp.parameters import ContactTable, HandTable

_MOST_SAG = 0.5
"""Radians that weight may turn joints by for a radian of the others; more is refused."""


def padded(q: np.ndarray) -> np.ndarray:
    """Angles of drives (..., width) with zeros up to six, contiguous."""
    return np.ascontiguousarray(np.pad(q, [*[(0, 0)] * (q.ndim - 1), (0, JOINTS - q.shape[-1])]),
                                np.float64)


def come_bounds(
    hand: ChainHand, table: HandTable, contact: ContactTable, errors: Calibration,
    commands_rad: np.ndarray
) -> np.ndarray:
    """How far any place of each capsule can have moved since the first command [m], (grasp, finger,
    `CAPSULES`, step), of commands (grasp, finger, step, width), whatever the world's errors.

    A drive's turn moves a place by no more than its longest distance from the joint. What a link's
    weight turns joints by changes with the turns of all joints, by no more than the torque it can
    make over the servo's stiffness each radian. Raises ValueError for servos that yield so much
    that no bound follows.
    """
    chains, joints, capsules = (rows.copy() for rows in chain_rows(hand, table, contact, errors))
    grasps, fingers, steps, width = commands_rad.shape
    found = np.zeros((grasps, fingers, CAPSULES, steps))
    for f in range(fingers):
        count = int(chains[0, f]["joint_count"])
        arm, row = joints[:, f]["arm"].max(0), joints[0, f]
        far = capsules[:, f]["far"].max(0)
        between = joint_reaches(arm)
        turns = np.zeros((grasps, steps - 1, width))
        turns[:] = np.abs(np.diff(commands_rad[:, f], axis=1))
        if contact.weight:
            moment = weight_moments(joints[:, f]).max(0)
            yields = np.zeros(width)
            for j in range(count):
                d = int(row["drive"][j])
                yields[d] += abs(row["factor"][j]) * moment[j] / chains[0, f]["stiffness"][d]
            if yields.sum() > _MOST_SAG:
                raise ValueError(f"finger {hand.model.fingers[f].name} sags by its own weight; its "
                                 "servos should be stiffer or its links lighter")
            turns = turns + turns.sum(-1, keepdims=True) * yields / (1.0 - yields.sum())
        for c in range(int(chains[0, f]["capsule_count"])):
            bearing = int(capsules[0, f]["joint"][c])
            lever = np.zeros(width)
            for i in range(bearing + 1):
                lever[int(row["drive"][i])] += abs(row["factor"][i]) * (between[i, bearing]
                                                                        + far[c])
            found[:, f, c, 1:] = (turns @ lever).cumsum(-1)
    return found
