"""Arm and hand together: taking the hand to a sequence of poses, and what that costs.

A probe is approached from a retreat behind its pose, straight along the hand's z axis, and left the
same way. The approach is guarded by the arm's torques: what strikes anything stops it. Between
retreats the arm moves joint by joint, the slowest joint governing; that the way between retreats is
free is assumed, not checked. The believed pose is what the encoders and the nominal tables say; the
true one differs by repeatability and by errors of calibration, which are fixed per episode
(`calibration`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from scipy.spatial.transform import Rotation

from warpgrasp.arms.serial_arm import padded
from warpgrasp.core.array_checks import check_range
from warpgrasp.core.dtypes import real, transform, vec7
from warpgrasp.core.kernel_launch import array_of, launch, poses_of
from warpgrasp.geometry.scene import Scene
from warpgrasp.mechanism.arm import arm_flanges, arm_home, arm_of
from warpgrasp.mechanism.arm_motion_kernel import _clearance_kernel, _move_kernel
from warpgrasp.mechanism.calibration import Calibration, no_errors, true_arms, true_hands
from warpgrasp.mechanism.utah_mit_hand import hand_links
from warpgrasp.parameters import ArmTable, ContactTable, HandTable
from warpgrasp.probe_status import ProbeStatus

ClearanceKernel = tuple[Any, Mapping[str, str], Mapping[str, Any]]
"""A kernel that tells which approaches are barred, shapes in words and arguments of the hand."""
Clearance = Callable[[np.ndarray, str], ClearanceKernel]
"""That kernel for commands (grasp, finger, step, joint) and a device."""


@dataclass(frozen=True)
class ArmState:
    """The joints of each arm between batches of probes [rad], (world, 7): zeros after the last.

    Of a floating wrist: place [m] and rotation vector.
    """

    q_rad: np.ndarray

    @staticmethod
    def home(worlds: int, arm: ArmTable | None = None) -> "ArmState":
        """All arms at home; the default of `arm` is `ArmTable()`."""
        return ArmState(np.tile(padded(arm_home(arm or ArmTable())), (worlds, 1)))


@dataclass(frozen=True)
class ArmMoves:
    """The outcome of moving the hand to each pose. Shapes start with (world, probe)."""

    status: np.ndarray
    """(..., grasp) ProbeStatus: CONTACT means ready to close, else why the probe is not made."""
    believed_pose: np.ndarray
    """Hand pose the robot believes, [m] and quaternion xyzw, (..., 7)."""
    time_s: np.ndarray
    """From the last retreat to this pose and back to its retreat."""
    path_m: np.ndarray
    """Path of the hand's origin over the same moves, straight between its stations."""
    state: ArmState


def arm_hand_links(
    arm: ArmTable, hand: HandTable, q_rad: np.ndarray, *, device: str = "cpu"
) -> tuple[np.ndarray, np.ndarray]:
    """Every joint and fingertip of the whole robot in the base frame, nominal mount.

    `q_rad` (pose, joint) [rad]: those of the arm, then four of each finger, the thumb last, of the
    PUMA 560 22 in all. Returns points [m], (pose, finger 4, 5, 3): base, flexion joints, tip
    centre; and unit palmar normals, (pose, finger 4, link 3, 3). Raises ValueError for another
    shape.
    """
    joints = len(arm_home(arm))
    if q_rad.ndim != 2 or q_rad.shape[1] != joints + 16:
        raise ValueError(f"q_rad has shape {q_rad.shape}, wants (pose, {joints + 16})")
    pose = arm_flanges(arm, q_rad[:, :joints], device=device)
    reach = Rotation.from_quat(pose[:, 3:]).apply([0.0, 0.0, hand.mount_length_m])
    pose[:, :3] += reach
    return hand_links(hand, pose, q_rad[:, joints:].reshape(-1, 4, 4), device=device)


def move_hand(
    scene: Scene,
    body: np.ndarray,
    body_pose: np.ndarray,
    arm: ArmTable,
    hand: HandTable,
    key: np.ndarray,
    state: ArmState,
    wanted_pose: np.ndarray,
    wanted: np.ndarray,
    commands_rad: np.ndarray,
    *,
    contact: ContactTable | None = None,
    errors: Calibration | None = None,
    probe_number: np.ndarray | None = None,
    clearance: Clearance | None = None,
    device: str = "cpu",
) -> tuple[ArmMoves, np.ndarray]:
    """Move each world's hand to its poses in turn, and say which probes can be made.

    `wanted_pose` (world, probe, 7) are hand poses [m], quaternion xyzw, base frame; `wanted`
    (world, probe) is False where a world has no such probe. `commands_rad` (grasp, finger, step,
    joint) gives each grasp's open hand (its first step), which must clear object and table on the
    last 0.12 m of the approach. `errors` are those of the true robots; none unless given.
    `probe_number` (world, probe) numbers the probes for the noise, each world's from 0 unless
    given. `clearance` stands for a hand other than the Utah-MIT's. Returns the moves and the true
    hand poses (world, probe, 7), which only the simulator may use. A wanted pose that is not finite
    is UNREACHABLE. Raises ShapeError, and ValueError for a body that the scene has not, for another
    pose of an object that is no place and unit quaternion, and for a wanted quaternion of another
    length.
    """
    check_range("body", body, 0, scene.bodies - 1)
    worlds, probes = wanted_pose.shape[:2]
    grasps = len(commands_rad)
    errors = errors or no_errors()
    if probe_number is None:
        probe_number = np.tile(np.arange(probes), (worlds, 1))
    status = wp.empty((worlds, probes), dtype=int, device=device)
    believed = wp.empty((worlds, probes), dtype=transform, device=device)
    actual = wp.empty((worlds, probes), dtype=transform, device=device)
    time = wp.empty((worlds, probes), dtype=real, device=device)
    path = wp.empty((worlds, probes), dtype=real, device=device)
    end = wp.empty(worlds, dtype=vec7, device=device)  # pyright: ignore[reportArgumentType]
    tries = np.where(wanted, int(ProbeStatus.CONTACT), int(ProbeStatus.NOT_TRIED))
    finite = np.isfinite(wanted_pose).all(-1)
    tries = np.where(wanted & ~finite, int(ProbeStatus.UNREACHABLE), tries)
    extents = {"world": worlds}
    launch(_move_kernel, extents, {
        "true_arms": "world?", "key": "world", "mount": "world?",
        "wanted": "world probe", "wanted_status": "world probe",
        "probe_number": "world probe", "start": "world", "status": "world probe",
        "believed": "world probe", "actual": "world probe", "time": "world probe",
        "path": "world probe", "end": "world"}, {
        "arm": arm_of(arm, hand.mount_length_m),
        "true_arms": true_arms(arm, hand.mount_length_m, errors, device),
        "key": array_of(key, wp.uint64, device),
        "probe_number": array_of(probe_number, int, device),
        "mount": array_of(errors.mount, transform, device),
        "wanted": poses_of("wanted_pose", wanted_pose, device, wanted & finite),
        "wanted_status": array_of(tries, int, device),
        "start": array_of(state.q_rad, vec7, device), "status": status,
        "believed": believed, "actual": actual, "time": time, "path": path, "end": end},
        device=device)
    if clearance is None:
        clearance = _utah_mit_clearance(hand, contact or ContactTable(), errors)
    ready = wp.empty((worlds, probes, grasps), dtype=int, device=device)
    kernel, shapes, given = clearance(commands_rad, device)
    launch(kernel, {"world": worlds, "probe": probes, "grasp": grasps}, {
        "body": "world?", "body_pose": "world", "move_status": "world probe",
        "actual": "world probe", "status": "world probe grasp", **shapes}, {
        "scene": scene, "body": array_of(body, int, device),
        "body_pose": poses_of("body_pose", body_pose, device),
        "move_status": status, "actual": actual, "status": ready,
        **given}, device=device)
    ready_host = ready.numpy().copy()
    # A probe whose way in is barred is barred for all its grasps.
    barred = ready_host[:, :, :1] == int(ProbeStatus.COLLISION)
    ready_host = np.where(barred, int(ProbeStatus.COLLISION), ready_host)
    moves = ArmMoves(ready_host, believed.numpy().copy(), time.numpy().copy(),
                     path.numpy().copy(), ArmState(end.numpy().copy()))
    return moves, actual.numpy().copy()


def _utah_mit_clearance(hand: HandTable, contact: ContactTable, errors: Calibration) -> Clearance:
    def kernel_of(commands_rad: np.ndarray, device: str) -> ClearanceKernel:
        return _clearance_kernel, {"hands": "world? 4", "commands": "grasp 4 step 4"}, {
            "hands": true_hands(hand, contact, errors, device),
            "mount_length": hand.mount_length_m,
            "commands": array_of(commands_rad, real, device)}

    return kernel_of
