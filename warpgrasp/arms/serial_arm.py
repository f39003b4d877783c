"""Serial arms on the host: what kernels need of a model, and kinematics in batches."""

import numpy as np
import warp as wp
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from warpgrasp.arms.arm_model import ARM_JOINTS, ArmModel, Vector
from warpgrasp.arms.serial_arm_kernel import (
    MORE_STARTS,
    STARTS,
    SerialArm,
    come_kernel,
    flange_kernel,
    joints_kernel,
)
from warpgrasp.core.array_checks import check_array, check_range
from warpgrasp.core.dtypes import mat77, transform, vec7
from warpgrasp.core.kernel_launch import array_of, launch

_Place = tuple[np.ndarray, Rotation]


def serial_of(model: ArmModel) -> SerialArm:
    """The kernels' arm: every axis is made the z axis of its joint's frame."""
    arm = SerialArm()
    arm.joints = len(model.joints)
    frame = np.zeros((ARM_JOINTS, 7))
    frame[:, 6] = 1.0
    before = _place(model.base_xyz_m, model.base_rpy_rad)
    reach = 0.0
    for j, joint in enumerate(model.joints):
        at, turn = _after(before, _place(joint.xyz_m, joint.rpy_rad))
        to_axis = _onto_axis(joint.axis)
        frame[j] = *at, *(turn * to_axis).as_quat()
        before = np.zeros(3), to_axis.inv()
        reach += float(np.linalg.norm(at)) if j else 0.0
    at, turn = _after(before, _place(model.flange_xyz_m, model.flange_rpy_rad))
    arm.frame = mat77(*frame.ravel())
    arm.flange = transform(*at, *turn.as_quat())
    arm.low = vec7(*padded([joint.low_rad for joint in model.joints]))
    arm.high = vec7(*padded([joint.high_rad for joint in model.joints]))
    arm.home = vec7(*padded(model.home_rad))
    arm.reach = reach + float(np.linalg.norm(at)) + 1e-9
    return arm


def arm_reach_m(model: ArmModel) -> float:
    """How far the flange is from the first joint's origin at most, its joints' limits apart [m]."""
    return float(serial_of(model).reach)


def padded(q: ArrayLike) -> np.ndarray:
    """Joints (..., joint) with zeros for those that an arm has not, (..., 7)."""
    q = np.asarray(q, float)
    return np.concatenate([q, np.zeros((*q.shape[:-1], ARM_JOINTS - q.shape[-1]))], axis=-1)


def flange_poses(model: ArmModel, q_rad: np.ndarray, *, device: str = "cpu") -> np.ndarray:
    """Flange poses (pose, 7), [m] and quaternion xyzw, of joints (pose, joint) [rad]. Raises
    TypeError and ValueError for other arrays."""
    check_array("q_rad", q_rad, "numbers", "pose joint", joint=len(model.joints))
    out = wp.empty(len(q_rad), dtype=transform, device=device)
    launch(flange_kernel, {"pose": len(q_rad)}, {"q": "pose", "flange": "pose"},
           {"arm": serial_of(model), "q": array_of(padded(q_rad), vec7, device),
            "flange": out}, device=device)
    return out.numpy().copy()


def nearest_joints(model: ArmModel, flange: np.ndarray, last_rad: np.ndarray, *,
                   device: str = "cpu") -> np.ndarray:
    """Joints (pose, joint) [rad] within the limits at flange poses (pose, 7), near `last_rad`
    (pose, joint); NaN where none are found. Raises TypeError and ValueError for other arrays."""
    check_array("flange", flange, "numbers", "pose 7")
    check_array("last_rad", last_rad, "numbers", "pose joint", pose=len(flange),
                joint=len(model.joints))
    out = wp.empty(len(flange), dtype=vec7, device=device)  # pyright: ignore[reportArgumentType]
    launch(joints_kernel, {"pose": len(flange)}, {"flange": "pose", "last": "pose", "q": "pose"}, {
        "arm": serial_of(model), "flange": array_of(flange, transform, device),
        "last": array_of(padded(last_rad), vec7, device), "q": out}, device=device)
    return _unpadded(out.numpy(), model)


def serial_places(model: ArmModel, q_rad: np.ndarray) -> np.ndarray:
    """Frames of base, joints and flange (joint + 2, 7), [m] and quaternion xyzw, of joints (joint,)
    [rad]."""
    at, turn = _place(model.base_xyz_m, model.base_rpy_rad)
    places = [np.concatenate([at, turn.as_quat()])]
    for joint, angle in zip(model.joints, q_rad, strict=True):
        at, turn = _after((at, turn), _place(joint.xyz_m, joint.rpy_rad))
        turn = turn * Rotation.from_rotvec(angle * np.array(joint.axis))
        places.append(np.concatenate([at, turn.as_quat()]))
    at, turn = _after((at, turn), _place(model.flange_xyz_m, model.flange_rpy_rad))
    return np.array([*places, np.concatenate([at, turn.as_quat()])])


def joint_choices(model: ArmModel, flange: np.ndarray, *, starts: int = STARTS,
                  device: str = "cpu") -> np.ndarray:
    """The joints (pose, start, joint) [rad] that home and the other starts come to at flange poses
    (pose, 7); NaN where one comes to none. Where none of them comes to a pose, further starts are
    tried, and the first choice is that of the first start which does. Raises TypeError and
    ValueError for other arrays, and for no starts."""
    check_array("flange", flange, "numbers", "pose 7")
    check_range("starts", starts, 1, MORE_STARTS)
    found = _come_to(model, flange, 0, starts, device)
    none = np.isnan(found).all((1, 2))
    if none.any() and starts < MORE_STARTS:
        more = _come_to(model, flange[none], starts, MORE_STARTS - starts, device)
        best = np.isfinite(more).all(-1).argmax(1)
        found[none, 0] = more[np.arange(len(more)), best]
    return found


def _come_to(model: ArmModel, flange: np.ndarray, before: int, starts: int, device: str
             ) -> np.ndarray:
    """The joints (pose, start, joint) [rad] that some starts, those after the first `before`, come
    to; NaN where one comes to none."""
    out = wp.empty((len(flange), starts), dtype=vec7,  # pyright: ignore[reportArgumentType]
                   device=device)
    home = np.tile(padded(model.home_rad), (len(flange), 1))
    launch(come_kernel, {"pose": len(flange), "start": starts},
           {"flange": "pose", "near": "pose", "q": "pose start"}, {
        "arm": serial_of(model), "flange": array_of(flange, transform, device),
        "near": array_of(home, vec7, device), "before": before, "q": out}, device=device,
        heavy=True)
    return _unpadded(out.numpy(), model)


def _unpadded(q: np.ndarray, model: ArmModel) -> np.ndarray:
    found = q[..., :len(model.joints)].copy()
    found[~np.isfinite(found).all(-1)] = np.nan
    return found


def _place(xyz: Vector, rpy: Vector) -> _Place:
    return np.array(xyz), Rotation.from_euler("xyz", rpy)


def _after(before: _Place, then: _Place) -> _Place:
    return before[0] + before[1].apply(then[0]), before[1] * then[1]


def _onto_axis(axis: Vector) -> Rotation:
    """A turn that takes the z axis to `axis`."""
    if axis == (0.0, 0.0, 1.0):
        return Rotation.identity()
    if axis == (0.0, 0.0, -1.0):
        return Rotation.from_euler("x", np.pi)
    way = np.cross([0.0, 0.0, 1.0], axis)
    return Rotation.from_rotvec(way / np.linalg.norm(way) * np.arccos(np.clip(axis[2], -1, 1)))
