"""Forward kinematics of any hand on the host: frames of links, tips, angles of postures."""

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.core.array_checks import check_array
from warpgrasp.hands.hand_model import HandModel, Place, Posture


def driven_angles(model: HandModel, q_rad: np.ndarray) -> np.ndarray:
    """Angles of all joints (..., joint) from those of the driven ones (..., driven) [rad].

    A joint that follows has the angle `factor` q + `offset` of the joint it follows, as in URDF.
    """
    number = {joint.name: n for n, joint in enumerate(model.driven)}
    columns = []
    for joint in model.joints:
        if joint.follows is None:
            columns.append(q_rad[..., number[joint.name]])
        else:
            f = joint.follows
            columns.append(q_rad[..., number[f.joint]] * f.factor + f.offset_rad)
    return np.stack(columns, -1)


def matrix_of(place: Place) -> np.ndarray:
    """A place as a homogeneous matrix (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(place[3:]).as_matrix()
    matrix[:3, 3] = place[:3]
    return matrix


def place_of(matrix: np.ndarray) -> Place:
    """A homogeneous matrix (4, 4) as a place."""
    x, y, z, a, b, c, d = (float(v) for v in (
        *matrix[:3, 3], *Rotation.from_matrix(matrix[:3, :3]).as_quat()))
    return x, y, z, a, b, c, d


def fixed_angles(turn: np.ndarray) -> tuple[float, float, float]:
    """Roll, pitch and yaw [rad] of a turn (3, 3): about the fixed x, then y, then z axis, as in
    a URDF."""
    level = float(np.hypot(turn[0, 0], turn[1, 0]))
    pitch = float(np.arctan2(-turn[2, 0], level))
    if level > 1e-9:
        return (float(np.arctan2(turn[2, 1], turn[2, 2])), pitch,
                float(np.arctan2(turn[1, 0], turn[0, 0])))
    # Straight up or down: roll and yaw are one turn.
    return float(np.arctan2(-turn[1, 2], turn[1, 1])), pitch, 0.0


def link_frames(model: HandModel, q_rad: np.ndarray) -> tuple[np.ndarray, ...]:
    """Frames of every finger's links in the palm's frame, (pose, joint of the finger, 4, 4).

    `q_rad` has the angles of the driven joints, (pose, driven) [rad]. Raises TypeError and
    ValueError for other arrays, such as one with the angles of joints that follow.
    """
    check_array("q_rad", q_rad, "numbers", "pose driven", driven=len(model.driven))
    angles = driven_angles(model, q_rad)
    found, first = [], 0
    for finger in model.fingers:
        frame = np.broadcast_to(np.eye(4), (len(q_rad), 4, 4))
        frames = []
        for k, joint in enumerate(finger.joints):
            turn = np.tile(np.eye(4), (len(q_rad), 1, 1))
            turn[:, :3, :3] = Rotation.from_rotvec(
                angles[:, first + k, None] * np.asarray(joint.axis)).as_matrix()
            frame = frame @ matrix_of(joint.place) @ turn
            frames.append(frame)
        found.append(np.stack(frames, 1))
        first += len(finger.joints)
    return tuple(found)


def finger_tips(model: HandModel, q_rad: np.ndarray) -> np.ndarray:
    """Places of the tips in the palm's frame [m], (pose, finger, 3). Takes and raises what
    `link_frames` does."""
    return np.stack([frames[:, -1, :3, :3] @ np.asarray(finger.tip_m) + frames[:, -1, :3, 3]
                     for finger, frames in zip(model.fingers, link_frames(model, q_rad),
                                               strict=True)], 1)


def posture_angles(model: HandModel, posture: Posture) -> np.ndarray:
    """Angles of the driven joints in a posture [rad], (driven,)."""
    named = dict(posture.angles_rad)
    return np.array([named.get(j.name, min(max(0.0, j.low_rad), j.high_rad))
                     for j in model.driven])
