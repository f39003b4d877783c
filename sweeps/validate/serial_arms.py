"""Arms that ship against roboticstoolbox, by their makers' Denavit-Hartenberg tables, and against
MuJoCo, which is given the exported model; and how many poses the iterated inverse finds."""

from math import nan, pi
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from sweeps.validate.comparison import Comparison, engine
from warpgrasp.arms.arm_file import SHIPPED_ARMS, arm_named
from warpgrasp.arms.arm_model import ArmModel
from warpgrasp.arms.serial_arm import flange_poses, nearest_joints, padded
from warpgrasp.export.mjcf import mjcf_text
from warpgrasp.export.robot_tree import arm_hand_tree
from warpgrasp.parameters import ArmTable, HandTable, PadTable

POSES = 1000
NEAR, MISSED = 1e-9, 0.002
REACHED_M = 1e-7
UR5E_DH = ((0.1625, 0.0, pi / 2), (0.0, -0.425, 0.0), (0.0, -0.3922, 0.0), (0.1333, 0.0, pi / 2),
           (0.0997, 0.0, -pi / 2), (0.0996, 0.0, 0.0))
"""d, a [m] and alpha [rad] as Universal Robots has them; the toolbox has no UR5e."""


def compare_arms(poses: int = POSES) -> list[Comparison]:
    """The flange at postures drawn within the limits, and the postures found for it again."""
    rows: list[Comparison] = []
    for name in SHIPPED_ARMS:
        model = arm_named(name)
        limits = np.array([[joint.low_rad, joint.high_rad] for joint in model.joints]).T
        q = np.random.default_rng(0).uniform(*limits, (poses, len(model.joints)))
        ours = flange_poses(model, q)
        base = Rotation.from_euler("xyz", model.base_rpy_rad)
        theirs = np.asarray(_toolbox_arm(name).fkine(q).A).reshape(-1, 4, 4)
        rows += _apart(f"{name}: forward, {poses} postures, roboticstoolbox", ours,
                       base.apply(theirs[:, :3, 3]) + model.base_xyz_m,
                       base * Rotation.from_matrix(theirs[:, :3, :3]))
        rows += _apart(f"{name}: forward, {poses} postures, MuJoCo", ours,
                       *_mujoco_flanges(name, model, q))
        rows += _inverse(name, model, ours)
    return rows


def _toolbox_arm(name: str) -> Any:
    toolbox = engine("roboticstoolbox")
    if name == "panda":
        robot = toolbox.models.DH.Panda()
        robot.tool = np.eye(4)  # the flange, no gripper
        return robot
    return toolbox.DHRobot([toolbox.RevoluteDH(d=d, a=a, alpha=alpha) for d, a, alpha in UR5E_DH])


def _mujoco_flanges(name: str, model: ArmModel, q: np.ndarray) -> tuple[np.ndarray, Rotation]:
    mujoco = engine("mujoco")
    text = mjcf_text(arm_hand_tree(ArmTable(kind=name), HandTable(), PadTable()))
    simulated = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(simulated)
    last = simulated.body(f"arm{len(model.joints)}").id
    at, turn = [], []
    for posture in q:
        data.qpos[:len(posture)] = posture
        mujoco.mj_kinematics(simulated, data)
        at.append(data.xpos[last].copy())
        turn.append(data.xquat[last][[1, 2, 3, 0]])
    turns = Rotation.from_quat(turn)
    return (np.array(at) + turns.apply(model.flange_xyz_m),
            turns * Rotation.from_euler("xyz", model.flange_rpy_rad))


def _apart(what: str, ours: np.ndarray, place: np.ndarray, turn: Rotation) -> list[Comparison]:
    away = np.linalg.norm(ours[:, :3] - place, axis=1).max()
    # The sine of half the angle: an arc cosine would drown it in rounding.
    sine = np.linalg.norm((turn.inv() * Rotation.from_quat(ours[:, 3:])).as_quat()[:, :3], axis=1)
    return [Comparison("arms", f"{what}: position", "m", nan, nan, float(away), NEAR),
            Comparison("arms", f"{what}: rotation", "rad", nan, nan, 2 * float(sine.max()), NEAR)]


def _inverse(name: str, model: ArmModel, flange: np.ndarray) -> list[Comparison]:
    q = nearest_joints(model, flange, np.tile(model.home_rad, (len(flange), 1)))
    found = np.isfinite(q).all(1)
    again = flange_poses(model, q[found])
    away = float(np.linalg.norm(again[:, :3] - flange[found, :3], axis=1).max())
    low, high = (padded([getattr(joint, side) for joint in model.joints])
                 for side in ("low_rad", "high_rad"))
    beyond = np.maximum(padded(q[found]) - high, low - padded(q[found])).max()
    return [
        Comparison("arms", f"{name}: share of these poses that the inverse does not find", "share",
                   nan, nan, float(1.0 - found.mean()), MISSED),
        Comparison("arms", f"{name}: its joints put back through the forward", "m", nan, nan, away,
                   REACHED_M),
        Comparison("arms", f"{name}: its joints beyond the limits", "rad", nan, nan,
                   float(max(beyond, 0.0)), NEAR)]
