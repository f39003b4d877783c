"""How the hand leans over a face that one finger is to cross, so that the arm reaches it."""

import numpy as np

from fit.rotation import matrix_of_quaternion, turn_points
from strategies.poses.postures import poking_pose
from warpgrasp.mechanism.arm_reach import hand_reachable
from warpgrasp.mechanism.touch_postures import ExtendedFinger
from warpgrasp.robot import Robot

_LEANS = np.radians([0, 45, -45, 90, -90, 135, -135, 180])
_CROSS = np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]]) * 0.040
"""Places along u and v [m] that the arm should reach, and the point where it approaches from."""
_ALL_OF_CROSS = len(_CROSS) + 1


def choose_lean(
    robot: Robot, one: ExtendedFinger, point: np.ndarray, axes: np.ndarray,
    stand_off_m: float
) -> tuple[np.ndarray, np.ndarray]:
    """Hand poses touching `point` (n, 3), leaning so that the arm reaches, and whether it does.

    Preferred is a finger that points downwards at an upright face; among the leans that can be
    reached over the most of a cross of 40 mm about the point, the one nearest to that. Whether the
    hand's other parts would meet the object is not asked.
    """
    pose, usable, score = _lean_poses(robot, one, point, axes, stand_off_m, _LEANS[:1])
    # No other lean is better than the first one, where that reaches all of the cross.
    rest = np.flatnonzero(~usable | (score < _ALL_OF_CROSS))
    if len(rest):
        pose[rest], usable[rest], _ = _lean_poses(robot, one, point[rest], axes[rest], stand_off_m,
                                                  _LEANS)
    return pose, usable


def _lean_poses(
    robot: Robot, one: ExtendedFinger, point: np.ndarray, axes: np.ndarray,
    stand_off_m: float, leans: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The best of some leans for each point: its pose (n, 7), whether it is usable, how much of the
    cross it reaches, less a little for every lean before it, (n,)."""
    u, v, normal = axes[:, 0], axes[:, 1], axes[:, 2]
    lean = (-np.cos(leans)[None, :, None] * v[:, None]
            + np.sin(leans)[None, :, None] * u[:, None])
    cross = _CROSS[:, :1] * u[:, None] + _CROSS[:, 1:] * v[:, None]
    cross = np.concatenate([cross, stand_off_m * normal[:, None]], 1)
    poses = poking_pose(one, (point[:, None] + cross)[:, None], -normal[:, None, None],
                        lean[:, :, None])
    reached = hand_reachable(robot.arm, robot.hand, poses)
    score = reached.sum(-1) - 0.1 * np.arange(len(leans))
    usable = reached[:, :, 0] & reached[:, :, -1]
    # On an upright face a finger that points upwards would run its hand into the table.
    usable &= (lean[:, :, 2] < 0.2) | (np.abs(normal[:, None, 2]) > 0.7)
    best = np.where(usable, score, -1.0).argmax(1)
    rows = np.arange(len(point))
    return poses[rows, best, 0], usable[rows, best], score[rows, best]


def face_axes(normal: np.ndarray) -> np.ndarray:
    """u level, v upwards (on a level face: towards +x), and the unit normal itself, (n, 3, 3)."""
    up = np.where(np.abs(normal[:, 2:]) < 0.95, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0])
    u = np.cross(up, normal)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return np.stack([u, np.cross(normal, u), normal], 1)


def fingertip_from(one: ExtendedFinger, turn: np.ndarray) -> np.ndarray:
    """From the hand's origin to the centre of the extended fingertip [m], (n, 3), for the
    hand's quaternions (n, 4)."""
    # SciPy's product rounds one rotation differently from several: a row would depend on others.
    return turn_points(matrix_of_quaternion(turn), one.tip_m[None])[:, 0]
