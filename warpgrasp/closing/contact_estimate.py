"""Where the robot concludes that a finger touched, with a covariance.

`fingertip`, as in the paper: the palmar surface point of the tip, by nominal forward kinematics
from the measured joint angles. `intrinsic`: intrinsic contact sensing (Bicchi, Salisbury and Brock
1993, Contact sensing from force measurements) from joint torques. A frictionless contact force acts
along the normal of a link's capsule, and the four joint torques determine its place. With friction
it leans as the link sticks or slides (`warpgrasp.finger.sliding`). The posterior over all places of
the three capsules, and over directions about that one, gives the mean and the covariance.
Before any torque a place is as likely as what it sweeps on the way that the finger was going.
"""

from dataclasses import dataclass

import numpy as np
import warp as wp

from warpgrasp.closing.closing import Closing
from warpgrasp.closing.closing_kernels import estimate_kernel
from warpgrasp.core.dtypes import mat33, vec3, vec4
from warpgrasp.core.kernel_launch import array_of, launch, poses_of
from warpgrasp.mechanism.calibration import place_variance
from warpgrasp.mechanism.tendon import tendon_sensor_of
from warpgrasp.mechanism.utah_mit_hand import FINGER_COUNT, hand_of
from warpgrasp.parameters import ArmTable, ContactTable, ErrorTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus

FINGERTIP_SIGMA_M = 0.006
"""Spread given to a fingertip estimate [est]: its error is mostly that another place touched."""


@dataclass(frozen=True)
class ContactEstimate:
    """Believed contacts, base frame. Shapes start with (world, probe, grasp, finger)."""

    point_m: np.ndarray
    """(..., 3), NaN without a contact."""
    covariance_m2: np.ndarray
    """(..., 3, 3)."""
    normal: np.ndarray
    """Outward normal of the object's surface, (..., 3)."""
    link: np.ndarray
    """Link believed in touch (0 proximal to 2 distal), -1 without a contact."""
    link_weight: np.ndarray
    """Posterior probability of each link, (..., link); zeros without a contact."""
    torque_Nm: np.ndarray
    """By which contacts turn the joints, the links' weight taken off, (..., joint)."""
    torque_sigma_Nm: np.ndarray
    """Its standard deviation; huge where a joint is held by its stop, (..., joint)."""
    step_rad: np.ndarray
    """The last step of the command of each joint, (..., joint)."""
    link_points_m: np.ndarray
    """Believed joints and tip centre of each finger, (..., 4, 3): the links' axes between them.
    NaN of a hand of chains."""

    def inside_m(self) -> np.ndarray:
        """Places of the links' axes that are believed, (..., place, 3): a ball of a link's radius
        about each lies in the finger."""
        joints = self.link_points_m
        return np.concatenate([0.5 * (joints[..., :-1, :] + joints[..., 1:, :]),
                               joints[..., 1:, :]], axis=-2)


def estimate_contacts(
    closing: Closing,
    believed_pose: np.ndarray,
    commands_rad: np.ndarray,
    arm: ArmTable,
    hand: HandTable,
    sensors: SensorTable,
    *,
    errors: ErrorTable | None = None,
    contact: ContactTable | None = None,
    device: str = "cpu",
) -> ContactEstimate:
    """Contacts as the robot concludes them, by `sensors.contact_estimator`.

    `believed_pose` (world, probe, 7) is the nominal hand pose [m, quaternion xyzw], `commands_rad`
    (grasp, finger, step, 4) the commands of the closings. `errors` says how far the robot may be
    from its tables, and `contact` what acts on its fingers; the defaults are `ErrorTable()` and
    `ContactTable()`. Raises ShapeError where shapes disagree, ValueError for the pose of a contact
    that is no place and unit quaternion.
    """
    worlds, probes, grasps, fingers = closing.status.shape
    dims = (worlds, probes, grasps, fingers)
    point = wp.empty(dims, dtype=vec3, device=device)
    covariance = wp.empty(dims, dtype=mat33, device=device)
    normal = wp.empty(dims, dtype=vec3, device=device)
    link = wp.empty(dims, dtype=int, device=device)
    link_weight = wp.empty(dims, dtype=vec3, device=device)
    joints = {name: wp.empty(dims, dtype=vec3, device=device)
              for name in ("joint_1", "joint_2", "joint_3", "tip")}
    torques = {name: wp.empty(dims, dtype=vec4, device=device)
               for name in ("torque_out", "torque_sigma")}
    errors = errors or ErrorTable()
    steps = last_steps(closing, commands_rad)
    each = "world probe grasp finger"

    def put(values: np.ndarray, dtype: type) -> wp.array:
        return array_of(values, dtype, device)

    launch(estimate_kernel, dict(zip(("world", "probe", "grasp", "finger"), dims, strict=True)), {
        "status": each, "hand_pose": "world probe", "q": each, "flexor": each, "extensor": each,
        "way": each, "point": each, "covariance": each, "normal": each, "link_out": each,
        **dict.fromkeys(("link_weight", *joints, *torques), each)}, {
        "hand": hand_of(hand, contact), "sensor": tendon_sensor_of(hand, sensors),
        "intrinsic": int(sensors.contact_estimator == "intrinsic"),
        "pose_variance": place_variance(errors, arm, max(hand.link_length_m)),
        "angle_variance": 2.0 * (sensors.joint_noise_rad**2 + errors.joint_offset_rad**2),
        "arm_share": errors.moment_arm_share,
        "tip_variance": FINGERTIP_SIGMA_M**2,
        "status": put(closing.status, int), "hand_pose": poses_of(
            "believed_pose", believed_pose, device,
            (closing.status == ProbeStatus.CONTACT).any((-1, -2))),
        "q": put(closing.q_rad, vec4), "flexor": put(closing.tension_N[..., 0], vec4),
        "extensor": put(closing.tension_N[..., 1], vec4),
        "way": put(steps, vec4), "point": point,
        "covariance": covariance, "normal": normal, "link_out": link,
        "link_weight": link_weight, **joints, **torques},
        device=device, heavy=True)
    assert fingers == FINGER_COUNT
    return ContactEstimate(point.numpy().copy(), covariance.numpy().copy(),
                           normal.numpy().copy(), link.numpy().copy(), link_weight.numpy().copy(),
                           torques["torque_out"].numpy().copy(),
                           torques["torque_sigma"].numpy().copy(), steps,
                           np.stack([joint.numpy() for joint in joints.values()], axis=-2))


def last_steps(closing: Closing, commands_rad: np.ndarray) -> np.ndarray:
    """Each joint's last command step before its finger stopped [rad], (world, probe, grasp,
    finger, joint), of commands (grasp, finger, step, joint)."""
    step = np.maximum(closing.step, 0)
    before = np.maximum(step - 1, 0)
    grasp, finger = np.ogrid[:commands_rad.shape[0], :commands_rad.shape[1]]
    return np.round(commands_rad[grasp, finger, step] - commands_rad[grasp, finger, before], 12)
