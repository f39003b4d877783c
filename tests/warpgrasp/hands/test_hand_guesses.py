"""What a hand's first file guesses: which joints bend, how the thumb stands, what is closed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from warpgrasp.hands.hand_checks import check_hand
from warpgrasp.hands.hand_file import hand_from_file, hand_named
from warpgrasp.hands.hand_frames import (
    finger_tips,
    link_frames,
    matrix_of,
    place_of,
    posture_angles,
)
from warpgrasp.hands.hand_guesses import (
    CLOSED,
    CURLED,
    OPEN,
    WIDER_RAD,
    other_guesses,
    with_guesses,
)
from warpgrasp.hands.hand_model import (
    STILL,
    Box,
    Capsule,
    Finger,
    Follow,
    HandJoint,
    HandModel,
    Vector,
    vector_of,
)
from warpgrasp.hands.hand_writer import hand_text
from warpgrasp.hands.urdf_hand import farthest_point

ACROSS, ASIDE, UP = (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
Range = tuple[float, float]


def finger(name: str, x: float, axes: tuple[Vector, ...], ranges: tuple[Range, ...],
           turn: float = 0.0) -> Finger:
    """Links of 40 mm that point along z, from a base at x, turned about z."""
    skin = (Capsule((0.0, 0.0, 0.0), (0.0, 0.0, 0.04), 0.008),)
    base = (x, 0.0, 0.0, 0.0, 0.0, np.sin(turn / 2), np.cos(turn / 2))
    places = [base, *[(0.0, 0.0, 0.04, 0.0, 0.0, 0.0, 1.0)] * (len(axes) - 1)]
    return Finger(name, tuple(
        HandJoint(f"{name}{n}", place, axis, *limits, 0.0, 2.0, None, skin)
        for n, (place, axis, limits) in enumerate(zip(places, axes, ranges, strict=True))),
        (0.0, 0.0, 0.04), ())


def guessed(*fingers: Finger) -> HandModel:
    return with_guesses(HandModel("x", "", "", STILL, (), fingers, "", "nothing", (), ()))


def angles(model: HandModel, posture: str) -> dict[str, float]:
    return dict(model.posture(posture).angles_rad)


def test_a_hand_of_symmetric_ranges_closes_and_is_read_again(tmp_path: Path) -> None:
    both = ((-1.2, 1.2),) * 2
    model = guessed(*(finger(name, 0.1 * n, (ACROSS,) * 2, both) for n, name in enumerate("abc")))
    assert len(model.closings[0].moves) == 6
    file = tmp_path / "hand.toml"
    file.write_text(hand_text(model, guessed=True))
    assert hand_from_file(file).closings == model.closings


def test_joints_that_spread_a_finger_do_not_close_it() -> None:
    """By their axes, though their ranges lie on one side; a rest beyond zero is a limit."""
    model = guessed(*(finger(name, x, (ASIDE, ACROSS, ACROSS), ((0.0, 1.0), (0.2, 1.2), (0.0, 1.0)))
                      for name, x in (("a", 0.0), ("b", 0.02))))
    assert model.closings[0].moves == ("a1", "a2", "b1", "b2")
    assert angles(model, "open") == pytest.approx(dict.fromkeys(("a1", "b1"), 0.2 + OPEN))
    assert angles(model, "closed") == pytest.approx(
        {"a1": 0.2 + CLOSED, "b1": 0.2 + CLOSED, "a2": CURLED, "b2": CURLED})


def test_a_gripper_is_open_as_it_stands() -> None:
    model = guessed(finger("a", -0.05, (ACROSS,), ((0.0, 1.0),)),
                    finger("b", 0.05, (ACROSS,), ((0.0, 1.0),), np.pi))
    assert not any(angles(model, "open").values())


def test_a_thumb_is_turned_against_the_fingers() -> None:
    """One that bends beside them, as it stands."""
    ranges = ((-1.0, 4.0), (0.0, 1.0))
    fingers = (finger(name, -0.05, (ACROSS, ACROSS), ((0.0, 1.0),) * 2) for name in "ab")
    model = guessed(*fingers, finger("thumb", 0.05, (UP, ACROSS), ranges, np.pi / 2))
    assert model.thumb == "thumb"
    turned = angles(model, "open")["thumb0"]
    assert angles(model, "closed")["thumb0"] == turned
    assert "thumb1" not in angles(model, "open")
    axes = [frames[0, -1, :3, :3] @ ACROSS for frames in
            link_frames(model, posture_angles(model, model.posture("open"))[None])]
    assert axes[-1] @ axes[0] < -0.95
    frame = matrix_of(model.grasp_frame)
    assert frame[:3, 3] == pytest.approx(0.0, abs=1e-9)  # between the bases of fingers and thumb
    assert frame[0, 0] > 0.0


def test_a_thumb_that_can_stand_against_the_fingers_in_two_ways_turns_the_shorter_one() -> None:
    fingers = [finger(name, -0.05, (ACROSS, ACROSS), ((0.0, 1.0),) * 2) for name in "ab"]
    for sign in (1.0, -1.0):
        limits = sorted((-1.5 * np.pi * sign, 0.5 * np.pi * sign))  # a whole turn apart
        model = guessed(*fingers, finger("thumb", 0.05, (UP, ACROSS),
                                         ((limits[0], limits[1]), (0.0, 1.0)), sign * np.pi / 2))
        assert angles(model, "open")["thumb0"] == pytest.approx(sign * np.pi / 2)


def test_a_joint_whose_axis_points_the_other_way_bends_its_finger_too() -> None:
    back = (0.0, -1.0, 0.0)
    model = guessed(*(finger(name, x, (ACROSS, back), ((0.0, 1.0), (-1.0, 0.0)))
                      for name, x in (("a", 0.0), ("b", 0.02))))
    assert model.closings[0].moves == ("a0", "a1", "b0", "b1")


def test_the_tip_of_a_link_about_its_joint_is_where_the_finger_leads() -> None:
    """Its middle is the joint but for rounding, which led to a place off the link's skin."""
    along, off = np.array([0.6, 0.0, 0.8]), np.array([1e-6, 3e-6, -1e-6])
    rod = Capsule(vector_of(off - 0.02 * along), vector_of(off + 0.02 * along), 0.008)
    for sign in (1.0, -1.0):
        tip = farthest_point((rod,), sign * 0.05 * along)
        assert tip @ along == pytest.approx(sign * 0.028, abs=0.003)
        assert np.linalg.norm(np.cross(tip, along)) < 1e-6
    ball = Capsule((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 0.01)
    assert farthest_point((ball,), np.array([0.0, 0.0, 0.03])) == pytest.approx((0, 0, 0.01))
    assert np.linalg.norm(farthest_point((ball,), np.zeros(3))) == pytest.approx(0.01)
    ahead = Capsule((0.0, 0.0, 0.0), (0.0, 0.04, 0.0), 0.008)  # whatever leads there
    assert farthest_point((ahead,), np.array([0.0, 0.0, -1.0])) == pytest.approx((0, 0.048, 0))
    box = Box((0.0, 0.0, 0.02, *STILL[3:]), (0.03, 0.02, 0.04))  # its corners lie farther off
    assert farthest_point((box,), np.zeros(3)) == pytest.approx((0, 0, 0.04))


@pytest.mark.parametrize("coupled", [False, True])
def test_a_hand_approaches_square_to_its_straight_fingers(coupled: bool) -> None:
    """However far the open hand's fingers are bent: so its palm faces the object. Those of one
    drive each are bent in all joints, and all the same their tips pass well before the palm."""
    ranges = ((-0.1, 1.6), (0.0, 1.5), (0.0, 1.5))
    fingers = [finger(name, 0.0, (ACROSS,) * 3, ranges) for name in "abc"]
    if coupled:
        fingers = [replace(one, joints=(one.joints[0], *(
            replace(joint, follows=Follow(one.joints[0].name, 0.9, 0.0))
            for joint in one.joints[1:]))) for one in fingers]
    thumb = finger("thumb", 0.03, (UP, ACROSS), ((-0.2, 0.2), (0.0, 1.0)), np.pi / 2)
    model = guessed(*fingers, thumb)
    frame = matrix_of(model.grasp_frame)
    np.testing.assert_allclose(frame[:3, 2], [1.0, 0.0, 0.0], atol=5e-3)
    ways = np.linspace(*(posture_angles(model, model.posture(name)) for name in ("open", "closed")))
    heights = (finger_tips(model, ways) - frame[:3, 3]) @ frame[:3, 2]
    assert (heights[:, :3].max(0) > 0.05).all()


def gripper(ways: tuple[float, ...], ranges: tuple[Range, ...] = ((0.0, 1.0),) * 2,
            axis: Vector = ACROSS) -> HandModel:
    """Fingers that stand 30 mm apart along y, on either side of the hand: +1 at -x, -1 at x. All
    bend across, towards the other side."""
    fingers = [finger(f"f{n}", -0.05 * way, (axis,) * len(ranges), ranges,
                      0.0 if way > 0 else np.pi) for n, way in enumerate(ways)]
    return guessed(*(replace(one, joints=(replace(
        one.joints[0], place=(one.joints[0].place[0], 0.03 * n, *one.joints[0].place[2:])),
        *one.joints[1:])) for n, one in enumerate(fingers)))


@pytest.mark.parametrize("ways", [(1, -1), (1, 1, -1), (1, -1, 1, -1), (1, -1, 1, -1, 1)])
def test_a_gripper_of_any_fingers_points_at_what_it_closes_on(ways: tuple[float, ...]) -> None:
    """Also where fingers of one side are left when one of them is taken for the thumb."""
    model = gripper(ways)
    frame = matrix_of(model.grasp_frame)
    assert frame[:3, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert abs(frame[0, 0]) == pytest.approx(1.0, abs=0.3)  # along which it closes
    if len(ways) > 2:
        thumb = [one.name for one in model.fingers].index(model.thumb)
        assert ways.count(ways[thumb]) <= len(ways) / 2  # of the side of fewer fingers


def test_a_gripper_of_leaning_fingers_points_between_them() -> None:
    """Not where the fingers of one side lean."""
    lean = np.array([0.0, np.sin(0.2), 0.0, np.cos(0.2)])  # about y
    fingers = []
    for name, x, half_turn in (("a", -0.05, False), ("b", -0.05, False), ("thumb", 0.05, True)):
        one = finger(name, x, (ACROSS, ACROSS), ((0.0, 1.0),) * 2)
        q = (lean[1], 0.0, lean[3], 0.0) if half_turn else (0.0, -lean[1], 0.0, lean[3])
        y = 0.03 * (name == "b") - 0.015 * (name != "thumb")
        fingers.append(replace(one, joints=(replace(one.joints[0], place=(x, y, 0.0, *q)),
                                            *one.joints[1:])))
    model = guessed(*fingers)
    frame = matrix_of(model.grasp_frame)
    assert frame[:3, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
    assert frame[:3, 0] == pytest.approx([1.0, 0.0, 0.0], abs=1e-6)


def test_a_gripper_opens_as_far_as_its_joints_say() -> None:
    """Those next to the palm first, and by 0.7 rad in all; others not."""
    opened = angles(gripper((1, -1), ((-0.5, 1.0), (-0.5, 1.0), (0.0, 1.0))), "open")
    for n in (0, 1):
        assert opened[f"f{n}0"] == pytest.approx(-0.5)
        assert opened[f"f{n}1"] == pytest.approx(-0.2)
        assert f"f{n}2" not in opened
    both = angles(gripper((1, -1), ((-1.2, 1.2),) * 2), "open")
    assert not any(both.values())  # these ranges do not say what is open


def test_joints_of_symmetric_ranges_close_towards_the_other_fingers() -> None:
    """To whichever side their axes point."""
    for axis in (ACROSS, (0.0, -1.0, 0.0)):
        model = gripper((1, -1, 1), ((-1.2, 1.2),) * 2, axis)
        tips = finger_tips(model, np.stack([
            posture_angles(model, model.posture(name)) for name in ("open", "closed")]))
        assert (np.abs(tips[1, :, 0]) < np.abs(tips[0, :, 0])).all()


def test_a_thumb_beside_the_fingers_makes_no_gripper() -> None:
    """Its tip goes against theirs, but it stands no farther ahead than they do: the palm faces the
    object, unless the gap between thumb and fingers leaves more room."""
    fingers = [finger(name, 0.0, (ACROSS,) * 2, ((0.0, 1.5),) * 2) for name in "abc"]

    def with_thumb(ahead_m: float) -> HandModel:
        thumb = finger("thumb", ahead_m, (ACROSS,) * 2, ((0.0, 1.5),) * 2, np.pi)
        place = (ahead_m, 0.04, -0.03, *thumb.joints[0].place[3:])
        return guessed(*fingers, replace(thumb, joints=(
            replace(thumb.joints[0], place=place), *thumb.joints[1:])))

    beside = with_thumb(0.005)
    assert matrix_of(beside.grasp_frame)[:3, 2] == pytest.approx([1.0, 0.0, 0.0], abs=5e-3)
    assert angles(beside, "open")["a0"] == pytest.approx(OPEN * 1.5)
    across = with_thumb(0.06)
    assert matrix_of(across.grasp_frame)[:3, 2] == pytest.approx([0.0, 0.0, 1.0], abs=1e-6)
    assert not any(angles(across, "open").values())


@pytest.mark.parametrize("places", [(0.0,), (-0.02, 0.02)])
def test_fingers_side_by_side_without_a_thumb_face_the_object_too(
    places: tuple[float, ...]
) -> None:
    """They close towards it, not beside it."""
    fingers = [finger(f"f{n}", 0.0, (ACROSS,) * 2, ((-0.1, 1.5),) * 2)
               for n in range(len(places))]
    model = guessed(*(replace(one, joints=(
        replace(one.joints[0], place=(0.0, y, *one.joints[0].place[2:])), *one.joints[1:]))
        for one, y in zip(fingers, places, strict=True)))
    assert matrix_of(model.grasp_frame)[:3, 2] == pytest.approx([1.0, 0.0, 0.0], abs=5e-3)


@pytest.mark.parametrize("ways", [(1, -1), (1, 1, -1), (1, -1, 1, -1, 1)])
@pytest.mark.parametrize("seed", range(3))
def test_guesses_turn_with_the_palm(ways: tuple[float, ...], seed: int) -> None:
    """The frame of its link is its maker's choice."""
    plain = gripper(ways, ((-0.2, 1.0), (-1.2, 1.2), (0.0, 1.0)))
    turn = np.eye(4)
    turn[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    turn[:3, 3] = [0.1, -0.2, 0.3]
    turned = guessed(*(replace(one, joints=(
        replace(one.joints[0], place=place_of(turn @ matrix_of(one.joints[0].place))),
        *one.joints[1:])) for one in plain.fingers))
    np.testing.assert_allclose(matrix_of(turned.grasp_frame), turn @ matrix_of(plain.grasp_frame),
                               atol=1e-9)
    assert turned.thumb == plain.thumb
    for posture in ("open", "closed"):
        assert angles(turned, posture) == pytest.approx(angles(plain, posture))


def test_a_single_finger_is_no_thumb_whatever_its_name() -> None:
    model = guessed(finger("thumb", 0.0, (ACROSS,) * 2, ((-0.1, 1.5),) * 2))
    assert model.thumb == ""
    assert matrix_of(model.grasp_frame)[:3, 2] == pytest.approx([1.0, 0.0, 0.0], abs=5e-3)


@pytest.mark.parametrize("name", ["allegro", "leap", "barrett"])
def test_other_guesses_are_hands_that_differ_in_thumb_or_frame(name: str) -> None:
    model = replace(hand_named(name), extended=None, opposed=None)  # as from a URDF
    first, others = with_guesses(model), other_guesses(model)
    assert first not in others
    assert len(others) > (20 if name != "barrett" else 0)
    for other in others:
        check_hand(other)
        assert other.fingers == first.fingers
        assert (other.postures, other.grasp_frame) != (first.postures, first.grasp_frame)


def test_other_guesses_open_joints_whose_ranges_do_not_say_which_side_is_open() -> None:
    """Away from each other, where the hand closes; no joint farther than it turns."""
    ranges = ((-1.2, 1.2), (-0.5, 0.5))
    first = guessed(finger("a", -0.05, (ACROSS,) * 2, ranges),
                    finger("b", 0.05, (ACROSS,) * 2, ranges, np.pi))
    assert not angles(first, "open")
    wider = [angles(other, "open") for other in other_guesses(first)]
    for opened in WIDER_RAD:
        assert {"a0": -opened, "b0": -opened} in [
            {name: round(angle, 9) for name, angle in one.items() if angle} for one in wider]
    tips = [finger_tips(other, posture_angles(other, other.posture("open"))[None])[0, :, 0]
            for other in other_guesses(first)]
    assert max(b - a for a, b in tips) > 0.1 + 2 * 0.08 * np.sin(0.6)
