"""Grasping by containment (Allen and Michelman 1990, section IV-C): the first procedure.

At each waypoint the open hand approaches the object and closes along one or more closing paths.
A finger stops where the difference of its tendon tensions, or what else it feels, passes the
threshold. The joint angles and tensions read at the stops become contacts in
`strategies.recovery.evidence`.
"""

from collections.abc import Sequence

import numpy as np

from strategies.poses.chain_paths import chain_commands, chain_path_names
from strategies.poses.closing_paths import CLOSING_PATHS, closing_commands, commands_within
from warpgrasp.chain.chain_hand import chain_of_table
from warpgrasp.parameters import HandTable
from warpgrasp.robot import Grasps, Robot


def closing_names(hand: HandTable) -> tuple[str, ...]:
    """Names of a hand's closing paths. Raises HandError for a hand that cannot be used."""
    chain = chain_of_table(hand)
    return tuple(CLOSING_PATHS) if chain is None else chain_path_names(chain)


def check_closings(closings: tuple[str, ...], hand: HandTable) -> None:
    """Raises ValueError where no list of names is given, KeyError for paths a hand has not."""
    if isinstance(closings, str) or not isinstance(closings, Sequence) or not closings:
        raise ValueError(f"closings: are {closings!r}; should be names such as (\"curl40\",)")
    known = closing_names(hand)
    for name in closings:
        if name not in known:
            raise KeyError(f"closing path {name!r}; should be one of {', '.join(known)}")


def padded_commands(
    closings: tuple[str, ...], hand: HandTable | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Joint commands of several closing paths in one array, by default of the Utah-MIT hand.

    `closings` are names in `CLOSING_PATHS`, or of another hand those of `chain_path_names`. Returns
    the commands [rad], shape (grasp, finger, step, joint), shorter paths padded with their last
    command, and the number of steps of each path, shape (grasp,). Raises KeyError for an unknown
    name, and names those there are; ValueError where no list of names is given.
    """
    check_closings(closings, hand or HandTable())
    chain = None if hand is None else chain_of_table(hand)
    paths = [_utah_mit_commands(name, hand or HandTable()) if chain is None
             else chain_commands(chain, name) for name in closings]
    longest = max(p.shape[1] for p in paths)
    padded = np.stack([np.pad(p, ((0, 0), (0, longest - p.shape[1]), (0, 0)), mode="edge")
                       for p in paths])
    return padded, np.array([p.shape[1] for p in paths])


def _utah_mit_commands(name: str, hand: HandTable) -> np.ndarray:
    return commands_within(closing_commands(CLOSING_PATHS[name]), hand)


def explore_by_containment(
    robot: Robot, hand_pose: np.ndarray, wanted: np.ndarray, closings: tuple[str, ...],
    room: np.ndarray | None = None, closes: np.ndarray | None = None,
) -> Grasps:
    """Grasp at every wanted pose along every named closing path.

    `hand_pose` (world, probe, 7) holds positions [m] and quaternions xyzw in the base frame, and
    `wanted` (world, probe) says which poses to visit. `room` (world,) limits the finger closings
    of each world: the poses that would exceed it are not tried. `closes` (world, probe, finger)
    bool says which fingers close, all unless given. Raises KeyError for an unknown closing path,
    ValueError for none and for arrays of other shapes, TypeError for arrays of other kinds.
    """
    commands, count = padded_commands(closings, robot.hand)
    return robot.grasp(hand_pose, wanted, commands, count, room, closes)
