"""The picture of a hand shows the frame that its file says, or guesses."""

import numpy as np
import pytest
from drawn_text import texts

from sweeps.report.hand_picture import axis_solids, hand_picture, posture_solids
from warpgrasp.hands.hand_file import SHIPPED, hand_named
from warpgrasp.hands.hand_frames import finger_tips, link_frames, matrix_of, posture_angles
from warpgrasp.hands.hand_model import Box


@pytest.mark.parametrize("name", [name for name in SHIPPED if name != "utah_mit"])
def test_a_picture_names_the_approach(name: str) -> None:
    drawn = hand_picture(hand_named(name))
    written = [text for text, _ in texts(drawn)]
    assert {"x", "approach (z)", "tip"} <= set(written)


def test_axes_are_those_of_the_frame_of_the_grasp() -> None:
    (x, _), (z, _) = axis_solids(0.1)
    for faces, axis in ((x, 0), (z, 2)):
        points = faces.reshape(-1, 3)
        assert points[:, axis].max() == pytest.approx(0.1, abs=0.003)
        assert np.abs(np.delete(points, axis, axis=1)).max() < 0.0025


@pytest.mark.parametrize("name", ["leap", "barrett"])
def test_shapes_and_tips_stand_where_the_hand_has_them(name: str) -> None:
    """Each solid is as far from its shape's middle as the shape reaches; tips come last."""
    model = hand_named(name)
    q = posture_angles(model, model.posture("closed"))
    solids = iter(posture_solids(model, q))
    to_grasp = np.linalg.inv(matrix_of(model.grasp_frame))
    frames = [np.eye(4)] * len(model.palm) + [
        frame for finger, own in zip(model.fingers, link_frames(model, q[None]), strict=True)
        for joint, frame in zip(finger.joints, own[0], strict=True) for _ in joint.shapes]
    shapes = [*model.palm, *(shape for joint in model.joints for shape in joint.shapes)]
    for frame, shape, (faces, _) in zip(frames, shapes, solids, strict=False):
        box = isinstance(shape, Box)
        middle = np.array(shape.place[:3] if box else np.add(shape.start, shape.end) / 2)
        reach = np.linalg.norm(shape.size) / 2 if box else (
            np.linalg.norm(np.subtract(shape.end, shape.start)) / 2 + shape.radius)
        at = to_grasp @ frame @ [*middle, 1.0]
        away = np.linalg.norm(faces.reshape(-1, 3) - at[:3], axis=1)
        assert away.max() == pytest.approx(reach, rel=1e-6)
        assert faces.reshape(-1, 3).min(0) + faces.reshape(-1, 3).max(0) == pytest.approx(
            2 * at[:3], abs=1e-3)
    balls = posture_solids(model, q)[len(shapes):]
    tips = finger_tips(model, q[None])[0] @ to_grasp[:3, :3].T + to_grasp[:3, 3]
    assert np.array([faces.mean((0, 1)) for faces, _ in balls]) == pytest.approx(tips, abs=1e-6)


def test_fingers_behind_the_palm_are_seen_from_the_other_side() -> None:
    drawn = hand_picture(hand_named("leap"))
    views = [axes for axes in drawn.axes if hasattr(axes, "azim")]
    assert [axes.get_title() for axes in views] == [
        "leap: open", "leap: closed", "leap: open, from behind", "leap: closed, from behind"]
    turns = [(views[n + 2].azim - views[n].azim) % 360.0 for n in (0, 1)]  # pyright: ignore
    assert turns == [180.0, 180.0]
