"""Arms from files: what is written is read again, and what is wrong is named."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from warpgrasp.arms.arm_file import (
    SHIPPED_ARMS,
    arm_from_file,
    arm_named,
    arm_text,
    check_arm,
)
from warpgrasp.arms.arm_model import ArmError, ArmModel
from warpgrasp.arms.serial_arm import flange_poses
from warpgrasp.arms.urdf_arm import arm_from_urdf
from warpgrasp.export.robot_tree import arm_hand_tree
from warpgrasp.export.urdf import urdf_text
from warpgrasp.hands.hand_model import HandError
from warpgrasp.parameters import ArmTable, HandTable, PadTable


@pytest.mark.parametrize("name", SHIPPED_ARMS)
def test_a_written_arm_is_read_again(name: str, tmp_path: Path) -> None:
    model = arm_named(name)
    file = tmp_path / "arm.toml"
    file.write_text(arm_text(model))
    again = arm_from_file(file)
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, len(model.joints)))
    np.testing.assert_allclose(flange_poses(again, q), flange_poses(model, q), atol=1e-9)
    assert [joint.name for joint in again.joints] == [joint.name for joint in model.joints]


@pytest.mark.parametrize("name", SHIPPED_ARMS)
def test_an_exported_arm_is_read_from_its_urdf(name: str, tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    model = arm_named(name)
    text, _ = urdf_text(arm_hand_tree(ArmTable(kind=name), HandTable(), PadTable()), (),
                        name=name, mesh_stem="none")
    file = tmp_path / "arm.urdf"
    file.write_text(text)
    whole, _ = arm_from_urdf(file, flange="flange")
    found, _ = arm_from_urdf(file, flange=f"arm{len(model.joints)}")
    still = replace(model, flange_xyz_m=(0.0, 0.0, 0.0), flange_rpy_rad=(0.0, 0.0, 0.0))
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, len(model.joints)))
    np.testing.assert_allclose(flange_poses(found, q)[:, :3], flange_poses(still, q)[:, :3],
                               atol=1e-6)
    np.testing.assert_allclose(flange_poses(whole, q)[:, :3], flange_poses(model, q)[:, :3],
                               atol=1e-6)
    assert [j.speed_rad_s for j in whole.joints] == pytest.approx(
        [j.speed_rad_s for j in model.joints])


def chain(joints: int) -> str:
    links = "".join(f'<link name="l{n}"/>' for n in range(joints + 1))
    turning = "".join(
        f'<joint name="j{n}" type="revolute"><parent link="l{n}"/><child link="l{n + 1}"/>'
        f'<origin xyz="0 0 0.1" rpy="{n % 2 * 1.5} 0 0"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="2" effort="1" velocity="1"/></joint>' for n in range(joints))
    return f'<robot name="r">{links}{turning}</robot>'


def test_the_only_chain_of_six_or_seven_joints_is_the_arm(tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    file = tmp_path / "arm.urdf"
    file.write_text(chain(7))
    model, notes = arm_from_urdf(file)
    assert len(model.joints) == 7
    assert model.home_rad == pytest.approx([0.5] * 7)
    assert any("home" in note for note in notes)
    assert notes[0] == ("link l7 carries the hand, the last of the only chain of 6 or 7 joints; "
                        "--flange names another link")
    file.write_text(chain(6).replace("</robot>", '<link name="tool0"/><joint name="t" type="fixed">'
                                     '<parent link="l6"/><child link="tool0"/></joint></robot>'))
    assert "link l6 carries the hand" in arm_from_urdf(file)[1][0]
    assert "; tool0 beyond it left out; --flange" in arm_from_urdf(file)[1][0]
    for joints in (5, 8):
        file.write_text(chain(joints))
        with pytest.raises(ArmError, match="should"):
            arm_from_urdf(file, flange=f"l{joints}")
    with pytest.raises(ArmError, match="no link 'hand'"):
        arm_from_urdf(file, flange="hand")
    file.write_text("<robot")
    with pytest.raises(HandError, match="is not XML"):
        arm_from_urdf(file)


@pytest.mark.parametrize(("old", "new", "message"), [
    ("limits_deg = [-180.0, 180.0]", "limits_deg = [180.0, -180.0]", "the first should be less"),
    ("speed_deg_s = 180.0", "speed_deg_s = 0.0", "should be above 0"),
    ("axis = [0.0, 0.0, 1.0]", "", "axis"), ("xyz_mm = [-425.0, 0.0, 0.0]", "", "xyz_mm"),
    ("[flange]", "[unknown]", "flange"),
    ("home_deg = [-20.0, ", "home_deg = [", "should be one for each of the 6 joints"),
    ("home_deg = [-20.0, ", "home_deg = [400.0, ", "is not within its limits"),
    ("xyz_mm = [-425.0, 0.0, 0.0]", "xyz_mm = [-42500.0, 0.0, 0.0]",
     "joint elbow stands 42.5 m (42,500 mm) from what is before it; should be at most 5 m"),
    ("xyz_mm = [-425.0, 0.0, 0.0]", "xyz_mm = [nan, 0.0, 0.0]", "joint elbow: xyz_mm[0]"),
    ('name = "elbow"', 'name = "wrist_1"', "names should differ"),
    ("axis = [0.0, 0.0, 1.0]", "axis = [0, 0, 0]", "should be a direction"),
    ('name = "elbow"', 'name = "elbow"\nlenght = 3', "joint elbow: lenght"),
    ("[flange]", "[flange", "is not valid TOML"),
    ("speed_deg_s = 180.0", "speed_deg_s = 10313.0", "speed 1.031e+04 deg/s (180 rad/s); should"),
    ("limits_deg = [-180.0, 180.0]", "limits_deg = [-180.0, 5157.0]",
     "limits -180 to 5157 deg (-3.142 to 90.01 rad); should be at most 720 deg either way"),
])
def test_what_is_wrong_is_named(old: str, new: str, message: str, tmp_path: Path) -> None:
    text = arm_text(arm_named("ur5e")).replace("-0,", "0.0,")
    text = re.sub(r"(?<=[ \[])(-?\d+)(?=[,\]])", r"\1.0", text)
    text = re.sub(r"speed_deg_s = 180$", "speed_deg_s = 180.0", text, flags=re.MULTILINE)
    assert old in text
    file = tmp_path / "arm.toml"
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(ArmError, match=re.escape(message)) as error:
        arm_from_file(file)
    assert str(file) in str(error.value)


@pytest.mark.parametrize(("key", "by", "message"), [
    ("xyz_mm", 1000.0, "the ways from joint to joint are 1.213 mm together; should be 100 mm"),
    ("limits_deg", 60.0, "the one with the widest limits turns by 12 deg; should be 12.6 at"),
])
def test_metres_and_radians_are_told(key: str, by: float, message: str, tmp_path: Path) -> None:
    file = tmp_path / "arm.toml"
    text = re.sub(r"^home_deg = .*", "home_deg = [0, 0, 0, 0, 0, 0]", arm_text(arm_named("ur5e")),
                  flags=re.MULTILINE)
    file.write_text(re.sub(rf"^{key} = (.*)", lambda found: f"{key} = " + re.sub(
        r"-?[\d.]+", lambda v: repr(float(v[0]) / by), found[1]), text, flags=re.MULTILINE))
    with pytest.raises(ArmError, match=re.escape(message)):
        arm_from_file(file)


def fixed(child: str, origin: str) -> str:
    return (f'<link name="{child}"/><joint name="to_{child}" type="fixed"><parent link="l6"/>'
            f'<child link="{child}"/><origin {origin}/></joint></robot>')


@pytest.mark.parametrize(("last", "beyond", "carries", "out"), [
    ('rpy="1.5 0 0"/><axis xyz="0 1 0"/>', fixed("tool0", 'xyz="0 0.08 0" rpy="-1.5707963 0 0"'),
     "tool0", (0, 1, 0)),
    ('rpy="1.5 0 0"/><axis xyz="0 0 1"/>', fixed("ee", 'xyz="0 0 -0.06" rpy="3.1415927 0 0"'),
     "ee", (0, 0, -1)),
    ('rpy="0 1.5707963 0"/><axis xyz="1 0 0"/>', "</robot>", "l6", (-1, 0, 0)),
    ('rpy="1.5 0 0"/><axis xyz="0 0 1"/>', fixed("tip", 'xyz="0 0 0.2"'), "l6", (0, 0, 1)),
    ('rpy="0 0 0"/><axis xyz="0 0 1"/>', fixed("camera", 'xyz="0.04 0 0.05"'), "l6", (0, 0, 1)),
])
def test_a_hand_looks_out_of_the_arm_along_its_last_joint(
        last: str, beyond: str, carries: str, out: tuple[int, ...], tmp_path: Path) -> None:
    """Flanges on the axis of the last joint: beside the link, behind it, a link that looks across;
    a tool's tip and a camera are none."""
    pytest.importorskip("yourdfpy")
    file = tmp_path / "arm.urdf"
    before = chain(6).rpartition('rpy="1.5 0 0"/><axis xyz="0 0 1"/>')
    file.write_text((before[0] + last + before[2]).replace("</robot>", beyond))
    model, notes = arm_from_urdf(file)
    assert notes[0].startswith(f"link {carries} carries the hand")
    assert ("turned" in notes[0]) == (out == (-1, 0, 0))
    looks = Rotation.from_euler("xyz", model.flange_rpy_rad).as_matrix()[:, 2]
    assert looks == pytest.approx(out, abs=1e-6)


def test_speeds_in_radians_are_told() -> None:
    model = arm_named("ur5e")
    slow = tuple(replace(j, speed_rad_s=np.radians(j.speed_rad_s)) for j in model.joints)
    with pytest.raises(ArmError, match=r"the fastest turns by 3\.142 deg/s; should be 6\.3"):
        check_arm("mine", replace(model, joints=slow))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ArmError, match=r"none\.toml: cannot be read"):
        arm_from_file(tmp_path / "none.toml")
    with pytest.raises(ArmError, match="should be one of ur5e, panda"):
        arm_named("ur6")


def test_a_file_nested_without_end_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "arm.toml"
    file.write_text("x = " + "[" * 100_000)
    with pytest.raises(ArmError, match="is not valid TOML"):
        arm_from_file(file)


def test_only_the_way_to_the_flange_must_turn(tmp_path: Path) -> None:
    """A gripper with a finger that slides, beyond the flange; then a rail before the arm."""
    pytest.importorskip("yourdfpy")
    file = tmp_path / "arm.urdf"
    slide = ('<link name="finger"/><joint name="slide" type="prismatic"><parent link="{}"/><child '
             'link="{}"/><axis xyz="0 1 0"/><limit lower="0" upper="0.04" effort="1" '
             'velocity="1"/></joint></robot>')
    file.write_text(chain(7).replace("</robot>", slide.format("l7", "finger")))
    for flange in (None, "l7"):
        assert len(arm_from_urdf(file, flange=flange)[0].joints) == 7
    file.write_text(chain(7).replace("</robot>", slide.format("finger", "l0")))
    with pytest.raises(ArmError, match="joint slide: is prismatic; joints of an arm, before link"):
        arm_from_urdf(file)


@pytest.mark.parametrize(("old", "new", "message"), [
    ('lower="-1" upper="2"', 'lower="-inf" upper="inf"',
     "joint j0: limits from -inf to inf rad; should be finite, or the joint continuous"),
    ('velocity="1"', 'velocity="nan"', "joint j0: limit velocity is nan; should be a finite"),
    ('velocity="1"', 'velocity="inf"', "joint j0: limit velocity is inf; should be a finite"),
])
def test_a_limit_that_is_not_finite_is_named(old: str, new: str, message: str,
                                             tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    file = tmp_path / "arm.urdf"
    file.write_text(chain(7).replace(old, new, 1))
    with pytest.raises(ArmError, match=re.escape(message)):
        arm_from_urdf(file)


def test_a_model_of_an_arm_is_finite() -> None:
    model = arm_named("panda")
    for changed in ({"speed_rad_s": np.nan}, {"high_rad": np.inf}, {"rpy_rad": (np.nan, 0.0, 0.0)}):
        joints = (replace(model.joints[0], **changed), *model.joints[1:])
        with pytest.raises(ArmError, match=r"mine: joint .*: a number that is not finite"):
            check_arm("mine", replace(model, joints=joints))
    with pytest.raises(ArmError, match="mine: base or flange: a number that is not finite"):
        check_arm("mine", replace(model, flange_xyz_m=(np.nan, 0.0, 0.0)))


@pytest.mark.filterwarnings("error::UserWarning")
@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2, 0.3])
def test_a_link_that_stands_straight_up_is_read_without_a_warning(pitch: float,
                                                                 tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    file = tmp_path / "arm.urdf"
    file.write_text(chain(6).replace('rpy="1.5 0 0"', f'rpy="0.4 {pitch!r} -0.7"', 1))
    found = arm_from_urdf(file, flange="l6")[0].joints[1].rpy_rad
    turns = Rotation.from_euler("xyz", [found, (0.4, pitch, -0.7)]).as_matrix()
    assert turns[0] == pytest.approx(turns[1], abs=1e-9)


def test_home_is_in_the_middle_of_the_limits_or_of_more_than_a_turn_near_zero(
        tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    for upper, home in ((2.0, 0.5), (6.0, 0.0)):
        (tmp_path / "arm.urdf").write_text(chain(6).replace('upper="2"', f'upper="{upper}"'))
        assert arm_from_urdf(tmp_path / "arm.urdf")[0].home_rad == pytest.approx([home] * 6)


def test_an_axis_is_a_direction_of_any_length() -> None:
    model = arm_named("ur5e")
    axis = np.array([0.6, 0.48, 0.64])

    def turned(factor: float) -> ArmModel:
        x, y, z = (factor * axis).tolist()
        return check_arm("a", replace(model, joints=tuple(
            replace(joint, axis=(x, y, z)) for joint in model.joints)))

    for joint, other in zip(turned(1.0).joints, turned(3.0).joints, strict=True):
        assert other.axis == pytest.approx(joint.axis)
        assert other.axis == pytest.approx(tuple(axis))
