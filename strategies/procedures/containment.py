"""Grasping by containment (Allen and Michelman 1990, section IV-C): the first procedure.

At each waypoint the open hand approaches the object and closes along one or more closing paths.
A finger stops where the difference of its tendon tensions passes the threshold. The joint angles
and tensions read at the stops become contacts in `strategies.recovery.evidence`.
"""

import numpy as np

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from warpgrasp.robot import Grasps, Robot


def padded_commands(closings: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Joint commands of several closing paths in one array.

    `closings` are names in `CLOSING_PATHS`. Returns the commands [rad], shape (grasp, finger,
    step, 4), shorter paths padded with their last command, and the number of steps of each path,
    shape (grasp,). Raises KeyError for an unknown name.
    """
    paths = [closing_commands(CLOSING_PATHS[name]) for name in closings]
    longest = max(p.shape[1] for p in paths)
    padded = np.stack([np.pad(p, ((0, 0), (0, longest - p.shape[1]), (0, 0)), mode="edge")
                       for p in paths])
    return padded, np.array([p.shape[1] for p in paths])


def explore_by_containment(
    robot: Robot, hand_pose: np.ndarray, wanted: np.ndarray, closings: tuple[str, ...],
    room: np.ndarray | None = None,
) -> Grasps:
    """Grasp at every wanted pose along every named closing path.

    `hand_pose` (world, probe, 7) holds positions [m] and quaternions xyzw in the base frame, and
    `wanted` (world, probe) says which poses to visit. `room` (world,) limits the finger closings
    of each world: the poses that would exceed it are not tried. Raises KeyError for an unknown
    closing path.
    """
    commands, count = padded_commands(closings)
    return robot.grasp(hand_pose, wanted, commands, count, room)
