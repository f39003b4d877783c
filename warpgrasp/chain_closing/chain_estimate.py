"""Where the robot concludes that a finger of a hand of chains touched, with a covariance.

As `closing.contact_estimate`: from the torques of the drives, or, where only a switch in the tip is
felt, and by the paper's `fingertip` estimate, anywhere on the last link.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpgrasp.chain.chain_hand import ChainHand, padded, true_chains
from warpgrasp.chain.chain_kernel import vec6
from warpgrasp.chain.torque_sensor import true_sensors
from warpgrasp.chain_closing.chain_closing import ChainClosing
from warpgrasp.chain_closing.chain_closing_kernels import chain_estimate_kernel
from warpgrasp.chain_closing.chain_estimate_kernel import balls_type
from warpgrasp.chain_closing.chain_path import no_chain_errors
from warpgrasp.closing.contact_estimate import ContactEstimate, last_steps
from warpgrasp.core.dtypes import mat33, vec3
from warpgrasp.core.kernel_launch import launch, poses_of
from warpgrasp.mechanism.calibration import place_variance
from warpgrasp.parameters import ArmTable, ContactTable, ErrorTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus


@dataclass(frozen=True)
class ChainEstimate(ContactEstimate):
    """Believed contacts. Links are numbered by their joints, drives in place of joints."""

    balls_m: np.ndarray
    """Middles and ends of the believed capsules' axes, (..., place, 3), NaN where there is none."""

    def inside_m(self) -> np.ndarray:
        """As of a `ContactEstimate`."""
        return self.balls_m


def estimate_chain_contacts(
    closing: ChainClosing,
    believed_pose: np.ndarray,
    commands_rad: np.ndarray,
    arm: ArmTable,
    hand: ChainHand,
    table: HandTable,
    sensors: SensorTable,
    *,
    errors: ErrorTable | None = None,
    contact: ContactTable | None = None,
    device: str = "cpu",
) -> ChainEstimate:
    """Contacts as the robot concludes them, by what the hand senses.

    As `contact_estimate.estimate_contacts`, with `hand` in place of the Utah-MIT's. It
    raises the same errors.
    """
    dims = closing.status.shape
    errors, contact = errors or ErrorTable(), contact or ContactTable()
    steps = last_steps(closing, commands_rad)
    each = "world probe grasp finger"
    kinds: dict[str, Any] = {
        "point": vec3, "covariance": mat33, "normal": vec3, "link_out": int, "link_weight": vec6,
        "torque_out": vec6, "torque_sigma": vec6, "balls": balls_type}
    out = {name: wp.empty(dims, dtype=kind, device=device) for name, kind in kinds.items()}
    given = {name: wp.array(np.ascontiguousarray(values), dtype=kind, device=device)
             for name, values, kind in (
        ("status", closing.status, int), ("q", padded(np.nan_to_num(closing.q_rad)), vec6),
        ("read", padded(np.nan_to_num(closing.torque_Nm)), vec6),
        ("way", padded(steps), vec6))}
    none = no_chain_errors(hand)
    launch(chain_estimate_kernel,
           dict(zip(each.split(), dims, strict=True)),
           {"believed": "1 finger", "sensors": "1 finger", "hand_pose": "world probe",
            **dict.fromkeys((*given, *out), each)}, {
        "believed": true_chains(hand, table, contact, none, device),
        "sensors": true_sensors(hand, table, sensors, contact, none, device),
        "intrinsic": int(sensors.contact_estimator == "intrinsic"),
        "pose_variance": place_variance(errors, arm, longest_link_m(hand)),
        "angle_variance": 2.0 * (sensors.joint_noise_rad**2 + errors.joint_offset_rad**2),
        "arm_share": errors.moment_arm_share,
        "hand_pose": poses_of(
            "believed_pose", believed_pose, device,
            (closing.status == ProbeStatus.CONTACT).any((-1, -2))),
        **given, **out}, device=device, heavy=True)
    found = {name: values.numpy().copy() for name, values in out.items()}
    most = max(len(own) for own in hand.capsules)
    return ChainEstimate(
        found["point"], found["covariance"], found["normal"], found["link_out"],
        found["link_weight"][..., :hand.links], found["torque_out"][..., :hand.width],
        found["torque_sigma"][..., :hand.width], steps, np.full((*dims, 4, 3), np.nan),
        found["balls"][..., :2 * most, :])


def longest_link_m(hand: ChainHand) -> float:
    """From joint to joint [m]; 0 for a hand of one joint a finger."""
    return max((float(np.linalg.norm(joint.place[:3]))
                for finger in hand.model.fingers for joint in finger.joints[1:]), default=0.0)
