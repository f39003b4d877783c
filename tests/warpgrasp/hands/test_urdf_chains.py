"""Which joints of a URDF move, which follow, which stand still and where."""

import re
from math import degrees
from pathlib import Path

import numpy as np
import pytest
from chains import random_angles
from urdf_parts import joint, link, robot

from sweeps.cli import main as cli
from warpgrasp.chain.chain_hand import chain_of, drive_angles, joint_drive, link_frames_of
from warpgrasp.hands.hand_file import hand_from_file
from warpgrasp.hands.hand_frames import (
    driven_angles,
    finger_tips,
    link_frames,
    matrix_of,
    posture_angles,
)
from warpgrasp.hands.hand_writer import hand_text
from warpgrasp.hands.urdf_hand import hand_from_urdf

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # yourdfpy's own
LIMIT = '<limit lower="{}" upper="{}" effort="1" velocity="1"/>'


def test_rows_of_followers_lead_to_the_driven_joint(tmp_path: Path) -> None:
    """j3 follows j2, which follows j1."""
    pytest.importorskip("yourdfpy")
    names = ["palm", "a", "b", "c"]
    file = tmp_path / "hand.urdf"
    file.write_text(robot([
        *map(link, names), joint("j1", "palm", "a"),
        joint("j2", "a", "b", more='<mimic joint="j1" multiplier="0.5" offset="0.1"/>'),
        joint("j3", "b", "c", more='<mimic joint="j2" multiplier="2" offset="-0.3"/>')
    ]))
    model, _ = hand_from_urdf(file)
    assert [j.name for j in model.driven] == ["j1"]
    q = random_angles(model, 3)
    assert np.allclose(driven_angles(model, q), np.hstack([q, 0.5 * q + 0.1, q - 0.1]))


def test_what_is_for_other_programs_is_not_read(tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    file = tmp_path / "hand.urdf"
    others = ('<gazebo><sensor name=""><geometry><plane/></geometry></sensor></gazebo>'
              '<self_collision_checking><geometry><capsule radius="1 cm"/></geometry>'
              '</self_collision_checking>')
    file.write_text(robot([link("palm"), link("a").replace("</link>", others + "</link>"),
                           joint("j1", "palm", "a")]))
    model, _ = hand_from_urdf(file)
    assert [j.name for j in model.driven] == ["j1"]


@pytest.mark.parametrize("tip_link", ["a_tip", "a_TipLink", "tipFrame", "tips", "a_tip_link"])
def test_joints_that_move_several_fingers_are_held_and_said(tmp_path: Path, tip_link: str) -> None:
    pytest.importorskip("yourdfpy")
    file = tmp_path / "hand.urdf"
    names = ["arm", "palm", "a", tip_link, "b"]
    tip = joint("weld", "a", tip_link, kind="fixed", limit="")
    file.write_text(robot([
        *map(link, names), joint("wrist", "arm", "palm"), joint("j1", "palm", "a"), tip,
        joint("j2", "palm", "b")]))
    model, notes = hand_from_urdf(file)
    assert [[j.name for j in f.joints] for f in model.fingers] == [["j1"], ["j2"]]
    assert any("wrist moves several fingers: it is held at 0 deg" in note for note in notes)
    assert model.fingers[0].tip_m == (0.0, 0.0, 0.03)  # the link that is called a tip
    alone, notes = hand_from_urdf(file, palm="palm", tips=[tip_link])
    assert [[j.name for j in f.joints] for f in alone.fingers] == [["j1"]]
    assert any("j2 is in no finger" in note for note in notes)


@pytest.mark.parametrize(("held", "first", "second"), [
    ({}, 0.2, 0.2), ({"w1": 0.6}, 0.6, 0.4), ({"w1": 0.6, "w2": 0.1}, 0.6, 0.1)])
def test_a_joint_that_follows_one_that_is_held_is_held_where_that_one_leads_it(
    held: dict[str, float], first: float, second: float, tmp_path: Path,
) -> None:
    """Two of a wrist, of limits 0.2 to 1: the second follows the first at half its angle and 0.1.
    """
    pytest.importorskip("yourdfpy")
    file = tmp_path / "hand.urdf"
    names = ["arm", "wrist", "palm", "a", "b"]
    file.write_text(robot([
        *map(link, names), joint("w1", "arm", "wrist", limit=LIMIT.format(0.2, 1)),
        joint("w2", "wrist", "palm", more='<mimic joint="w1" multiplier="0.5" offset="0.1"/>'),
        joint("j1", "palm", "a", at="0.1 0 0.03"), joint("j2", "palm", "b", at="0 0.1 0.03")]))
    model, notes = hand_from_urdf(file, held_rad=held)
    at_rest = np.array([model.fingers[0].joints[0].place[:3]])
    c1, s1 = np.cos(first), np.sin(first)
    c, s = np.cos(first + second), np.sin(first + second)
    base = np.array([0.03 * s1 + 0.1 * c + 0.03 * s, 0.0, 0.03 + 0.03 * c1 - 0.1 * s + 0.03 * c])
    assert at_rest[0] == pytest.approx(base, abs=1e-12)
    if "w2" not in held:
        said = f"w2 moves several fingers: it is held at {degrees(second):.4g} deg, as it follows"
        assert any(said in note for note in notes)


def test_a_follower_of_a_follower_that_is_held_stands_still(tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    file = tmp_path / "hand.urdf"
    file.write_text(robot([
        *map(link, ["palm", "a", "b", "c"]), joint("j1", "palm", "a"),
        joint("j2", "a", "b", more='<mimic joint="j1"/>'),
        joint("j3", "b", "c", more='<mimic joint="j2" multiplier="0.5"/>')]))
    model, notes = hand_from_urdf(file, held_rad={"j2": 0.4})
    assert [j.name for j in model.joints] == ["j1"]
    stands = f"j3 follows j2, which stands still: so does it, at {degrees(0.2):.4g} deg"
    assert any(stands in note for note in notes)
    file.write_text(file.read_text().replace('multiplier="0.5"', 'multiplier="5"'))
    _, notes = hand_from_urdf(file, held_rad={"j2": 0.4})
    assert any(note.endswith("at 114.6 deg, beyond its limits of 0 to 57.3: hold what leads it "
                             "elsewhere") for note in notes)


def test_a_joint_turns_no_follower_beyond_its_limits(tmp_path: Path) -> None:
    """j2 and j3 follow j1, of limits 0 to 1.5, at twice its angle and against it; joints without
    limits of their own bind none, nor those of limits that are not filled in."""
    pytest.importorskip("yourdfpy")
    file = tmp_path / "hand.urdf"
    file.write_text(robot([
        *map(link, ["palm", "a", "b", "c", "d", "e"]),
        joint("j1", "palm", "a", limit=LIMIT.format(0, 1.5)),
        joint("j2", "a", "b", limit=LIMIT.format(0, 1.5),
              more='<mimic joint="j1" multiplier="2"/>'),
        joint("j3", "b", "c", limit=LIMIT.format(-2, -0.1),
              more='<mimic joint="j1" multiplier="-1" offset="-0.05"/>'),
        joint("j4", "c", "d", kind="continuous", limit="",
              more='<mimic joint="j1" multiplier="9"/>'),
        joint("j5", "d", "e", limit=LIMIT.format(0, 0), more='<mimic joint="j1"/>')]))
    model, notes = hand_from_urdf(file)
    assert (model.joints[0].low_rad, model.joints[0].high_rad) == pytest.approx((0.05, 0.75))
    assert (model.joints[3].low_rad, model.joints[3].high_rad) == pytest.approx((0.45, 6.75))
    assert any("joint j1 goes from 2.865 to 42.97 deg, as far as" in note for note in notes)
    # A file by hand may say less; but not that a follower is led beyond its limits.
    written = tmp_path / "hand.toml"
    written.write_text(hand_text(model))
    assert len(hand_from_file(written).joints) == 5
    wide = re.sub(r"(limits_deg = \[[^,]*, )42\.97\d*", r"\g<1>60.0", hand_text(model))
    assert wide != hand_text(model)
    written.write_text(wide)
    with pytest.raises(ValueError, match=r"joint j2: j1 leads it from 5.73 to 120 deg, but its "
                                         r"limits are 0 to 85.94; should be as wide, or those of"):
        hand_from_file(written)
    for posture in model.postures:
        angles = driven_angles(model, posture_angles(model, posture))
        assert all(j.low_rad - 1e-9 <= angle <= j.high_rad + 1e-9
                   for j, angle in zip(model.joints[:3], angles[:3], strict=True))


@pytest.mark.parametrize(("factor", "limits"), [(-1, (-1.0, 0.0)), (0, (0.0, 1e-6))])
def test_limits_of_a_follower_that_contradict_its_mimic_do_not_count(
    factor: int, limits: tuple[float, float], tmp_path: Path,
) -> None:
    """As in URDFs of grippers whose joints go from 0 to 1 each, one against the other."""
    pytest.importorskip("yourdfpy")
    file = tmp_path / "hand.urdf"
    file.write_text(robot([
        *map(link, ["palm", "a", "b"]), joint("j1", "palm", "a"),
        joint("j2", "a", "b", limit=LIMIT.format(0 if factor else 0.5, 1),
              more=f'<mimic joint="j1" multiplier="{factor}"/>')]))
    model, notes = hand_from_urdf(file)
    found = [(j.low_rad, j.high_rad) for j in model.joints]
    assert found == [(0.0, 1.0), pytest.approx(limits)]
    assert any("joint j2 goes from" in note and "as j1 leads it" in note for note in notes)


def test_what_is_before_the_palm_may_slide_and_float(tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    file = tmp_path / "hand.urdf"
    file.write_text(robot([
        *map(link, ["world", "slide", "palm", "a"]),
        joint("rail", "world", "slide", kind="prismatic"),
        joint("free", "slide", "palm", kind="floating", limit=""), joint("j1", "palm", "a")]))
    model, _ = hand_from_urdf(file, palm="palm")
    assert [j.name for j in model.joints] == ["j1"]
    assert finger_tips(model, np.zeros((1, 1))) == pytest.approx(np.array([[[0.0, 0.0, 0.04]]]))
    with pytest.raises(ValueError, match="joint rail: is prismatic; joints of a hand, beyond"):
        hand_from_urdf(file)


def test_what_is_left_out_or_cannot_be_taken_is_said(tmp_path: Path,
                                                     capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("yourdfpy")
    file, out = tmp_path / "hand.urdf", tmp_path / "hand.toml"
    file.write_text(robot([
        *map(link, ["base", "palm", "a", "b", "other"]), link("grasp_frame", ""),
        link("multiplier", ""), joint("wrist", "base", "palm"), joint("j1", "palm", "a"),
        joint("j2", "a", "b"), joint("side", "base", "other", at="0.1 0 0"),
        joint("f", "a", "grasp_frame", kind="fixed"),
        joint("m", "b", "multiplier", kind="fixed", at="0 0 0.004")]))
    model, notes = hand_from_urdf(file, palm="palm")
    assert "link palm is the palm: joints beside it are left out: side" in notes
    assert "link grasp_frame does not stand still on the palm: the frame is a guess" in notes
    assert np.linalg.norm(model.fingers[0].tip_m) == pytest.approx(0.01)
    assert "stiffness_Nm_rad = 2.0  # GUESS" in hand_text(model, guessed=True)
    for options, said in (
            (("--hold", "wrist=0"), "hold: there is no moving joint 'wrist' beyond link palm"),
            (("--hold", "j1=0", "--hold", "j1=9"), "--hold: j1 twice; should be held at one place"),
            (("--tip", "other"), "tip: link other is not beyond the palm, link palm; should be")):
        assert cli.run(["hand", str(file), "-o", str(out), "--palm", "palm", *options]) == 2
        assert said in capsys.readouterr().err


def linkage(file: Path, drive: str) -> Path:
    """Two fingers of a gripper, each of two joints and parallel to itself, with a bar from the palm
    to a pin on its last link; `drive` is the joint that all others follow."""
    parts = [link("palm")]
    for side, way in (("left", 1), ("right", -1)):
        led = [(f"{side}_arm", way), (f"{side}_tip", -way), (f"{side}_bar", way)]
        more = {name: "" if name == drive else
                f'<mimic joint="{drive}" multiplier="{turn if "left" in drive else -turn}"/>'
                for name, turn in led}
        limit = {name: LIMIT.format(-0.8 * (turn < 0), 0.8 * (turn > 0)) for name, turn in led}
        parts += [
            *(link(f"{side}_{name}_link") for name in ("arm", "tip", "bar", "end")),
            joint(f"{side}_arm", "palm", f"{side}_arm_link", at=f"{-0.03 * way} 0 0.02",
                  limit=limit[f"{side}_arm"], more=more[f"{side}_arm"]),
            joint(f"{side}_tip", f"{side}_arm_link", f"{side}_tip_link", at=f"{-0.03 * way} 0 0.05",
                  limit=limit[f"{side}_tip"], more=more[f"{side}_tip"]),
            joint(f"{side}_bar", "palm", f"{side}_bar_link", at=f"{-0.01 * way} 0 0.03",
                  limit=limit[f"{side}_bar"], more=more[f"{side}_bar"]),
            joint(f"{side}_end", f"{side}_bar_link", f"{side}_end_link", kind="fixed", limit="",
                  at=f"{-0.03 * way} 0 0.05"),
        ]
    file.write_text(robot(parts))
    return file


@pytest.mark.parametrize("drive", ["left_arm", "left_bar"])
@pytest.mark.parametrize("tips", [(), ("left_tip_link", "right_tip_link")])
def test_a_bar_that_ends_at_a_pin_is_no_finger(tmp_path: Path, drive: str, tips) -> None:
    """Whether a finger is driven or the bar, fingers go the same way."""
    pytest.importorskip("yourdfpy")
    model, notes = hand_from_urdf(linkage(tmp_path / "hand.urdf", drive), tips=tips)
    assert [[j.name for j in f.joints] for f in model.fingers] == [
        ["left_arm", "left_tip"], ["right_arm", "right_tip"]]
    assert [joint.name for joint in model.driven] == ["left_arm"]
    assert (model.joints[0].low_rad, model.joints[0].high_rad) == pytest.approx((0.0, 0.8))
    assert [j.follows.factor for j in model.joints if j.follows] == pytest.approx([-1.0, -1.0, 1.0])
    for bar, finger in (("left_bar", "left_tip"), ("right_bar", "right_tip")):
        assert (f"joint {bar} moves a bar of a linkage, which ends at a pin on what joint {finger} "
                "moves: it is left out") in notes
    assert len(model.palm) == 1  # nothing of a bar stands there
    at = finger_tips(model, np.array([[0.0], [0.5]]))  # a tip goes on the circle of its arm
    arm = np.array([-0.03 + 0.05j, 0.03 + 0.05j]) * np.exp(-0.5j * np.array([1, -1]))
    gone = (at[1] - at[0])[:, [0, 2]] @ [1, 1j]
    np.testing.assert_allclose(gone, arm - np.array([-0.03 + 0.05j, 0.03 + 0.05j]), atol=1e-12)


def test_what_lies_before_the_palm_is_not_asked_what_it_follows(tmp_path: Path) -> None:
    """A lift, and a wheel that turns with it, before a gripper that is a linkage."""
    pytest.importorskip("yourdfpy")
    file = linkage(tmp_path / "hand.urdf", "left_bar")
    lift = [link("base"), link("mast"), joint("lift", "base", "mast", kind="prismatic"),
            joint("wheel", "mast", "palm", more='<mimic joint="lift"/>')]
    file.write_text(file.read_text().replace("</robot>", "".join(lift) + "</robot>"))
    model, _ = hand_from_urdf(file, palm="palm")
    assert [joint.name for joint in model.driven] == ["left_arm"]


def test_joints_led_by_another_finger_have_one_drive(tmp_path: Path) -> None:
    """The right finger of a gripper, whose joints all follow one of the left, is no hand of its
    own: its second joint turns with its first one, by the ratio of their factors."""
    pytest.importorskip("yourdfpy")
    file = linkage(tmp_path / "hand.urdf", "left_arm")
    file.write_text(re.sub(r'(joint name="right_tip".*?multiplier=")1"/>',
                           r'\g<1>-0.5" offset="0.1"/>', file.read_text()))
    model, _ = hand_from_urdf(file, tips=["left_tip_link", "right_tip_link"])
    led = [j.follows for j in model.fingers[1].joints]
    assert [(f.joint, f.factor, f.offset_rad) for f in led] == [
        ("left_arm", -1.0, 0.0), ("left_arm", -0.5, 0.1)]
    hand = chain_of(model)
    assert hand.drives == ((0,), (0,))
    assert joint_drive(hand, 1, 1) == pytest.approx((0, 0.5, 0.1))
    q = random_angles(model, 4)
    inverse = np.linalg.inv(matrix_of(model.grasp_frame))
    for f, frames in enumerate(link_frames(model, q)):
        np.testing.assert_allclose(link_frames_of(hand, f, drive_angles(hand, q)[:, f]),
                                   inverse @ frames, atol=1e-12)


@pytest.mark.parametrize("shaped", [False, True])
def test_a_crank_that_fingers_follow_is_no_finger(tmp_path: Path, shaped: bool) -> None:
    """A motor's crank has no collision shape; one that has is left out where tips are named. The
    fingers go as it leads them: here as far as the crank may turn."""
    pytest.importorskip("yourdfpy")
    file = tmp_path / "hand.urdf"
    file.write_text(robot([
        *map(link, ["palm", "a", "b"]), link("arm") if shaped else '<link name="arm"/>',
        joint("crank", "palm", "arm", limit=LIMIT.format(0.0, 0.5)),
        joint("j1", "palm", "a", at="-0.03 0 0.02",
              more='<mimic joint="crank" multiplier="2" offset="0.1"/>'),
        joint("j2", "palm", "b", at="0.03 0 0.02",
              more='<mimic joint="crank" multiplier="-2"/>')]))
    model, notes = hand_from_urdf(file, tips=["a", "b"] if shaped else ())
    assert [[joint.name for joint in finger.joints] for finger in model.fingers] == [["j1"], ["j2"]]
    drive, = model.driven
    assert (drive.name, drive.low_rad, drive.high_rad) == ("j1", 0.1, pytest.approx(1.0))
    led = model.fingers[1].joints[0].follows
    assert (led.joint, led.factor, led.offset_rad) == ("j1", -1.0, pytest.approx(0.1))
    assert "joint j1 drives in place of crank, which is in no finger" in notes
    assert len(model.palm) == 1 + shaped


def test_what_misses_its_pin_is_a_finger(tmp_path: Path) -> None:
    """A bar that turns otherwise than its finger's arm shares no point with its last link; and
    fingers about one axis share what stands still."""
    pytest.importorskip("yourdfpy")
    file = linkage(tmp_path / "hand.urdf", "left_arm")
    file.write_text(file.read_text().replace(
        'multiplier="1"/></joint><joint name="left_end"',
        'multiplier="0.8"/></joint><joint name="left_end"'))
    model, notes = hand_from_urdf(file)
    assert len(model.fingers) == 3
    assert not any("left_bar moves a bar" in note for note in notes)
    file.write_text(robot([
        *map(link, ["palm", "a", "b", "c"]), joint("j1", "palm", "a"),
        joint("j2", "a", "b", more='<mimic joint="j1"/>'),
        joint("j3", "palm", "c", more='<mimic joint="j1" multiplier="0.5"/>')]))
    assert len(hand_from_urdf(file)[0].fingers) == 2


@pytest.mark.parametrize("carrying", [3, 4])
def test_an_arm_that_carries_the_hand_is_left_out(tmp_path: Path, carrying: int) -> None:
    """Three joints may be a wrist's, and are held. An arm may start with a joint that slides."""
    pytest.importorskip("yourdfpy")
    file = tmp_path / "robot.urdf"
    links = ["base", *(f"l{n}" for n in range(carrying)), "palm", "a", "b"]
    arm = [joint(f"arm{n}", links[n], links[n + 1],
                 kind="prismatic" if n == 0 and carrying == 4 else "revolute")
           for n in range(carrying)]
    file.write_text(robot([
        *map(link, links), *arm, joint("weld", links[carrying], "palm", kind="fixed", limit=""),
        joint("j1", "palm", "a", at="0.02 0 0"), joint("j2", "palm", "b", at="-0.02 0 0")]))
    model, notes = hand_from_urdf(file)
    assert [[j.name for j in f.joints] for f in model.fingers] == [["j1"], ["j2"]]
    said = [note for note in notes if "carry all fingers" in note]
    if carrying == 3:
        assert not said
        assert len(model.palm) == 5  # base, links of the wrist, and palm
        return
    assert said == ["joints arm0, arm1, arm2, arm3 carry all fingers: link l3 is the palm, and "
                    "what lies before it is left out"]
    assert len(model.palm) == 2
    assert len(hand_from_urdf(file, tips=["a", "b"])[0].palm) == 2
    with pytest.raises(ValueError, match="arm0: is prismatic"):
        hand_from_urdf(file, palm="base")
    with pytest.raises(ValueError, match="arm0: is prismatic"):
        hand_from_urdf(file, held_rad={"arm2": 0.5})


def test_a_hand_that_floats_begins_beyond_that_joint(tmp_path: Path) -> None:
    """Its wrist is held; no joint that floats could be."""
    pytest.importorskip("yourdfpy")
    file = tmp_path / "robot.urdf"
    file.write_text(robot([
        *map(link, ["world", "base", "palm", "a", "b"]),
        joint("free", "world", "base", kind="floating", limit=""), joint("wrist", "base", "palm"),
        joint("j1", "palm", "a", at="0.02 0 0"), joint("j2", "palm", "b", at="-0.02 0 0")]))
    model, notes = hand_from_urdf(file)
    assert [[j.name for j in f.joints] for f in model.fingers] == [["j1"], ["j2"]]
    assert len(model.palm) == 2  # base and palm
    assert notes[0] == ("joint free carries all fingers: link base is the palm, and what lies "
                        "before it is left out")
