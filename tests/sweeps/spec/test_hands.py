"""A spec's hand: a word, a file, a sweep, and what is wrong with it."""

from dataclasses import replace
from pathlib import Path

import pytest

from sweeps.analysis.sensitivity import sensitivity_spec
from sweeps.run.plan import canonical_study, cell_hash, plan_study, study_of
from sweeps.spec.errors import SpecError
from sweeps.spec.reader import read_spec
from sweeps.spec.study import Study
from warpgrasp.hands.hand_file import hand_named
from warpgrasp.hands.hand_model import Capsule, HandClosing, Posture
from warpgrasp.hands.hand_writer import hand_text

HEAD = 'schema = 1\nobjects = ["block"]\n'
RING = '[[strategy]]\nname = "ring6"\n'
ALONE = "[contact]\nfriction = 0.0\n"


def read(tmp_path: Path, text: str, *overrides: str) -> Study:
    file = tmp_path / "spec.toml"
    file.write_text(text)
    return read_spec(file, overrides)


def told(tmp_path: Path, text: str) -> str:
    with pytest.raises(SpecError) as error:
        read(tmp_path, text)
    return str(error.value)


def test_a_word_names_the_hand_and_the_arm(tmp_path: Path) -> None:
    study = read(tmp_path, HEAD + 'hand = "leap"\narm = "none"\n' + RING + ALONE)
    assert study.cell(0, 0, 0).hand.kind == "leap"
    assert study.cell(0, 0, 0).arm.kind == "none"
    assert read(tmp_path, HEAD + RING).cell(0, 0, 0).hand.kind == "utah_mit"


def test_hands_can_be_swept(tmp_path: Path) -> None:
    text = HEAD + RING + ALONE + '[sweep.grid]\nhand = ["utah_mit", "allegro", "leap"]\n'
    study = read(tmp_path, text)
    kinds = [study.cell(0, 0, n).hand.kind for n in range(study.setting_count)]
    assert kinds == ["utah_mit", "allegro", "leap"]
    assert len({cell_hash(study.cell(0, 0, n), study.objects[0]) for n in range(3)}) == 3
    again = read(tmp_path, HEAD + RING + ALONE, "hand=utah_mit,allegro")
    assert again.setting_count == 2


def test_a_hand_is_swept_once_by_its_word_or_its_key(tmp_path: Path) -> None:
    text = HEAD + RING + ALONE
    for settings in (["hand=allegro", "hand.kind=leap"], ["hand.kind=leap", "hand=allegro"]):
        with pytest.raises(SpecError, match=r"--set: hand\.kind: is given twice"):
            read(tmp_path, text, *settings)
    twice = text + '[sweep.grid]\nhand = ["utah_mit"]\n"hand.kind" = ["allegro"]\n'
    assert "is hand.kind a second time" in told(tmp_path, twice)


def test_a_hand_of_ones_own_is_known_by_its_content(tmp_path: Path) -> None:
    own = tmp_path / "my_hand.toml"
    own.write_text(hand_text(hand_named("barrett")))
    text = HEAD + 'hand = "my_hand.toml"\n' + RING + ALONE
    study = read(tmp_path, text)
    assert study.cell(0, 0, 0).hand.kind == str(own)
    resolved = canonical_study(study)
    assert resolved["hand"]["kind"].startswith("sha256:")
    name = cell_hash(study.cell(0, 0, 0), study.objects[0])
    back = study_of(resolved)
    assert cell_hash(back.cell(0, 0, 0), back.objects[0]) == name
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    (moved / "my_hand.toml").write_text(own.read_text())
    other = read(moved, text)
    assert cell_hash(other.cell(0, 0, 0), other.objects[0]) == name
    own.write_text(own.read_text().replace("stiffness_Nm_rad = 2.0", "stiffness_Nm_rad = 3.0"))
    changed = read(tmp_path, text)
    plan_study(changed)  # files are read once a plan
    assert cell_hash(changed.cell(0, 0, 0), changed.objects[0]) != name


@pytest.mark.parametrize(("lines", "said"), [
    ('hand = "legro"\n', "did you mean allegro? there are: utah_mit, allegro, leap, barrett"),
    ('hand = "none.toml"\n', "'none.toml' is not a file"),
    ('[hand]\nkind = "leap"\nlink_radius_mm = 9.0\n', "is a number of the Utah-MIT hand"),
])
def test_what_is_wrong_with_a_hand_is_said(tmp_path: Path, lines: str, said: str) -> None:
    text = HEAD + lines + RING + ALONE if lines.startswith("hand") else HEAD + RING + ALONE + lines
    assert said in told(tmp_path, text)


def test_a_closing_path_that_a_hand_has_not_is_said(tmp_path: Path) -> None:
    text = HEAD + 'hand = "leap"\n' + RING + 'closings = ["curl40", "curl25_spread"]\n' + ALONE
    said = told(tmp_path, text)
    assert ":6: strategy[0].closings[1]: the hand leap has no closing path 'curl25_spread'" in said
    own = HEAD + RING + 'closings = ["grasp"]\n'
    assert "strategy[0].closings[0]: is 'grasp'" in told(tmp_path, own)


@pytest.mark.parametrize(("closings", "when"), [
    ("", ""), ('"strategy.closings" = [["curl40"], ["curl25_spread"]]\n', ""),
    ('"strategy.closings" = [["curl40"], ["curl25_spread"]]\n',
     ', when = { "strategy.closings" = [["curl40"]] }')])
def test_a_closing_path_that_a_hand_of_a_search_has_not_is_said(
        tmp_path: Path, closings: str, when: str) -> None:
    """Its episodes failed, and counted as the worst."""
    own = "" if closings else 'closings = ["curl25_spread"]\n'
    text = (HEAD + RING + own + ALONE + "[search]\n" + closings
            + f'hand = {{ choices = ["utah_mit", "leap"]{when} }}\n')
    if when:
        assert read(tmp_path, text).search is not None
    else:
        assert "the hand leap has no closing path 'curl25_spread'" in told(tmp_path, text)


def test_a_closing_path_of_the_hands_own_file_is_gone(tmp_path: Path) -> None:
    text = HEAD + 'hand = "barrett"\n' + RING + 'closings = ["grasp"]\n' + ALONE
    assert read(tmp_path, text).cell(0, 0, 0).strategy.closings == ("grasp",)
    swept = HEAD + RING + ALONE + '[sweep.zip]\nhand = ["utah_mit", "barrett"]\n'
    both = '"strategy.closings" = [["curl25_spread"], ["grasp"]]\n'
    study = read(tmp_path, swept + both)
    assert study.cell(0, 0, 1).strategy.closings == ("grasp",)
    said = told(tmp_path, swept + '"strategy.closings" = [["grasp"], ["grasp"]]\n')
    assert "the hand utah_mit has no closing path 'grasp'" in said
    assert ":9: " in said


@pytest.mark.parametrize("hands", [
    '[sweep.grid]\nhand = ["leap", "barrett"]\n', '[sweep.grid]\nhand = ["leap"]\n',
    '[search]\nhand = ["utah_mit", "leap"]\n'])
def test_a_robot_knows_which_hand_it_has(tmp_path: Path, hands: str) -> None:
    text = HEAD + RING + ALONE + '[robot]\nswept = "truth"\n'
    assert "a robot knows which hand it has" in told(tmp_path, text + hands)


@pytest.mark.parametrize(("more", "place"), [
    ('[robot]\nswept = "truth"\n[sweep.grid]\n"hand.mount_length_mm" = [100, 110]\n',
     ":8: sweep.grid.'hand.mount_length_mm': "),
    ('[robot]\nswept = "belief"\n[search]\n"hand.mount_length_mm" = { low = 90, high = 110 }\n',
     ":8: search.'hand.mount_length_mm': "),
    ('[sweep.grid]\n"robot.swept" = ["both", "truth"]\n"hand.mount_length_mm" = [100, 110]\n',
     ":7: sweep.grid.'hand.mount_length_mm': ")])
def test_a_robot_knows_how_long_its_mount_is(tmp_path: Path, more: str, place: str) -> None:
    said = told(tmp_path, HEAD + RING + more)
    assert f'{place}arm and hand share the mount' in said
    assert 'should be swept with robot.swept = "both" alone' in said


def test_the_mount_of_both_robots_is_swept(tmp_path: Path) -> None:
    read(tmp_path, HEAD + RING + '[sweep.grid]\n"hand.mount_length_mm" = [100, 110]\n')


LENGTHS = '"hand.link_length_mm" = [[40, 30, 25], [43, 33, 28]]\n'
TORQUES = '"sensors.torque_threshold_Nm" = [0.05, 0.1]\n'
SWITCH = '"sensors.switch_force_N" = [0.5, 1.0]\n'


@pytest.mark.parametrize(("head", "tail", "key", "said"), [
    ('hand = "leap"\n', "[sweep.grid]\n" + LENGTHS, "'hand.link_length_mm'", "Utah-MIT hand"),
    ('hand = "leap"\n', "[sweep.grid.hand]\njoint_stiffness_Nm_rad = [1, 2]\n",
     "hand.joint_stiffness_Nm_rad", "mount_length_mm, palm_thickness_mm"),
    ('hand = "leap"\n', '[sweep.lhs]\nn = 2\n"pads.width_mm" = {low = 10, high = 15}\n',
     "'pads.width_mm'", "says nothing of this hand"),
    ('hand = "leap"\n', '[search]\n"hand.link_radius_mm" = {low = 7, high = 9}\n',
     "'hand.link_radius_mm'", "Utah-MIT hand"),
    ('hand = "leap"\n', '[sweep.grid]\n"sensors.tendon_threshold_N" = [3, 6]\n',
     "'sensors.tendon_threshold_N'", "sense joint torques; of those count tension_readings"),
    ('hand = "leap"\n', "[sensors]\ntendon_threshold_N = 3.0\n", "sensors.tendon_threshold_N",
     "joint torques"),
    ("", "[sweep.grid]\n" + TORQUES, "'sensors.torque_threshold_Nm'", "sense tendon tensions"),
    ("", '[sweep.grid]\nhand = ["utah_mit", "leap"]\n' + SWITCH, "'sensors.switch_force_N'",
     "joint torques or tendon tensions"),
])
def test_a_key_that_says_nothing_of_any_hand_is_refused(
        tmp_path: Path, head: str, tail: str, key: str, said: str) -> None:
    """Fixed or swept: entries that are the same would be ranked as if they were not."""
    text = HEAD + head + RING + ALONE + tail
    (line,) = told(tmp_path, text).splitlines()
    assert key in line
    assert said in line
    name = key.strip("'").rpartition(".")[2]
    assert f":{[name in row for row in text.splitlines()].index(True) + 1}: " in line


def test_a_key_may_say_something_of_one_hand_alone(tmp_path: Path) -> None:
    """And what is fixed at its default does no harm."""
    hands = '[sweep.grid]\nhand = ["utah_mit", "leap"]\n'
    for tail in (hands + LENGTHS + TORQUES, "[sensors]\ntorque_threshold_Nm = 0.05\n",
                 "[sensors]\ntorque_threshold_Nm = 0.1\n" + hands):
        read(tmp_path, HEAD + RING + ALONE + tail)
    own = tmp_path / "my_hand.toml"
    own.write_text(hand_text(replace(hand_named("leap"), senses="tip_switches")))
    read(tmp_path, HEAD + 'hand = "my_hand.toml"\n' + RING + ALONE + "[sweep.grid]\n" + SWITCH)


def test_pads_that_do_not_fit_the_hand_are_refused(tmp_path: Path) -> None:
    """Those of its own file, where a strategy feels; as the spec has them, where it says none. Keys
    of a spec that would do nothing are refused."""
    feels = RING + 'order = ["containment", "planar"]\n'
    own = tmp_path / "my_hand.toml"
    own.write_text(hand_text(hand_named("allegro")).replace("length_mm = 25.4",
                                                            "length_mm = 80.0"))
    said = told(tmp_path, HEAD + 'hand = "my_hand.toml"\n' + feels + ALONE)
    assert "finger index: pad of 80 mm does not fit link joint_3.0 of 20 mm" in said
    assert "[pads] length_mm of the file of the hand should be 18.7 to 38.7" in said
    read(tmp_path, HEAD + 'hand = "my_hand.toml"\n' + RING + ALONE)
    for key in ("length_mm = 45.0", "middle = true"):
        assert "says nothing of this hand" in told(
            tmp_path, HEAD + 'hand = "leap"\n' + feels + ALONE + f"[pads]\n{key}\n")
    text = hand_text(replace(hand_named("leap"), pad_size=None))
    own.write_text(text)
    said = told(tmp_path, HEAD + 'hand = "my_hand.toml"\n' + feels + ALONE
                + "[pads]\nlength_mm = 15.0\n")
    assert "pads.length_mm: leap: finger index: pad of 15 mm does not fit link 3" in said
    assert "[pads] length_mm of a spec should be" in said
    read(tmp_path, HEAD + 'hand = "my_hand.toml"\n' + feels + ALONE + "[pads]\nlength_mm = 30.0\n")


@pytest.mark.parametrize("hand", ["utah_mit", "allegro", "leap", "barrett"])
def test_pads_as_they_ship_fit_their_hands(tmp_path: Path, hand: str) -> None:
    for order in ("planar", "contour"):
        read(tmp_path, HEAD + f'hand = "{hand}"\n' + RING + f'order = ["{order}"]\n' + ALONE)


def test_a_pad_around_its_link_is_refused(tmp_path: Path) -> None:
    wide = hand_text(hand_named("allegro")).replace("width_mm = 12.7", "width_mm = 45.0")
    (tmp_path / "my_hand.toml").write_text(wide)
    said = told(tmp_path, HEAD + 'hand = "my_hand.toml"\n' + RING + 'order = ["planar"]\n' + ALONE)
    assert ("finger index, link joint_3.0: pad of 45 mm is wider than the palmar half of a link; "
            "width_mm should be 42.1 mm at most") in said


def test_a_pad_on_a_ball_is_told_its_length(tmp_path: Path) -> None:
    """With so many digits that it fits."""
    leap = hand_named("leap")
    ball = (Capsule((0.0, -0.03, 0.015), (0.0, -0.03, 0.015), 0.01),)
    fingers = tuple(replace(finger, joints=(*finger.joints[:-1], replace(
        finger.joints[-1], shapes=ball))) for finger in leap.fingers)
    own = tmp_path / "my_hand.toml"
    text = hand_text(replace(leap, fingers=fingers))
    own.write_text(text)
    spec = HEAD + 'hand = "my_hand.toml"\n' + RING + 'order = ["containment", "planar"]\n' + ALONE
    said = told(tmp_path, spec)
    assert "does not fit link 3 that is a ball; [pads] length_mm of the file of the hand" in said
    length = said.partition("should be ")[2].partition(",")[0]
    own.write_text(text.replace("length_mm = 25.4", f"length_mm = {length}"))
    read(tmp_path, spec)


@pytest.mark.parametrize(("hand", "searched", "when"), [
    ('hand = "leap"\n', "", ""),
    ("", 'hand = ["utah_mit", "leap"]\n', ', when = { hand = ["leap"] }')])
def test_hands_that_cannot_be_closed_at_the_end_of_a_search_are_refused(
        tmp_path: Path, hand: str, searched: str, when: str) -> None:
    text = HEAD + hand + RING + "[search]\n" + searched
    text += f'"hand.link_density_kg_m3" = {{ low = 1000, high = 20000{when} }}\n'
    assert "finger index sags by its own weight" in told(tmp_path, text)


def test_hands_that_cannot_be_closed_are_refused(tmp_path: Path) -> None:
    """Of more fingers than can meet, or that sag; by the keys that mend it."""
    model, own = hand_named("leap"), tmp_path / "my_hand.toml"
    few = model.fingers[0]
    fingers = tuple(replace(few, name=f"f{n}", pads=(), pad_places=(), joints=tuple(
        replace(joint, name=f"f{n}_{joint.name}") for joint in few.joints)) for n in range(6))
    moves = tuple(joint.name for finger in fingers for joint in finger.joints)
    own.write_text(hand_text(replace(
        model, fingers=fingers, thumb="", extended=None, opposed=None,
        postures=(Posture("open", ()), Posture("closed", tuple((m, 0.2) for m in moves))),
        closings=(HandClosing("grasp", "open", "closed", moves),))))
    text = HEAD + 'hand = "my_hand.toml"\n' + RING
    said = told(tmp_path, text)
    assert ":3: hand.kind: " in said
    assert "6 fingers; 5 at most can meet: [contact] self_contact should be false" in said
    read(tmp_path, text + "[contact]\nself_contact = false\n")
    own.write_text(hand_text(model).replace("stiffness_Nm_rad = 2.0", "stiffness_Nm_rad = 0.1"))
    said = told(tmp_path, text)
    assert "sags by its own weight" in said
    assert "stiffness_Nm_rad" in said
    dense = "[sweep.grid]\n\"hand.link_density_kg_m3\" = [100, 1000]\n"
    assert "with hand.link_density_kg_m3 = 1000: " in told(tmp_path, text + dense)
    read(tmp_path, text + "[contact]\nweight = false\n")
    read(tmp_path, text + 'order = ["planar"]\n')


def test_fingers_that_hang_too_far_are_told(tmp_path: Path) -> None:
    """To first order alone the kernels know where they hang: servos of 0.1 put tips 1 mm off."""
    text = HEAD + RING + "[hand]\njoint_stiffness_Nm_rad = {}\n"
    said = told(tmp_path, text.format(0.1))
    assert "hand.joint_stiffness_Nm_rad: the fingers' own weight turns their joints by 0.37" in said
    read(tmp_path, text.format(0.5))
    read(tmp_path, text.format(0.1) + "[contact]\nweight = false\n")
    swept = '[sweep.grid]\n"hand.link_density_kg_m3" = [1000, 20000]\n'
    assert "with hand.link_density_kg_m3 = 20000: the fingers' own" in told(
        tmp_path, text.format(2.0) + swept)


def test_fingers_that_overlap_as_they_are_built_are_told(tmp_path: Path) -> None:
    """Straight fingers lie in one another where they stand nearer than a link is thick."""
    text = HEAD + RING
    close = text + "[hand]\nlink_radius_mm = {}\n{} = {}\n"
    for radius, key, apart in ((8, "finger_spacing_mm", 14), (8, "finger_spacing_mm", 0),
                               (10.2, "palm_gap_mm", 20)):
        said = told(tmp_path, close.format(radius, key, apart))
        assert f":7: hand.{key}: links of {radius} mm radius overlap" in said
        assert f"{key} should be {2 * radius:g} at least, or link_radius_mm {apart / 2:g}" in said
    read(tmp_path, close.format(9, "finger_spacing_mm", 18))
    read(tmp_path, close.format(10, "palm_gap_mm", 20))
    for axes, where in (('[sweep.grid]\n"hand.finger_spacing_mm" = [20, 28]\n'
                         '"hand.link_radius_mm" = [8, 12]\n', ":5: sweep: "),
                        ('[search]\n"hand.finger_spacing_mm" = {low = 20, high = 28}\n'
                         '"hand.link_radius_mm" = {low = 8, high = 12}\n', ":5: search: ")):
        said = told(tmp_path, text + axes)
        assert "with hand.finger_spacing_mm = 20" in said
        assert "hand.link_radius_mm = 12" in said
        assert where in said


def test_the_estimates_of_a_hand_may_be_varied(tmp_path: Path) -> None:
    """No end of a bracket of `warpgrasp sensitivity` is refused."""
    read(tmp_path, sensitivity_spec())


def test_the_robot_that_is_not_swept_is_looked_at_too(tmp_path: Path) -> None:
    """Its table is that of the spec, which no setting of the sweep shows."""
    text = HEAD + RING + ("[robot]\nswept = \"truth\"\n[hand]\njoint_stiffness_Nm_rad = 0.1\n"
                          '[sweep.grid]\n"hand.joint_stiffness_Nm_rad" = [1.0, 2.0]\n')
    assert "of the robot that is not swept: the fingers' own weight" in told(tmp_path, text)
    read(tmp_path, text.replace("_rad = 0.1", "_rad = 2.0"))
