"""What is wrong with a hand's file is said: file, element, and what would be right."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from urdf_parts import joint, link, robot

from sweeps.cli import main as cli
from warpgrasp.hands.hand_file import hand_from_file, hand_named
from warpgrasp.hands.hand_frames import matrix_of
from warpgrasp.hands.hand_model import Box, Capsule, HandError
from warpgrasp.hands.hand_writer import hand_text
from warpgrasp.hands.urdf_hand import hand_from_urdf

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")  # yourdfpy's own
GOOD = [link("palm"), link("a"), link("b"), joint("j1", "palm", "a"), joint("j2", "a", "b")]


def chain(count: int) -> list[str]:
    names = ["palm", *(f"l{n}" for n in range(count))]
    return [*map(link, names), *(joint(f"j{n}", names[n], names[n + 1]) for n in range(count))]


def with_shape(shape: str) -> list[str]:
    """The good hand, a shape of one's own on its last link."""
    inside = f"<collision><geometry>{shape}</geometry></collision>"
    return [*GOOD[:2], link("b", inside), *GOOD[3:]]


BAD = {
    "mesh": ([*GOOD[:2], link("b", '<collision><geometry><mesh filename="no.stl"/></geometry>'
                              "</collision>"), *GOOD[3:]],
             r"link b: .*mesh no\.stl is missing; should be a file"),
    "loop": ([*GOOD, joint("j3", "palm", "b")], "joint j3: link b is moved by joint j2 as well"),
    "circle": ([link("palm"), link("a"), link("b"), joint("j1", "b", "a"), joint("j2", "a", "b")],
               "joint j[12]: is part of a loop; a hand should be a tree"),
    "prismatic": ([*GOOD[:4], joint("j2", "a", "b", kind="prismatic")],
                  "joint j2: is prismatic; joints of a hand, beyond link palm, should be rev"),
    "no length": ([*GOOD[:4], joint("j2", "a", "b", at="0 0 0")],
                  "joint j2: turns about the axis of joint j1, .*no length; should stand apart"),
    "reversed": ([*GOOD[:4], joint("j2", "a", "b", limit='<limit lower="1" upper="-1" effort="1" '
                                   'velocity="1"/>')],
                 "joint j2: limits from 1 to -1 rad; lower should be less"),
    "no limit": ([*GOOD[:4], joint("j2", "a", "b", limit="")], "joint j2: has no limit; should"),
    "no tip": ([*GOOD[:2], link("b", ""), *GOOD[3:]],
               "finger finger1: its tip lies on its last joint j2.*should be named"),
    "nine": (chain(9), r"finger finger1: 9 joints \(j\d to j\d\); should be 1 to 6"),
    "several hands": ([link("palm"), *(part for n in range(8) for part in (
        link(f"f{n}"), joint(f"j{n}", "palm", f"f{n}")))],
        "8 chains of joints lead from link palm; should be 1 to 6 fingers: --palm names"),
    "xacro": ([*GOOD, '<xacro:finger xmlns:xacro="http://ros.org/wiki/xacro" name="thumb"/>'],
              "has a <xacro:finger>; should be a URDF, which `xacro FILE` makes of it"),
    "misspelt element": ([*GOOD[:2], link("b", "<colision/>"), *GOOD[3:]],
                         "link b: <link> with colision; did you mean collision?"),
    "misspelt attribute": (
        [*GOOD[:4], joint("j2", "a", "b", more='<mimic joint="j1" multiplyer="-0.5"/>')],
        "joint j2: <mimic> with multiplyer; did you mean multiplier?"),
    "scale": (with_shape('<mesh filename="big.obj" scale="nan 1 1"/>'),
              "link b: mesh big.obj: its scale is not finite; should be"),
    "nothing to touch": ([GOOD[0], link("a", ""), link("b", ""), *GOOD[3:]],
                         r"finger finger1: none of its links \(.*\) has a collision shape; should"),
    "empty": ([], "has no links; should be a tree"),
    "no axis": ([*GOOD[:4], joint("j2", "a", "b", axis="0 0 0")], "joint j2: its axis has no len"),
    "no link": ([*GOOD, joint("j3", "palm", "c")], "joint j3: there is no link 'c'; should"),
    "flat box": ([*GOOD[:2], link("b", '<collision><geometry><box size="0.1 0 0.1"/></geometry>'
                                  "</collision>"), *GOOD[3:]], "link b: a box of 0.1 x 0 x 0.1 m"),
    "box in mm": ([*GOOD[:2], link("b", '<collision><geometry><box size="16 18 55"/></geometry>'
                                   "</collision>"), *GOOD[3:]],
                  "link b: a box of 16 x 18 x 55 m; every size should be more than 0 and less tha"),
    "mesh in mm": ([*GOOD[:2], link("b", '<collision><geometry><mesh filename="big.obj"/>'
                                    "</geometry></collision>"), *GOOD[3:]],
                   "link b: mesh big.obj is 55 m long; should be less than 1 m: a mesh in mm has"),
    "length in mm": ([*GOOD[:4], joint("j2", "a", "b", at="0 0 60")],
                     r"joint j2 stands 60 m \(60,000 mm\) from joint j1; should be at most 0.5 m"),
    "limits in deg": ([*GOOD[:4], joint("j2", "a", "b", limit='<limit lower="0" upper="90" '
                                        'effort="1" velocity="1"/>')],
                      r"joint j2: limits 0 to 5157 deg \(0 to 90 rad\); should be at most 360 deg"),
    "origin": ([*GOOD[:2], link("b", '<collision><origin xyz="inf 0 0"/><geometry><sphere '
                                'radius="1"/></geometry></collision>'), *GOOD[3:]],
               "link b: a collision's origin is not finite"),
    "twice": ([*GOOD, link("b")], "link b: the name stands for two links; names should differ"),
    "comma": ([*GOOD[:4], joint("j2", "a", "b", more='<mimic joint="j1" multiplier="0,6"/>')],
              'joint j2: multiplier="0,6" of <mimic>; should be a number, with points in th'),
    "offset in deg": ([*GOOD[:4], joint("j2", "a", "b", more='<mimic joint="j1" offset="90"/>')],
                      "joint j2: follows j1 with an offset of 90 rad; should be at most a turn"),
    "number of a shape": ([*GOOD[:2], link("b", '<collision><geometry><sphere radius="1 cm"/>'
                                           "</geometry></collision>"), *GOOD[3:]],
                          'link b: radius="1 cm" of <sphere>; should be a number'),
    "flat mesh": (with_shape('<mesh filename="flat.obj"/>'),
                  "link b: mesh flat.obj: its points lie in one plane; a shape should have a vol"),
    "apart": ([*GOOD, link("c")], "links palm, c are moved by no joint; all but one should"),
    "mimic": ([*GOOD[:4], joint("j2", "a", "b", more='<mimic joint="j9"/>')],
              "joint j2: follows 'j9'; mimic should name"),
    "itself": ([*GOOD[:4], joint("j2", "a", "b", more='<mimic joint="j2"/>')],
               "joint j2: follows itself"),
    "one number": ([*GOOD[:4], joint("j2", "a", "b", at="0.035")],
                   'joint j2: xyz="0.035" of <origin>; should be 3 numbers'),
    "four numbers": ([*GOOD[:4], joint("j2", "a", "b", at="0 0 0.035 0.1")],
                     'joint j2: xyz="0 0 0.035 0.1" of <origin>; should be 3 numbers'),
    "axis of two": ([*GOOD[:4], joint("j2", "a", "b", axis="0 1")],
                    'joint j2: xyz="0 1" of <axis>; should be 3 numbers'),
    "two scales": (with_shape('<mesh filename="big.obj" scale="0.001 0.001"/>'),
                   'link b: scale="0.001 0.001" of <mesh>; should be 1 or 3 numbers'),
    "mesh without file": (with_shape("<mesh/>"), "link b: <mesh> without filename; should have it"),
    "no radius": (with_shape("<sphere/>"),
                  'link b: <sphere> without radius; should have it, as in <sphere radius="0.01">'),
    "no shape": (with_shape(""), "link b: <geometry> with no shape; should have one of box, cyl"),
    "capsule": (with_shape('<capsule radius="0.01" length="0.02"/>'),
                "link b: <geometry> with a <capsule>; should have a cylinder and a sphere"),
    "no geometry": ([*GOOD[:2], link("b", "<collision/>"), *GOOD[3:]],
                    "link b: <collision> without geometry; should have a shape"),
    "no name": ([*GOOD[:2], "<link/>", *GOOD[3:]], "link number 3: <link> without name; should"),
    "long name": ([*GOOD[:4], joint("j" * 81, "a", "b")], "joint j*: its name has 81 characters"),
    "line break": ([*GOOD[:4], joint("j&#10;2", "a", "b")], "joint number 2: its name has 3 char"),
    "nan": ([*GOOD[:4], joint("j2", "a", "b", more='<mimic joint="j1" multiplier="nan"/>')],
            "joint j2: multiplier or offset of its mimic is not finite"),
    "no end": ([*GOOD[:4], joint("j2", "a", "b", limit='<limit lower="0" upper="inf"/>')],
               "joint j2: limits 0.0, inf; should be finite"),
    "far frame": ([*GOOD, link("grasp_frame", ""),
                   joint("f", "palm", "grasp_frame", kind="fixed", at="2.5 0 0")],
                  "grasp_frame stands 2.5 m"),
    "still": ([link("palm"), link("a"), joint("j1", "palm", "a", kind="fixed")],
              "no moving joint beyond link palm; a hand should have a finger"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_urdf_is_refused(name: str, tmp_path: Path,
                               capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("yourdfpy")
    parts, message = BAD[name]
    file, out = tmp_path / "bad.urdf", tmp_path / "hand.toml"
    (tmp_path / "big.obj").write_text("v 0 0 0\nv 20 0 0\nv 0 20 0\nv 0 0 55\nf 1 2 3\nf 1 2 4\n")
    plate = [f"v {x} {y} {z}" for x in (0, 0.03, 0.06) for y in (0, 0.06) for z in (0,)]
    (tmp_path / "flat.obj").write_text("\n".join([*plate, "f 1 2 3", "f 1 2 5"]))
    # A ball at the last link's frame gives it a tip one radius out.
    file.write_text(robot(parts))
    assert cli.run(["hand", str(file), "-o", str(out)]) == 2
    said = capsys.readouterr().err
    assert re.search(f"{re.escape(str(file))}: {message}", said), said
    assert not out.exists()


@pytest.mark.parametrize("text", ["", "<robot", "<sdf/>", '<robot name="a"/>', "<robot/>",
                                  '<robot name="a"><link/></robot>'])
def test_what_is_no_urdf_is_refused(text: str, tmp_path: Path) -> None:
    file = tmp_path / "bad.urdf"
    file.write_text(text)
    with pytest.raises(HandError, match=r"should be|should have"):
        hand_from_urdf(file)


def test_a_cylinder_keeps_its_axis(tmp_path: Path) -> None:
    """Its capsule used to be askew, and to lie across a short one."""
    pytest.importorskip("yourdfpy")
    file = tmp_path / "hand.urdf"
    for radius, length in ((0.008, 0.04), (0.01, 0.012)):
        rod = ('<collision><origin xyz="0 0 0.02" rpy="0 0.5 0"/><geometry>'
               f'<cylinder radius="{radius}" length="{length}"/></geometry></collision>')
        file.write_text(robot([*GOOD[:2], link("b", rod), *GOOD[3:]]))
        rod = hand_from_urdf(file)[0].joints[-1].shapes[0]
        assert isinstance(rod, Capsule)
        assert np.add(rod.start, rod.end) / 2 == pytest.approx([0.0, 0.0, 0.02], abs=1e-12)
        along = np.subtract(rod.end, rod.start)
        assert np.cross(along, [np.sin(0.5), 0.0, np.cos(0.5)]) == pytest.approx(0.0, abs=1e-12)
        assert 0.0 < rod.fit_error_m < 0.004
        assert rod.radius == pytest.approx(radius, rel=0.02)
    assert rod.start == rod.end  # a ball is nearest


def test_a_named_hand_or_arm_stands_beside_files(tmp_path: Path,
                                                 capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(hand_text(hand_named("barrett")))
    assert cli.run(["hands", str(file), "leap", "--json"]) == 0
    assert [row["hand"] for row in json.loads(capsys.readouterr().out)] == [str(file), "leap"]
    assert cli.run(["arms", "panda", "puma560", "--json"]) == 0
    assert [row["arm"] for row in json.loads(capsys.readouterr().out)] == ["panda", "puma560"]
    assert cli.run(["hands", "laep"]) == 2
    assert "hand 'laep'; should be one of utah_mit" in capsys.readouterr().err


def test_who_names_two_tips_at_once_is_told_how(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["hand", "x.urdf", "-o", "x.toml", "--tip", "a", "b"]) == 2
    assert "b: there is no place for it; an option that takes several values is repeated, as in " \
        "--tip A --tip B" in capsys.readouterr().err


def drop(text: str) -> Callable[[str], str]:
    return lambda whole: "\n".join(line for line in whole.split("\n") if not re.match(text, line))


def change(old: str, new: str) -> Callable[[str], str]:
    return lambda whole: re.sub(old, new, whole, count=1, flags=re.MULTILINE)


@pytest.mark.parametrize(("edit", "message"), [
    (drop("tip_mm"), "finger index: tip_mm: field required"),
    (change(r"^tip_mm = .*", "tip_mm = [0, 0, 0]"), "finger index: its tip lies on its last joint"),
    (change("^limits_deg = .*", "limits_deg = [10, -10]"), "lower one should be less"),
    (change("^axis = .*", "axis = [0, 0, 2]"), "axis of length 2; should be 1"),
    (change("^turn = .*", "turn = [0, 0, 0, 2]"), "turn is of length 2; should be a quaternion"),
    (change("^thumb = .*", 'thumb = "tumb"'), "thumb: there is no finger 'tumb'; should be one of"),
    (change("^senses = .*", 'senses = "smell"'), "senses: is 'smell'; should be one of tendons"),
    (change("^moves = .*", "moves = []"), "closing grasp: moves no joint"),
    (change("^moves = .*", 'moves = ["x"]'), "closing grasp: moves 'x'; should be driven joints"),
    (change('^end = "closed"', 'end = "shut"'), "closing grasp: there is no posture 'shut'"),
    (change('^"joint_1.0" = .*', '"joint_1.0" = 500'), "joint joint_1.0 at 500 deg; should be"),
    (change("^box_mm = .*", ""), "a shape without box_mm or capsule_mm"),
    (change("^box_mm = .*", "box_mm = [1, 0, 1]"), "palm: a box of 1 x 0 x 1 mm; should be 0.1"),
    (change("^capsule_mm = ", "at_mm = [100, 0, 0]\ncapsule_mm = "),
     "joint joint_3.0: a capsule with at_mm; should be without, for capsule_mm says"),
    (change("^capsule_mm = ", "turn = [0, 0, 0, 1]\ncapsule_mm = "), "a capsule with turn; should"),
    (change("^box_mm = ", "radius_mm = 5\nbox_mm = "), r"palm\[0\]: a box with radius_mm; should"),
    (change("^effort_Nm = .*", "effort_Nm = -0.5"),
     "joint joint_0.0: effort -0.5 N m; should be more than 0, or 0 where it is not known"),
    (change(r"^\[closings[\s\S]*?\n\n", "[closings]\n"),
     "closings: there is none; should have one"),
    (change('^end = "closed"', 'end = "open"'),
     "closing grasp: no joint that it moves is elsewhere in posture open than in open"),
    (change("^moves = .*", 'moves = ["joint_12.0"]'), "closing grasp: no joint that it moves is"),
    (change('^.closings."grasp".', '[closings."curl40"]'),
     "closing curl40: is the name of a way in which every hand closes .curl25, .*another name"),
    (change("^name = ", "nane = "), "nane: extra inputs are not permitted; did you mean name.$"),
    (change(r"^(name = .joint_0.0.\n)at_mm", r"\1at_m"),
     "finger index: joint joint_0.0: at_m: extra inputs are not permitted; did you mean at_mm.$"),
    (change("^start = ", "strat = "), "closings.grasp.strat: extra .* did you mean start.$"),
    (change("^box_mm = ", "box_m = "), r"palm\[0\].box_m: extra .* did you mean box_mm.$"),
    (change("^axis = .*", "axis = [0, nan, 0]"), "axis.*finite"),
    (change("^pads = .*", 'pads = ["joint_4.0"]'), "a pad on 'joint_4.0'; should be on one of"),
    (change("^stiffness_Nm_rad = .*", "stiffness_Nm_rad = 0"), "stiffness 0; should be more"),
    (change(r"^\[extended\].*\nfinger = .*", '[extended]\nfinger = "pinky"'),
     "extended.finger: there is no finger 'pinky'; should be one of index, middle"),
    (change('^posture = "extended"', 'posture = "poke"'),
     "extended.posture: there is no posture 'poke'; should be one of open"),
    (change(r"^(pads = \[).*", r"\1]"),
     "extended.finger: finger index has no pad on its last link; should have pads = .'joint_3.0'"),
    (change("^fingers = .*", 'fingers = ["index", "index"]'),
     "opposed.fingers: 'index' twice; should be two fingers"),
    (change("^fingers = .*", 'fingers = ["index", "palm"]'),
     "opposed.fingers: there is no finger 'palm'"),
    (change('^end = "pinched"', 'end = "shut"'), "opposed.end: there is no posture 'shut'"),
    (change('^end = "pinched"', 'end = "apart"'), "opposed: no joint of finger index is elsewhere "
     "in posture apart than in apart; one at least should be"),
    (change("^effort_Nm = .*", "effort_Nm = true"), "effort_Nm: input should be a valid number"),
    (change("^thickness_mm = .*", "thickness_mm = 1000"), "pads.thickness_mm: input should be le"),
    (change("^width_mm = .*", "width_mm = 1e-12"), "pads.width_mm: input should be greater than"),
    (change("^length_mm = .*", "length_mm = -1"), "pads.length_mm: input should be greater"),
    (change(r"^pads = \[.*", 'pads = ["joint_0.0", "joint_1.0", "joint_2.0", "joint_3.0"]'),
     "finger index: 4 pads; should be 3 at most"),
    (change(r"^\[\[finger.joint\]\]", '[[finger.pad]]\nlink = "joint_2.0"\n'
            "axis_mm = [[0, 0, 0], [0, 0, 20]]\nradius_mm = 9\nside = [1, 0, 0]\n\n"
            "[[finger.joint]]"),
     "the place of a pad on 'joint_2.0', which is none of its pads"),
    (change(r"^pads = \[.*", 'pads = ["joint_3.0", "joint_3.0"]'),
     "finger index: pads: link joint_3.0 twice; a link should bear one pad at most"),
    (change(r"^\[\[finger.joint\]\]", 2 * ('[[finger.pad]]\nlink = "joint_3.0"\n'
            "axis_mm = [[0, 0, 0], [0, 0, 20]]\nradius_mm = 9\nside = [1, 0, 0]\n\n")
            + "[[finger.joint]]"),
     "finger index: pad: link joint_3.0 twice; a link should bear one pad at most"),
    # millimetres and degrees given as metres and radians, or the other way round
    (change(r"^tip_mm = .*", "tip_mm = [5000, 0, 0]"),
     r"finger index: its tip stands 5 m \(5,000 mm\) from joint joint_3.0; should be at most 0."),
    (change(r"^tip_mm = .*", "tip_mm = [0, 0, 150]"),
     "finger index: its tip is 111 mm off the shapes of its last link; should be at most 50 mm"),
    (lambda whole: change(r"^tip_mm = .*", "tip_mm = [0, 0, 80]")(
        change("^capsule_mm = .*\nradius_mm = .*", "box_mm = [40, 40, 40]")(whole)),
     "finger index: its tip is 60 mm off the shapes of its last link; should be at most 50 mm"),
    (change(r"^tip_mm = .*", "tip_mm = [0, 0, 0.0387]"),
     "finger index: its tip lies on its last joint joint_3.0, 0.0387 mm from it"),
    (change("^box_mm = .*", "box_mm = [0.04, 0.1, 0.1]"),
     "palm: a box of 0.04 x 0.1 x 0.1 mm; should be 0.1 to 1000 mm each way: a URDF has metres"),
    (change("^capsule_mm = .*", "capsule_mm = [[0, 0, 0], [0, 0, 3000]]"),
     r"joint joint_3.0: a capsule stands 3 m \(3,000 mm\) from the frame of its link"),
    (change(r"^at_mm = .*(\n.*\naxis = .*\nlimits_deg = .*\n.*\n.*\n\n.*\nbox_mm = .*\n.*\n.*\n\n"
            r'.*\nname = "joint_3.0")', r"at_mm = [0, 0, 0.0384]\1"),
     "joint joint_2.0: its axis is 0.0384 mm from that of joint joint_1.0"),
    (change(r"^(\[grasp_frame\].*\nat_mm = ).*", r"\1[5000, 0, 0]"),
     "grasp_frame stands 5 m .* from the palm's frame; should be at most 2 m"),
    (change("^limits_deg = .*", "limits_deg = [0, 5156]"),
     r"joint joint_0.0: limits 0 to 5156 deg \(0 to 89.99 rad\); should be at most 360 deg"),
    (lambda whole: re.sub("^limits_deg = .*", "limits_deg = [0, 1.6]", whole, flags=re.MULTILINE),
     r"finger index: its joint with the widest limits \(.*\) turns by 1.6 deg; should be 6.3 at"),
    (lambda whole: "[" + whole, "is not valid TOML"),
])
def test_a_bad_hand_file_is_refused(edit: Callable[[str], str], message: str, tmp_path: Path,
                                    capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "hand.toml"
    file.write_text(edit(hand_text(hand_named("allegro"))))
    assert cli.run(["hands", str(file)]) == 2
    said = capsys.readouterr().err
    assert re.search(f"{re.escape(str(file))}: .*{message}", said, re.MULTILINE), said


def test_a_file_says_all_of_its_hand(tmp_path: Path) -> None:
    file = tmp_path / "hand.toml"
    for name in ("utah_mit", "allegro", "leap", "barrett"):
        file.write_text(hand_text(hand_named(name)))
        again = hand_from_file(file)
        assert hand_text(again) == file.read_text()


def test_a_file_of_a_windows_editor_is_read(tmp_path: Path) -> None:
    file = tmp_path / "hand.toml"
    file.write_bytes(b"\xef\xbb\xbf" + hand_text(hand_named("leap")).encode())
    assert hand_from_file(file) == hand_named("leap")


def test_a_hand_of_a_robot_without_a_name_is_called_as_its_file(tmp_path: Path) -> None:
    """It was written to a file that was not read."""
    pytest.importorskip("yourdfpy")
    file = tmp_path / "mine.urdf"
    file.write_text(robot(GOOD).replace('name="x"', 'name=""'))
    assert hand_from_urdf(file)[0].name == "mine"


def test_a_note_of_a_link_whose_name_breaks_lines_is_a_comment(tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    file, out = tmp_path / "hand.urdf", tmp_path / "hand.toml"
    file.write_text(robot([link("root"), link("pa&#10;lm"), joint("j0", "root", "pa&#10;lm"),
                           link("q"), joint("j3", "root", "q"), *GOOD[1:3],
                           joint("j1", "pa&#10;lm", "a"), GOOD[4]]))
    model, notes = hand_from_urdf(file, palm="pa\nlm")
    assert any("link pa\nlm is the palm" in note for note in notes)
    out.write_text(hand_text(model, notes))
    assert [j.name for j in hand_from_file(out).joints] == ["j1", "j2"]


def test_the_command_writes_what_it_reads(tmp_path: Path,
                                          capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("yourdfpy")
    file, out = tmp_path / "hand.urdf", tmp_path / "hand.toml"
    file.write_text(robot(GOOD))
    assert cli.run(["hand", str(file), "-o", str(out), "--hold", "j1=20", "--no-trials"]) == 0
    assert capsys.readouterr().out.split() == [str(out), str(tmp_path / "hand.png")]
    assert "GUESS" in out.read_text()
    assert "#;" not in out.read_text() + hand_text(hand_named("leap"))
    assert [j.name for j in hand_from_file(out).joints] == ["j2"]
    assert cli.run(["hands", str(out)]) == 0
    assert cli.run(["hands"]) == 0
    assert "barrett" in capsys.readouterr().out
    out = tmp_path / "other.toml"
    assert cli.run(["hand", str(file), "-o", str(out), "--hold", "j1=x"]) == 2
    assert cli.run(["hand", str(file), "-o", str(out), "--palm", "q"]) == 2
    capsys.readouterr()
    assert cli.run(["hand", str(file), "-o", str(out), "--hold", "j1=200"]) == 2
    assert "hold: joint j1 at 200 deg; should be 0 to 57.3" in capsys.readouterr().err
    assert cli.run(["hand", str(tmp_path / "none.urdf"), "-o", str(out)]) == 2


def test_a_file_that_was_mended_is_not_written_over(tmp_path: Path,
                                                    capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("yourdfpy")
    file, out = tmp_path / "hand.urdf", tmp_path / "hand.toml"
    file.write_text(robot(GOOD))
    out.write_text("mended")
    for command in ("hand", "arm"):
        assert cli.run([command, str(file), "-o", str(out)]) == 2
        assert "hand.toml: exists already; choose another name, or" in capsys.readouterr().err
    assert out.read_text() == "mended"
    assert cli.run(["hand", str(file), "-o", str(out), "--force", "--no-trials"]) == 0
    assert "GUESS" in out.read_text()
    assert cli.run(["hand", str(out), "-o", str(out)]) == 0  # draws it again
    assert cli.run(["arm", str(file), "-o", str(out), "--force"]) == 2
    assert "GUESS" in out.read_text()


@pytest.mark.parametrize("option", [("--hold", "x=3"), ("--palm", "q"), ("--tip", "q")])
def test_a_hand_that_is_read_again_takes_no_options_of_a_urdf(
    option: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str],
) -> None:
    file = tmp_path / "hand.toml"
    file.write_text(hand_text(hand_named("barrett")))
    assert cli.run(["hand", str(file), "-o", str(file), *option]) == 2
    assert f"{option[0]}: is for a URDF, and {file} is a hand already" in capsys.readouterr().err
    assert not file.with_suffix(".png").exists()


def test_a_capsule_may_be_said_by_links_that_are_one_body(tmp_path: Path) -> None:
    pytest.importorskip("yourdfpy")
    file = tmp_path / "hand.urdf"
    rod = ('<collision><geometry><cylinder radius="0.01" length="0.04"/></geometry></collision>')
    file.write_text(robot([*GOOD[:2], link("b", rod), *GOOD[3:], link("c"), link("d"),
                           joint("f", "b", "c", kind="fixed", at="0 0 0.02"),
                           joint("g", "c", "d", kind="fixed", at="0 0 -0.04")]))
    file.with_name("thick.urdf").write_text(file.read_text().replace('"0.01" len', '"0.012" len'))
    assert len(hand_from_urdf(file.with_name("thick.urdf"))[0].joints[-1].shapes) == 3
    found, = hand_from_urdf(file)[0].joints[-1].shapes
    assert isinstance(found, Capsule)
    assert (found.radius, found.fit_error_m) == (0.01, 0.0)
    assert found.end[2] - found.start[2] == pytest.approx(0.04)


def test_a_flat_cylinder_is_a_box_of_its_area(tmp_path: Path) -> None:
    """The nearest capsule to a plate is a ball as wide as it: a palm of 4 mm was one of 69."""
    pytest.importorskip("yourdfpy")
    file = tmp_path / "plate.urdf"
    file.write_text(robot([link("palm", '<collision><geometry><cylinder radius="0.05" '
                                        'length="0.004"/></geometry></collision>'),
                           link("a"), link("b"), *GOOD[3:]]))
    plate, = hand_from_urdf(file)[0].palm
    assert isinstance(plate, Box)
    x, y, z = plate.size
    assert x * y == pytest.approx(0.05**2 * np.pi)
    assert z == pytest.approx(0.004)


def test_a_flat_mesh_is_a_box_of_its_volume(tmp_path: Path) -> None:
    """So is a cylinder, and the nearest capsule to the palm of most hands is a ball, too."""
    pytest.importorskip("yourdfpy")
    for name, mesh, off in (
            ("box", trimesh.creation.box((0.06, 0.08, 0.02)), 0.0),
            ("prism", trimesh.creation.cylinder(0.05, 0.028, sections=6), 0.00947)):
        mesh.export(tmp_path / f"{name}.stl")
        shape = f'<geometry><mesh filename="{name}.stl"/></geometry>'
        file = tmp_path / f"{name}.urdf"
        file.write_text(robot([
            link("palm", f'<collision><origin xyz="0 0.01 0.02" rpy="0.4 -0.3 1"/>{shape}'
                         "</collision>"), link("a"), link("b"), *GOOD[3:]]))
        model, notes = hand_from_urdf(file)
        plate, = model.palm
        assert isinstance(plate, Box)
        assert np.prod(plate.size) == pytest.approx(mesh.volume)
        assert plate.place[:3] == pytest.approx((0.0, 0.01, 0.02), abs=1e-9)
        assert min(plate.size) == pytest.approx(mesh.extents.min())
        thin = matrix_of(plate.place)[:3, int(np.argmin(plate.size))]
        assert abs(thin @ Rotation.from_euler("xyz", (0.4, -0.3, 1)).apply((0, 0, 1))) > 1 - 1e-9
        # The box has the sides 86.6 and 75 mm; a side of the prism goes from (50, 0) to (25, 43.3)
        # and lies within the box where x = 50 - 25 t is as far from 43.3 as y = 43.3 t from 37.5.
        assert plate.fit_error_m == pytest.approx(off, abs=1e-4)
        said = [line for line in notes if line.startswith("palm: a box stands for a mesh")]
        assert len(said) == (off > 0)
        copy = tmp_path / f"{name}.toml"
        copy.write_text(hand_text(model, notes, guessed=True))
        assert hand_from_file(copy).palm[0].fit_error_m == pytest.approx(plate.fit_error_m)


def test_a_mesh_is_that_of_its_package_in_the_unit_of_its_file(tmp_path: Path) -> None:
    """A package's mesh of the same name as one beside the URDF; centimetres of COLLADA; a vertex
    that no face has."""
    pytest.importorskip("yourdfpy")
    for package, length in (("mine", 0.03), ("other", 0.05)):
        (tmp_path / package / "meshes").mkdir(parents=True)
        trimesh.creation.box((0.012, 0.012, length)).export(tmp_path / package / "meshes/m.ply")
    file = tmp_path / "mine" / "hand.urdf"

    def longest(mesh: str) -> float:
        file.write_text(robot(with_shape(f'<mesh filename="{mesh}"/>')))
        shape = hand_from_urdf(file)[0].fingers[0].joints[-1].shapes[-1]
        assert isinstance(shape, Capsule)
        return float(np.linalg.norm(np.subtract(shape.end, shape.start))) + 2 * shape.radius

    assert longest("package://other/meshes/m.ply") > 0.045
    assert longest("package://renamed/meshes/m.ply") < 0.04
    manifest = tmp_path / "mine" / "package.xml"
    manifest.write_text("<package><name>mine</name></package>")
    assert longest("package://mine/meshes/m.ply") < 0.04
    with pytest.raises(HandError, match=r"m\.ply is missing"):
        longest("package://renamed/meshes/m.ply")

    stray = trimesh.creation.box((0.012, 0.012, 0.03))
    stray.vertices = [*stray.vertices, [0.0, 0.0, 0.2]]
    stray.export(tmp_path / "mine" / "stray.ply")
    assert longest("stray.ply") < 0.04

    pytest.importorskip("collada")
    text = trimesh.exchange.dae.export_collada(trimesh.creation.box((1.2, 1.2, 3.0)))
    assert b"</asset>" in text
    (tmp_path / "mine" / "cm.dae").write_bytes(text.replace(
        b"</asset>", b'<unit name="centimetre" meter="0.01"/></asset>'))
    assert longest("cm.dae") == pytest.approx(0.0345, rel=0.02)
