"""Any hand as MJCF and URDF: what other readers make of the files stands where the model says."""

import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from chains import random_angles
from scipy.spatial.transform import Rotation

from sweeps.cli import main as cli
from warpgrasp.export.mjcf import mjcf_text
from warpgrasp.export.model_tree import arm_model_tree, hand_model_tree
from warpgrasp.export.urdf import urdf_text
from warpgrasp.hands.capsule_fit import fit_shape
from warpgrasp.hands.hand_file import SHIPPED, hand_named
from warpgrasp.hands.hand_frames import driven_angles, finger_tips, matrix_of
from warpgrasp.hands.hand_model import Box, Capsule, Follow, HandModel
from warpgrasp.hands.touch_shapes import touch_model
from warpgrasp.hands.urdf_hand import FRAMED, hand_from_urdf
from warpgrasp.parameters import ArmTable

NEAR = 1e-9


def following(model: HandModel) -> HandModel:
    """The hand with the last joint of its first finger following the one before."""
    first = model.fingers[0]
    last = replace(first.joints[-1], follows=Follow(first.joints[-2].name, 0.7, 0.1))
    finger = replace(first, joints=(*first.joints[:-1], last))
    return replace(model, fingers=(finger, *model.fingers[1:]), postures=(), closings=())


def tips_in_grasp_frame(model: HandModel, q: np.ndarray) -> np.ndarray:
    to_grasp = np.linalg.inv(matrix_of(model.grasp_frame))
    return finger_tips(model, q) @ to_grasp[:3, :3].T + to_grasp[:3, 3]


def test_a_cube_touches_as_a_ball_however_it_is_turned() -> None:
    """A capsule whose ends differ by rounding is one that MuJoCo refuses."""
    turns = Rotation.random(50, rng=0).as_quat()
    cubes = tuple(Box((0.01, 0.02, 0.03, *turn), (0.04,) * 3) for turn in turns)
    touching = touch_model(replace(hand_named("barrett"), palm=cubes))
    assert all(ball.start == ball.end for ball in touching.palm)
    assert np.array([ball.start for ball in touching.palm]) == pytest.approx(
        np.tile([0.01, 0.02, 0.03], (50, 1)))
    assert [ball.radius for ball in touching.palm] == pytest.approx([0.02] * 50)


@pytest.mark.parametrize("name", SHIPPED)
def test_mujoco_puts_tips_where_we_do(name: str) -> None:
    mujoco = pytest.importorskip("mujoco")
    model = following(hand_named(name))
    engine = mujoco.MjModel.from_xml_string(mjcf_text(hand_model_tree(model), table=False))
    assert (engine.nu, engine.neq) == (len(model.driven), 1)
    data = mujoco.MjData(engine)
    q = random_angles(model, 100)
    wanted, angles = tips_in_grasp_frame(model, q), driven_angles(model, q)
    at = [engine.joint(joint.name).qposadr[0] for joint in model.joints]
    for k in range(len(q)):
        data.qpos[at] = angles[k]
        mujoco.mj_kinematics(engine, data)
        tips = np.array([data.body(f"{finger.name}_tip").xpos for finger in model.fingers])
        assert np.abs(tips - wanted[k]).max() < NEAR
    shapes = len(model.palm) + sum(len(joint.shapes) for joint in model.joints)
    marks = sum(not joint.shapes for joint in model.joints)
    assert engine.ngeom == shapes + marks
    for joint in model.driven:
        servo = engine.actuator(joint.name)
        assert servo.gainprm[0] == joint.stiffness_Nm_rad
        assert np.allclose(engine.joint(joint.name).range, [joint.low_rad, joint.high_rad])
        if joint.effort_Nm:
            assert servo.forcerange[1] == joint.effort_Nm


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_capsule_as_good_as_a_ball_is_written_as_one(tmp_path: Path) -> None:
    """A mesh of a fine ball was fitted by a capsule of a micrometre, which no reader took."""
    mujoco = pytest.importorskip("mujoco")
    pytest.importorskip("yourdfpy")
    points = trimesh.creation.icosphere(subdivisions=4, radius=0.01).vertices + 0.02
    fitted = fit_shape(points)
    assert isinstance(fitted, Capsule)
    assert fitted.start == fitted.end == pytest.approx((0.02, 0.02, 0.02), abs=1e-5)
    tiny = tuple(Capsule((0.0, 0.0, z), (0.0, 0.0, z + length), 0.01)
                 for z, length in ((0.0, 1e-10), (0.02, 9e-7)))
    links = hand_model_tree(replace(hand_named("barrett"), palm=tiny))
    engine = mujoco.MjModel.from_xml_string(mjcf_text(links, table=False))
    palm = engine.geom_type[engine.geom_bodyid == engine.body("palm").id]
    assert (palm == mujoco.mjtGeom.mjGEOM_SPHERE).all()
    file = tmp_path / "hand.urdf"
    file.write_text(urdf_text(links)[0])
    assert len(hand_from_urdf(file)[0].palm) == 2


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
@pytest.mark.parametrize("name", [
    pytest.param(name, marks=() if name == "barrett" else pytest.mark.slow) for name in SHIPPED])
def test_our_urdf_is_read_as_the_same_hand(name: str, tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    model = following(hand_named(name))
    file = tmp_path / "hand.urdf"
    file.write_text(urdf_text(hand_model_tree(model))[0])
    again, notes = hand_from_urdf(file)
    q = random_angles(model, 50)
    assert [j.name for j in again.driven] == [j.name for j in model.driven]
    assert np.abs(finger_tips(again, q) - tips_in_grasp_frame(model, q)).max() < NEAR
    # The root is the grasp frame, which a link says; efforts that are not known remain so.
    assert FRAMED in notes
    assert np.abs(matrix_of(again.grasp_frame) - np.eye(4)).max() < NEAR
    assert [j.effort_Nm for j in again.joints] == [j.effort_Nm for j in model.joints]
    assert not any("stands for" in note for note in notes)
    for mine, theirs in zip(model.joints, again.joints, strict=True):
        kept = [[s for s in j.shapes if isinstance(s, Capsule)] for j in (mine, theirs)]
        ends = [[(*c.start, *c.end, c.radius) for c in capsules] for capsules in kept]
        assert np.allclose(*ends, atol=NEAR)
        assert len(mine.shapes) == len(theirs.shapes)
    inertia = [float(i.attrib[k]) for i in ET.fromstring(file.read_text()).iter("inertia")
               for k in ("ixx", "iyy", "izz")]
    assert np.min(inertia) > 0.0


def test_a_box_weighs_what_it_does() -> None:
    """MuJoCo's own mass and inertia of the same shapes."""
    mujoco = pytest.importorskip("mujoco")
    links = hand_model_tree(hand_named("leap"))
    theirs = mujoco.MjModel.from_xml_string(mjcf_text(links))
    mine = mujoco.MjModel.from_xml_string(urdf_text(links)[0].replace(
        "</robot>", '<mujoco><compiler fusestatic="false" discardvisual="true"/></mujoco></robot>'))
    for link in links:
        if link.boxes and not link.capsules:
            assert np.isclose(mine.body(link.name).mass, theirs.body(link.name).mass).all()
            mine_i, theirs_i = (np.sort(m.body(link.name).inertia) for m in (mine, theirs))
            assert np.allclose(mine_i, theirs_i, rtol=1e-6)


def test_the_arm_carries_any_hand() -> None:
    mujoco = pytest.importorskip("mujoco")
    model = hand_named("allegro")
    engine = mujoco.MjModel.from_xml_string(mjcf_text(arm_model_tree(ArmTable(), model, 0.1)))
    assert engine.nu == 6 + len(model.driven)


@pytest.mark.parametrize("kind", ["puma560", "panda"])
def test_a_hand_may_call_its_joints_as_the_arm_does(kind: str) -> None:
    model = hand_named("allegro")
    first = model.fingers[0]
    clashing = (replace(first.joints[0], name="arm_joint1"), *first.joints[1:])
    model = replace(model, fingers=(replace(first, joints=clashing), *model.fingers[1:]))
    links = arm_model_tree(ArmTable(kind=kind), model, 0.1)
    names = [link.joint.name for link in links if link.joint is not None]
    assert len(set(names)) == len(names)
    assert names[:2] == ["carrying_arm_joint1", "arm_joint2"]
    plain = arm_model_tree(ArmTable(kind=kind), hand_named("allegro"), 0.1)
    assert next(link.joint.name for link in plain if link.joint is not None) == "arm_joint1"


def test_the_command_exports_every_hand(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for word in ("leap", "barrett"):
        file = tmp_path / f"{word}.xml"
        assert cli.run(["export", str(file), "--hand", word, "--object", "block"]) == 0
        assert f'model="{word}"' in file.read_text()
    assert cli.run(["export", str(tmp_path / "x.urdf"), "--units", "mm"]) == 2
    assert "--units: says how large a mesh is" in capsys.readouterr().err
    assert cli.run(["export", str(tmp_path / "x.xml"), "--hand", "no_hand"]) == 2
    assert "should be one of utah_mit" in capsys.readouterr().err
