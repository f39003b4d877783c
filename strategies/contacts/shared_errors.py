"""Errors that the contacts of an episode share: how each error of calibration moves contacts.

A robot's errors are drawn once an episode, so that what they do to contacts does not average out.
To first order each moves a contact along the believed body's normal by a known amount: a zero of a
joint sensor turns the finger about that joint, a link or a finger's base shifts what follows it,
the mount shifts and turns the whole hand. The robot knows the deviations of these errors, not what
was drawn. Errors of the arm shift the hand nearly alike at all poses about an object.
"""

import numpy as np

from fit.rotation import matrix_of_quaternion
from strategies.contacts.chain_errors import chain_shifts
from strategies.contacts.finger_touch import TouchedLinks
from warpgrasp.chain.chain_hand import chain_of_table
from warpgrasp.mechanism.calibration import arm_variance
from warpgrasp.mechanism.utah_mit_hand import FINGER_COUNT
from warpgrasp.parameters import ArmTable, ErrorTable

_JOINTS, _LENGTHS, _AXES = 4, 2, 3
EACH_FINGER = _JOINTS + _LENGTHS + _AXES
"""Errors of a finger: joint zeros, lengths of the links before the last, place of its base."""
COUNT = FINGER_COUNT * EACH_FINGER + 3 * _AXES
"""Of all fingers of the Utah-MIT hand, of the mount's place and turn, and of the arm."""


def shared_shifts(
    links: TouchedLinks, points_m: np.ndarray, normals: np.ndarray, errors: ErrorTable,
    arm: ArmTable,
) -> np.ndarray:
    """By how much one standard deviation of each error moves contacts along `normals` [m], (world,
    point, error): `COUNT` of the Utah-MIT hand.

    `points_m` and `normals` (world, point, 3), base frame. Rows that hold no contact are finite.
    """
    hand = links.hand
    turn = matrix_of_quaternion(_unit(links.hand_pose[..., 3:]))
    place = links.hand_pose[..., :3]
    chain = chain_of_table(hand)
    if chain is None:
        fingers = _utah_mit_shifts(links, points_m, normals, errors, turn)
    else:
        fingers = chain_shifts(chain, links, points_m, normals, errors, turn)
    of_hand = np.einsum("wpji,wpj->wpi", turn, normals)
    arm_of_hand = np.einsum("wpji,wpj->wpi", turn, np.cross(
        points_m - place + turn[..., 2] * hand.mount_length_m, normals))
    return np.concatenate([
        fingers, of_hand * errors.mount_m,
        arm_of_hand * errors.mount_rad, normals * np.sqrt(arm_variance(errors, arm))], axis=-1)


def shared_vectors(
    links: TouchedLinks, points_m: np.ndarray, errors: ErrorTable, arm: ArmTable
) -> np.ndarray:
    """By how much one standard deviation of each error moves contacts [m], (world, point, 3,
    error)."""
    return np.stack([
        shared_shifts(links, points_m, np.broadcast_to(axis, points_m.shape), errors, arm)
        for axis in np.eye(_AXES)], axis=-2)


def _utah_mit_shifts(
    links: TouchedLinks, points_m: np.ndarray, normals: np.ndarray, errors: ErrorTable,
    turn: np.ndarray,
) -> np.ndarray:
    """Of the errors of the Utah-MIT hand's fingers, (world, point, finger x error); `turn` are the
    hand's axes."""
    hand, q = links.hand, links.q_rad
    place = links.hand_pose[..., :3]
    side_sign = np.where(links.finger == FINGER_COUNT - 1, -1.0, 1.0)[..., None]
    x, y, z = turn[..., 0] * side_sign, turn[..., 1] * side_sign, turn[..., 2]
    across = np.where(links.finger == FINGER_COUNT - 1, 0.0, links.finger - 1.0)[..., None]
    base = (place - 0.5 * hand.palm_gap_m * x
            + hand.finger_spacing_m * across * turn[..., 1])
    sine, cosine = np.sin(q[..., :1]), np.cos(q[..., :1])
    out, side = z * cosine + y * sine, y * cosine - z * sine
    bend = np.cumsum(q[..., 1:], axis=-1)[..., None]
    along = x[..., None, :] * np.sin(bend) + out[..., None, :] * np.cos(bend)
    joint = base + out * hand.abduction_offset_m
    joints = [base, joint]
    for link in range(2):
        joint = joint + along[..., link, :] * hand.link_length_m[link]
        joints.append(joint)
    shifts = np.zeros((*links.finger.shape, EACH_FINGER, 3))
    for j, (axis, at) in enumerate(zip((-x, side, side, side), joints, strict=True)):
        moves = (links.link >= j - 1)[..., None]
        shifts[..., j, :] = moves * np.cross(axis, points_m - at) * errors.joint_offset_rad
    for link in range(_LENGTHS):
        beyond = (links.link > link)[..., None]
        shifts[..., _JOINTS + link, :] = (beyond * along[..., link, :] * hand.link_length_m[link]
                                          * errors.link_length_share)
    shifts[..., _JOINTS + _LENGTHS:, :] = np.swapaxes(turn, -1, -2) * errors.finger_base_m
    own = np.einsum("wpki,wpi->wpk", shifts, normals)
    fingers = (links.finger[..., None] == np.arange(FINGER_COUNT))[..., None] * own[..., None, :]
    return fingers.reshape(*own.shape[:2], -1)


def _unit(quaternion: np.ndarray) -> np.ndarray:
    """Turns; none where a slot holds no pose."""
    there = np.linalg.norm(quaternion, axis=-1, keepdims=True) > 0.5
    return np.where(there, quaternion, [0.0, 0.0, 0.0, 1.0])
