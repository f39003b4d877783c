"""How near pairs of capsules of a hand of chains can come while nothing holds its fingers.

On the way that the commands lead the hand that is believed, weightless, with its fingers at any two
steps; from there the robot that is may be off by its errors, by what its links weigh, and by what
its stops keep it from.
"""

from typing import Any

import numpy as np
import warp as wp

from warpgrasp.chain.chain_hand import (
    ChainHand,
    capsule_ends,
    chain_rows,
    joint_drive,
    joint_reaches,
    weight_moments,
)
from warpgrasp.chain.chain_kernel import CAPSULES
from warpgrasp.chain_closing.chain_closing_kernels import path_gap_kernel
from warpgrasp.core.dtypes import real, vec3
from warpgrasp.core.kernel_launch import launch
from warpgrasp.mechanism.calibration import Calibration
from warpgrasp.parameters import ContactTable, HandTable


def pair_slack(
    hand: ChainHand, table: HandTable, contact: ContactTable, errors: Calibration,
    commands_rad: np.ndarray, gap: np.ndarray, pairs: wp.array, device: str
) -> tuple[wp.array, wp.array]:
    """The pairs in the order of their slack, and that slack [m], (world or 1, grasp, pair): see
    `ChainBuild`. `gap` is as `path_gaps`, of commands (grasp, finger, step, width)."""
    off = farthest_off(hand, table, contact, errors, commands_rad)
    rows: Any = pairs.numpy()
    slack = gap[None] - off[:, :, rows["one"], rows["capsule"]]
    fingers = rows["two"] >= 0
    slack[..., fingers] -= off[:, :, rows["two"][fingers], rows["other"][fingers]]
    order = np.argsort(slack, -1, kind="stable")
    return (wp.array(order, dtype=int, device=device),
            wp.array(np.take_along_axis(slack, order, -1), dtype=real, device=device))


def path_gaps(
    hand: ChainHand, commands_rad: np.ndarray, come: wp.array, palm: wp.array, pairs: wp.array,
    device: str
) -> np.ndarray:
    """The least distance of the skins of each pair on the way of the hand that is believed [m],
    (grasp, pair). `come` is as `come_bounds`."""
    grasps, _, steps, _ = commands_rad.shape
    ends = np.zeros((grasps, hand.fingers, CAPSULES, steps, 2, 3))
    for f, own in enumerate(hand.capsules):
        if own:
            ends[:, f, :len(own)] = np.moveaxis(capsule_ends(hand, f, commands_rad[:, f]), 2, 1)
    gap = wp.empty((grasps, pairs.shape[0]), dtype=real, device=device)
    launch(path_gap_kernel, {"grasp": grasps, "pair": pairs.shape[0]}, {
        "palm": "bar 2", "pairs": "pair", "ends": "grasp row step 2",
        "come": "grasp finger capsule step", "gap": "grasp pair"}, {
            "palm": palm, "pairs": pairs, "come": come, "gap": gap, "ends": wp.array(
                ends.reshape(grasps, -1, steps, 2, 3), dtype=vec3, device=device)}, device=device)
    return gap.numpy()


def farthest_off(
    hand: ChainHand, table: HandTable, contact: ContactTable, errors: Calibration,
    commands_rad: np.ndarray
) -> np.ndarray:
    """How far any place of each capsule may be from where the hand that is believed would have it,
    weightless and without stops [m], (world or 1, grasp, finger, `CAPSULES`).

    A turn of a joint moves a place by no more than its longest distance from there.
    """
    chains, joints, capsules = chain_rows(hand, table, contact, errors)
    reach = joint_reaches(joints["arm"])
    moment = np.where(chains["weighs"][..., None] == 1, weight_moments(joints), 0.0)
    stretch = np.abs(errors.link_length_share).max(-1)
    off = np.zeros((len(chains), len(commands_rad), hand.fingers, CAPSULES))
    for f, finger in enumerate(hand.model.fingers):
        drives = hand.drives[f]
        factors = [joint_drive(hand, f, j) for j in range(len(finger.joints))]
        weighed = np.zeros((len(chains), len(drives)))
        for j, (d, factor, _) in enumerate(factors):
            weighed[:, d] += abs(factor) * moment[:, f, j]
        turned = np.abs(errors.joint_offset_rad[:, f, :len(drives)]) + weighed / np.array(
            [finger.joints[j].stiffness_Nm_rad for j in drives])
        led = commands_rad[:, f, :, :len(drives)]
        limits = np.array([(finger.joints[j].low_rad, finger.joints[j].high_rad) for j in drives])
        past = np.abs(led - np.clip(led, *limits.T)).max(1) * (table.joint_stop_Nm_rad > 0.0)
        for c, bearing in enumerate(hand.capsule_joint[f]):
            far = capsules[:, f, c]["far"]
            way = stretch[:, f] * (reach[:, f, 0, bearing] + far)
            off[:, :, f, c] = (way + np.linalg.norm(errors.finger_base_m[:, f], axis=-1))[:, None]
            for j in range(bearing + 1):
                d, factor, _ = factors[j]
                lever = abs(factor) * (reach[:, f, j, bearing] + far)
                off[:, :, f, c] += lever[:, None] * (turned[:, None, d] + past[None, :, d])
    return off
