"""Sensors of fingers without tendons on the host: the tables that kernels take.

A joint's torque is read at its motor, as a current or by a sensor of its own, with noise, in steps
of a converter, and with the friction of what lies between. The weight that the robot believes its
links to have is taken off. The largest reading of a finger guards its closing. A switch at the tip
closes by the force on the last link; all other links may press unnoticed.
"""

from functools import lru_cache

import numpy as np
import warp as wp

from warpgrasp.chain.chain_hand import ChainHand, chain_rows, joint_drive, weight_moments
from warpgrasp.chain.torque_sensor_kernel import SWITCHES, TORQUES, TorqueSensor
from warpgrasp.core.struct_array import record_type
from warpgrasp.mechanism.calibration import Calibration
from warpgrasp.parameters import ContactTable, HandTable, SensorTable

KINDS = {"tendons": TORQUES, "joint_torques": TORQUES, "tip_switches": SWITCHES, "nothing": 0}
"""By what a hand senses (`hand_model.SENSES`); tendons of a chain are read as the torques that they
carry."""
_NEVER = 6.0
"""Deviations of a reading; chances below 1e-9 are taken for none."""
_ROUNDING = 1e-9


Range = tuple[tuple[tuple[float, float], ...], ...]
"""The least and the largest command of each finger's drives [rad]."""


def command_range(commands_rad: np.ndarray) -> Range:
    """Of commands (grasp, finger, step, width)."""
    low, high = commands_rad.min((0, 2)), commands_rad.max((0, 2))
    return tuple(tuple((float(a), float(b)) for a, b in zip(*own, strict=True))
                 for own in zip(low, high, strict=True))


@lru_cache(maxsize=8)
def true_sensors(
    hand: ChainHand, table: HandTable, sensors: SensorTable, contact: ContactTable,
    errors: Calibration, device: str, commanded: Range = ()
) -> wp.array:
    """The true sensors as kernels take them, (world or 1, finger); without errors those believed.

    `commanded` says where fingers are led, which tells whether they may stop touching nothing.
    """
    rows = np.zeros((errors.worlds, hand.fingers), record_type(TorqueSensor))
    rows["kind"] = KINDS[hand.model.senses]
    rows["gain"] = 1.0
    width = min(rows["gain"].shape[-1], errors.moment_arm_share.shape[-1])
    rows["gain"][..., :width] += errors.moment_arm_share[..., :width]
    rows["friction"] = sensors.torque_friction_Nm
    rows["threshold"], rows["noise"] = sensors.torque_threshold_Nm, sensors.torque_noise_Nm
    rows["step"], rows["readings"] = sensors.torque_step_Nm, sensors.tension_readings
    rows["switch_force"], rows["joint_noise"] = sensors.switch_force_N, sensors.joint_noise_rad
    unknown = _unknown_torque(hand, table, contact, errors, commanded)
    rows["suspect"] = np.where(rows["kind"] == TORQUES, _suspect_draw(
        sensors, unknown, unknown * rows["gain"].max(-1)), 0.0)
    return wp.array(rows, dtype=TorqueSensor, device=device)


def _suspect_draw(sensors: SensorTable, unknown: np.ndarray, read: np.ndarray) -> np.ndarray:
    """`TorqueSensor.suspect` of fingers that may bear `unknown` and read as much as `read` [N m]
    touching nothing.

    A normal number of Box and Muller is at most sqrt(-2 log u), u its first uniform draw.
    """
    noise = sensors.torque_noise_Nm
    margin = sensors.torque_threshold_Nm - sensors.torque_step_Nm - sensors.torque_friction_Nm
    if noise == 0.0:
        return np.where(margin <= unknown, np.inf, 0.0)
    deviations = np.maximum(margin - read, 0.0) / noise
    return np.where(margin - unknown <= _NEVER * noise,
                    np.exp(-0.5 * deviations**2) * (1.0 + _ROUNDING), 0.0)


def _unknown_torque(
    hand: ChainHand, table: HandTable, contact: ContactTable, errors: Calibration,
    commanded: Range
) -> np.ndarray:
    """The most that a free finger may read beside noise and friction [N m], (world or 1, finger):
    what of its weight the robot does not take off, and as much of what a stop bears, where a joint
    may lie on one.

    Offsets of joints turn links, and with them what they weigh about a joint, by no more than
    their sum.
    """
    chains, joints, _ = chain_rows(hand, table, contact, errors)
    moment = np.where(chains["weighs"][..., None] == 1, weight_moments(joints), 0.0)
    share = np.abs(errors.joint_offset_rad).sum(-1) + np.abs(errors.link_length_share).max(-1)
    unknown = np.zeros(chains.shape)
    for f, drives in enumerate(hand.drives):
        turned = np.zeros((len(chains), len(drives)))
        for j in range(len(hand.model.fingers[f].joints)):
            d, factor, _ = joint_drive(hand, f, j)
            turned[:, d] += np.abs(factor) * moment[:, f, j]
        light = turned * share[:, f, None]
        if commanded:
            low, high = np.array(commanded[f])[:len(drives)].T
            own = [hand.model.fingers[f].joints[j] for j in drives]
            sag = turned / np.array([joint.stiffness_Nm_rad for joint in own])
            beside = ((high > np.array([joint.high_rad for joint in own]) - sag)
                      | (low < np.array([joint.low_rad for joint in own]) + sag))
            light = light * (1.0 + beside * (chains["stop"][:, f, None] > 0.0))
        unknown[:, f] = light.max(-1)
    return unknown
