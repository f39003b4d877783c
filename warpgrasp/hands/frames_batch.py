"""Forward kinematics of any hand for batches of configurations, in a kernel."""

import numpy as np
import warp as wp

from warpgrasp.core.array_checks import check_array
from warpgrasp.core.dtypes import real, transform, vec3
from warpgrasp.core.kernel_launch import launch
from warpgrasp.hands.hand_frames import driven_angles
from warpgrasp.hands.hand_model import STILL, HandModel
from warpgrasp.hands.link_frames_kernel import link_frames_kernel


def chain_tables(model: HandModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (finger, joint, 7) and axes (finger, joint, 3) of the chains, and the number of each
    joint among all, (finger, joint), -1 where a shorter chain is filled up."""
    most = max(len(finger.joints) for finger in model.fingers)
    place = np.tile(np.array(STILL), (len(model.fingers), most, 1))
    axis = np.tile([0.0, 0.0, 1.0], (len(model.fingers), most, 1))
    number = np.full((len(model.fingers), most), -1)
    count = 0
    for f, finger in enumerate(model.fingers):
        for j, joint in enumerate(finger.joints):
            place[f, j], axis[f, j], number[f, j] = joint.place, joint.axis, count
            count += 1
    return place, axis, number


def link_frames_batch(model: HandModel, q_rad: np.ndarray, *, device: str = "cpu") -> np.ndarray:
    """Frames of every finger's links in the palm's frame, (pose, finger, joint, 7): position [m],
    quaternion xyzw. Chains shorter than the longest repeat the frame of their last link.

    `q_rad` has the angles of the driven joints [rad], (pose, driven). Raises TypeError and
    ValueError for other arrays.
    """
    check_array("q_rad", q_rad, "numbers", "pose driven", driven=len(model.driven))
    place, axis, number = chain_tables(model)
    angle = np.where(number >= 0, driven_angles(model, q_rad)[:, number], 0.0)
    count, (fingers, joints) = len(q_rad), number.shape
    frame = wp.empty((count, fingers, joints), dtype=transform, device=device)
    launch(link_frames_kernel, {"pose": count, "finger": fingers},
           {"place": "finger joint", "axis": "finger joint", "angle": "pose finger joint",
            "frame": "pose finger joint"},
           {"place": wp.array(place, dtype=transform, device=device),
            "axis": wp.array(axis, dtype=vec3, device=device),
            "angle": wp.array(angle, dtype=real, device=device), "frame": frame}, device=device)
    return frame.numpy().copy()
