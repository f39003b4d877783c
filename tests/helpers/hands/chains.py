"""Hands of random chains as URDF text, and link poses by other readers."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.hands.hand_frames import driven_angles
from warpgrasp.hands.hand_model import HandModel


def random_urdf(seed: int) -> str:
    """Two to five fingers of one to six joints with any axes, fixed links between, followers."""
    rng = np.random.default_rng(seed)
    lines = ['<robot name="random">', _link("root"), _link("palm"),
             _joint("weld", "fixed", "root", "palm", rng)]
    for f in range(rng.integers(2, 6)):
        above = "palm"
        for j in range(rng.integers(1, 7)):
            if rng.random() < 0.4:
                lines += [_link(f"f{f}_{j}_fixed"),
                          _joint(f"f{f}_{j}_weld", "fixed", above, f"f{f}_{j}_fixed", rng)]
                above = f"f{f}_{j}_fixed"
            name = f"f{f}_{j}"
            follows = f"f{f}_0" if j > 0 and rng.random() < 0.3 else ""
            kind = "continuous" if rng.random() < 0.2 else "revolute"
            lines += [_link(name), _joint(f"{name}_joint", kind, above, name, rng,
                                          f"{follows}_joint" if follows else "")]
            above = name
    return "\n".join([*lines, "</robot>"])


def _link(name: str) -> str:
    return (f'<link name="{name}"><collision><origin xyz="0.01 0 0.02" rpy="0.1 0.2 0.3"/>'
            '<geometry><box size="0.01 0.02 0.03"/></geometry></collision></link>')


def _joint(name: str, kind: str, parent: str, child: str, rng: np.random.Generator,
           follows: str = "") -> str:
    def three(values: np.ndarray) -> str:
        return " ".join(repr(float(v)) for v in values)

    low = rng.uniform(-2.0, 0.0)
    mimic = (f'<mimic joint="{follows}" multiplier="{rng.uniform(-1.5, 1.5)!r}" '
             f'offset="{rng.uniform(-0.3, 0.3)!r}"/>' if follows else "")
    return (f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{three(rng.uniform(-0.05, 0.05, 3))}" '
            f'rpy="{three(rng.uniform(-3, 3, 3))}"/><axis xyz="{three(rng.normal(size=3))}"/>'
            f'<limit lower="{low!r}" upper="{low + rng.uniform(0.5, 2.5)!r}" effort="1" '
            f'velocity="1"/>{mimic}</joint>')


def random_angles(model: HandModel, count: int, seed: int = 0) -> np.ndarray:
    """Configurations within the limits, (count, driven) [rad]."""
    rng = np.random.default_rng(seed)
    return rng.uniform([j.low_rad for j in model.driven], [j.high_rad for j in model.driven],
                       (count, len(model.driven)))


def mujoco_frames(file: Path, model: HandModel, q: np.ndarray) -> np.ndarray:
    """Frames of all links that joints move, (pose, joint, 4, 4), by MuJoCo from the URDF itself."""
    import mujoco

    root = ET.parse(file).getroot()
    child = {j.get("name"): j.find("child").get("link")  # type: ignore[union-attr]
             for j in root.findall("joint")}
    for link in root.findall("link"):
        for part in (*link.findall("visual"), *link.findall("collision"),
                     *link.findall("inertial")):
            link.remove(part)
        link.append(ET.fromstring(
            '<inertial><mass value="0.1"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" '
            'izz="1e-4"/></inertial>'))
    root.append(ET.fromstring('<mujoco><compiler fusestatic="false"/></mujoco>'))
    text = re.sub("<mimic[^>]*/>", "", ET.tostring(root, encoding="unicode"))
    engine = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(engine)
    at = [engine.joint(joint.name).qposadr[0] for joint in model.joints]
    frames = np.tile(np.eye(4), (len(q), len(at), 1, 1))
    for k, angles in enumerate(driven_angles(model, q)):
        data.qpos[:] = 0.0
        data.qpos[at] = angles
        mujoco.mj_kinematics(engine, data)
        for n, joint in enumerate(model.joints):
            body = data.body(child[joint.name])
            frames[k, n, :3, :3], frames[k, n, :3, 3] = body.xmat.reshape(3, 3), body.xpos
    return frames


def yourdfpy_frames(file: Path, model: HandModel, q: np.ndarray) -> np.ndarray:
    """The same by yourdfpy, which follows mimic joints itself."""
    from yourdfpy import URDF

    robot = URDF.load(str(file), load_meshes=False, build_scene_graph=True)
    frames = np.empty((len(q), len(model.joints), 4, 4))
    for k, angles in enumerate(q):
        robot.update_cfg({j.name: a for j, a in zip(model.driven, angles, strict=True)})
        for n, joint in enumerate(model.joints):
            frames[k, n] = robot.get_transform(robot.joint_map[joint.name].child)
    return frames


def as_matrices(places: np.ndarray) -> np.ndarray:
    """Places (..., 7) as (..., 4, 4)."""
    matrices = np.zeros((*places.shape[:-1], 4, 4))
    flat = places.reshape(-1, 7)
    matrices[..., :3, :3] = Rotation.from_quat(flat[:, 3:]).as_matrix().reshape(
        *places.shape[:-1], 3, 3)
    matrices[..., :3, 3], matrices[..., 3, 3] = places[..., :3], 1.0
    return matrices
