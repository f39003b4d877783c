"""Arms of robots that have more than an arm: a torso, a gripper, a hand and its wrist."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from warpgrasp.arms.arm_model import ArmError, ArmModel
from warpgrasp.arms.serial_arm import flange_poses
from warpgrasp.arms.urdf_arm import arm_from_urdf
from warpgrasp.hands.hand_file import hand_named
from warpgrasp.parameters import HandTable

pytest.importorskip("yourdfpy")
Branch = tuple[str, str, str]
"""A joint's name, its parent and its kind; it moves the link called after it."""
TORSO: Branch = ("lift", "base", "prismatic")


def arm(parent: str = "base", joints: int = 6, side: str = "") -> list[Branch]:
    """Joints in a row."""
    names = [f"{side}j{n}" for n in range(joints)]
    return [(name, f"{before}_link" if n else before, "revolute")
            for n, (name, before) in enumerate(zip(names, [parent, *names], strict=False))]


def written(file: Path, joints: Sequence[Branch]) -> Path:
    rng = np.random.default_rng(0)

    def numbers(low: float, high: float, size: float | None = None) -> str:
        found = rng.uniform(low, high, 3)
        return " ".join(map(str, found if size is None else found * size / np.linalg.norm(found)))

    text = "".join(
        f'<link name="{name}_link"/><joint name="{name}" type="{kind}">'
        f'<parent link="{parent}"/><child link="{name}_link"/>'
        f'<origin xyz="{numbers(0.02, 0.2)}" rpy="{numbers(-1.5, 1.5)}"/>'
        f'<axis xyz="{numbers(0.1, 1.0, 1.0)}"/>'
        '<limit lower="-1" upper="2" effort="1" velocity="1"/></joint>'
        for name, parent, kind in joints)
    file.write_text(f'<robot name="r"><link name="base"/>{text}</robot>')
    return file


def places(file: Path, model: ArmModel, link: str, held: dict[str, float], q: np.ndarray
           ) -> np.ndarray:
    """Where yourdfpy has a link (row, 4, 4)."""
    from yourdfpy import URDF

    robot = URDF.load(str(file), load_meshes=False, build_scene_graph=True)
    found = []
    for row in q:
        robot.update_cfg(held | dict(zip([joint.name for joint in model.joints], row, strict=True)))
        found.append(robot.get_transform(link, "base"))
    return np.array(found)


def matrices(poses: np.ndarray) -> np.ndarray:
    found = np.tile(np.eye(4), (len(poses), 1, 1))
    found[:, :3, 3], found[:, :3, :3] = poses[:, :3], Rotation.from_quat(poses[:, 3:]).as_matrix()
    return found


@pytest.mark.parametrize(("joints", "flange", "count"), [
    ([*arm(), ("gripper_joint", "j5_link", "revolute")], "j5_link", 6),
    ([*arm(), ("wrist", "j5_link", "revolute"), ("left_finger", "wrist_link", "revolute"),
      ("right_finger", "wrist_link", "revolute")], "wrist_link", 7),
    ([*arm(), ("left_finger", "j5_link", "revolute"), ("right_finger", "j5_link", "revolute")],
     "j5_link", 6),
    ([*arm(joints=7), *arm("j6_link", 4, "a"), *arm("j6_link", 4, "b"), *arm("j6_link", 2, "c")],
     "j6_link", 7),
    ([*arm(), *arm("j5_link", 1, "a"), *arm("j5_link", 3, "b")], "j5_link", 6),
])
def test_what_an_arm_carries_is_not_of_the_arm(joints: list[Branch], flange: str, count: int,
                                               tmp_path: Path) -> None:
    """A gripper of one joint, one with a wrist and two fingers, one without, hands of three and of
    two fingers."""
    model, notes = arm_from_urdf(written(tmp_path / "robot.urdf", joints))
    assert len(model.joints) == count
    assert notes[0].startswith(f"link {flange} carries the hand")


@pytest.mark.parametrize(("joints", "message"), [
    (arm(joints=5), "no chain of 6 or 7 joints"),
    ([*arm(joints=5), ("jaw", "j4_link", "revolute")], "no chain of 6 or 7 joints"),
    ([*arm(joints=8), *arm("j7_link", 3, "a"), *arm("j7_link", 3, "b")],
     "8 joints lead to all that move beyond them (j0, j1, j2, j3, j4, j5, j6, j7); should be 6 or"),
    ([*arm(side="l"), *arm(side="r")], "several chains (lj5_link, rj5_link)"),
    ([TORSO, *arm("lift_link")], "joint lift: is prismatic; joints of an arm, before link j5_link"),
])
def test_what_is_no_arm_is_refused(joints: list[Branch], message: str, tmp_path: Path) -> None:
    """Too few joints, also with a jaw; a hand's wrist counted; two arms; a torso that slides."""
    with pytest.raises(ArmError) as error:
        arm_from_urdf(written(tmp_path / "robot.urdf", joints))
    assert message in str(error.value)
    assert "--flange" in str(error.value) or "--hold" in str(error.value)


def test_held_joints_stand_where_they_are_held(tmp_path: Path) -> None:
    """A torso that slides, one that turns, and a wrist beyond the arm's joints."""
    file = written(tmp_path / "robot.urdf", [
        TORSO, ("waist", "lift_link", "revolute"), *arm("waist_link"),
        ("wrist", "j5_link", "revolute"), *arm("wrist_link", 3, "a"), *arm("wrist_link", 3, "b")])
    held = {"lift": 0.35, "waist": 0.5, "wrist": -0.25}
    given = {"lift": 350.0, "waist": np.degrees(0.5), "wrist": np.degrees(-0.25)}
    model, _ = arm_from_urdf(file, flange="wrist_link", held_deg_mm=given)
    assert len(model.joints) == 6
    q = np.random.default_rng(1).uniform(-1.0, 2.0, (20, 6))
    np.testing.assert_allclose(matrices(flange_poses(model, q)),
                               places(file, model, "wrist_link", held, q), atol=1e-9)
    for name, at, message in (("lift", 2500.0, "joint lift at 2500 mm; should be -1000 to 2000"),
                              ("waist", -90.0, "joint waist at -90 deg; should be -57.3 to 114.6"),
                              ("torso", 0.0, "no joint 'torso' turns or slides; should be"),
                              ("aj1", 0.0, "joint aj1 is not before link wrist_link, which")):
        with pytest.raises(ArmError) as error:
            arm_from_urdf(file, flange="wrist_link", held_deg_mm=given | {name: at})
        assert message in str(error.value)


def test_a_slider_without_an_axis_beyond_the_flange_is_nobodys_matter(tmp_path: Path) -> None:
    file = written(tmp_path / "robot.urdf", [*arm(), ("jaw", "j5_link", "prismatic")])
    before, after = file.read_text().rsplit("<axis", 1)
    file.write_text(before + '<axis xyz="0 0 0"/>' + after.split("/>", 1)[1])
    assert len(arm_from_urdf(file)[0].joints) == 6


def test_a_hand_of_the_same_robot_is_carried_as_the_robot_does(tmp_path: Path) -> None:
    """The grasp frame of an episode's hand, `mount_length` ahead of the flange, is the grasp frame
    of the hand whose palm is the link."""
    file = written(tmp_path / "robot.urdf", [*arm(), *arm("j5_link", 3, "a"),
                                             *arm("j5_link", 3, "b")])
    hand = hand_named("leap")
    model, notes = arm_from_urdf(file, hand=hand)
    assert any("100 mm (hand.mount_length_mm) behind" in note for note in notes)
    q = np.random.default_rng(2).uniform(-1.0, 2.0, (20, 6))
    ahead = np.eye(4)
    ahead[2, 3] = HandTable().mount_length_m
    wanted = places(file, model, "j5_link", {}, q) @ matrices(np.array([hand.grasp_frame]))[0]
    np.testing.assert_allclose(matrices(flange_poses(model, q)) @ ahead, wanted, atol=1e-9)
