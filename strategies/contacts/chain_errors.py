"""Errors of calibration that the contacts of a hand of chains share, as `shared_errors` has them.

Of each finger: zeros of its drives, lengths of its links (which stretch all that stands in their
frames), and the place of its base.
"""

import numpy as np

from strategies.contacts.finger_touch import TouchedLinks
from warpgrasp.chain.chain_hand import ChainHand, joint_drive, link_frames_of
from warpgrasp.parameters import ErrorTable

_AXES = 3


def chain_shifts(
    hand: ChainHand, links: TouchedLinks, points_m: np.ndarray, normals: np.ndarray,
    errors: ErrorTable, turn: np.ndarray,
) -> np.ndarray:
    """By how much one standard deviation of each error of the fingers moves contacts along
    `normals` [m], (world, point, error). `turn` (world, point, 3, 3) are the hand's axes."""
    each = hand.width + hand.links + _AXES
    found = np.zeros((*links.finger.shape, hand.fingers, each))
    place = links.hand_pose[..., :3]
    for f in range(hand.fingers):
        at = links.finger == f
        if not at.any():
            continue
        frames = link_frames_of(hand, f, links.q_rad[at])
        to_base = turn[at]
        axis = np.array([joint.axis for joint in hand.model.fingers[f].joints])
        axes = np.einsum("nij,nkjl,kl->nki", to_base, frames[..., :3, :3], axis)
        joints = np.einsum("nij,nkj->nki", to_base, frames[..., :3, 3]) + place[at][:, None]
        x, link = points_m[at], links.link[at]
        shifts = np.zeros((len(x), each, 3))
        for j in range(joints.shape[1]):
            drive, factor, _ = joint_drive(hand, f, j)
            moves = (link >= j)[:, None]
            shifts[:, drive] += moves * factor * errors.joint_offset_rad * np.cross(
                axes[:, j], x - joints[:, j])
            ends = x if j + 1 == joints.shape[1] else np.where(
                (link > j)[:, None], joints[:, j + 1], x)
            shifts[:, hand.width + j] = moves * errors.link_length_share * (ends - joints[:, j])
        shifts[:, hand.width + hand.links:] = np.swapaxes(to_base, -1, -2) * errors.finger_base_m
        found[at, f] = np.einsum("nki,ni->nk", shifts, normals[at])
    return found.reshape(*links.finger.shape, -1)
