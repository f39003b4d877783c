"""Grasping by containment (Allen and Michelman 1990, section IV-C): the first procedure.

The hand goes to each waypoint and closes along each path until every finger's tendons say contact.
What is felt becomes evidence for a fit in `strategies.recovery.evidence`.
"""

import numpy as np

from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands
from warpgrasp.robot import Grasps, Robot


def padded_commands(closings: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Commands of several paths, (grasp, finger, step, 4) [rad], and how many steps each has."""
    paths = [closing_commands(CLOSING_PATHS[name]) for name in closings]
    longest = max(p.shape[1] for p in paths)
    padded = np.stack([np.pad(p, ((0, 0), (0, longest - p.shape[1]), (0, 0)), mode="edge")
                       for p in paths])
    return padded, np.array([p.shape[1] for p in paths])


def explore_by_containment(
    robot: Robot, hand_pose: np.ndarray, wanted: np.ndarray, closings: tuple[str, ...],
    room: np.ndarray | None = None,
) -> Grasps:
    """Grasp at every wanted pose (world, probe, 7) along every named closing path; no more poses
    once the fingers' closings are as many as `room` (world,)."""
    commands, count = padded_commands(closings)
    return robot.grasp(hand_pose, wanted, commands, count, room)
