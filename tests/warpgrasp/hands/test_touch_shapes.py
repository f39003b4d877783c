"""What a hand touches with does not depend on the frames that its links are said in."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sweeps.cli import main as cli
from warpgrasp.hands.capsule_fit import skin_notes
from warpgrasp.hands.hand_file import hand_named
from warpgrasp.hands.hand_frames import matrix_of, place_of
from warpgrasp.hands.hand_model import Box, Capsule, HandModel, Shape, vector_of
from warpgrasp.hands.hand_writer import hand_text
from warpgrasp.hands.touch_shapes import bulk_of, touch_model


def box(at: tuple[float, float, float], size: tuple[float, float, float], turn_y: float = 0.0
        ) -> Box:
    return Box((*at, 0.0, float(np.sin(turn_y / 2)), 0.0, float(np.cos(turn_y / 2))), size)


def ball(at: tuple[float, float, float], radius: float = 0.006) -> Capsule:
    return Capsule(at, at, radius)


ROD = Capsule((0.0, 0.0, 0.0), (0.0, 0.0, 0.03), 0.009)
BRICK = (0.012, 0.014, 0.03)
LINKS: dict[str, tuple[Shape, ...]] = {
    "square plate": (box((0.0, 0.0, 0.02), (0.08, 0.08, 0.02)),),
    "two boxes as large": (box((0.0, 0.0, 0.015), BRICK), box((0.003, 0.0, 0.02), BRICK, 0.8)),
    "five balls in a row": tuple(ball((0.0, 0.0, 0.012 * k)) for k in range(5)),
    "balls in a square": tuple(ball((x, y, 0.01)) for x in (0.0, 0.03) for y in (0.0, 0.03)),
    "a ball and a box": (ball((0.0, 0.01, 0.0), 0.01), box((0.01, 0.0, 0.01), (0.01, 0.004, 0.02))),
    "a rod and a box": (ROD, box((0.002, 0.0, 0.03), (0.012, 0.014, 0.02), 0.2)),
}


def with_link(shapes: tuple[Shape, ...]) -> HandModel:
    """The Barrett hand, the first link of its first finger with other shapes, its palm bare."""
    model = hand_named("barrett")
    first = model.fingers[0]
    joints = (replace(first.joints[0], shapes=shapes), *first.joints[1:])
    return replace(model, palm=(), fingers=(replace(first, joints=joints), *model.fingers[1:]))


def skin(shapes: tuple[Shape, ...]) -> np.ndarray:
    """Ends and radius of the capsules, (capsule, 7)."""
    return np.array([(*c.start, *c.end, c.radius) for c in
                     touch_model(with_link(shapes)).joints[0].shapes if isinstance(c, Capsule)])


def moved(shape: Shape, frame: np.ndarray) -> Shape:
    if isinstance(shape, Box):
        return replace(shape, place=place_of(frame @ matrix_of(shape.place)))
    start, end = (frame[:3, :3] @ at + frame[:3, 3] for at in (shape.start, shape.end))
    return replace(shape, start=vector_of(start), end=vector_of(end))


@pytest.mark.parametrize("name", LINKS)
def test_a_link_in_another_frame_has_the_same_skin(name: str) -> None:
    """Rods of a square plate lay along or across it by the last bit of its sides."""
    plain = skin(LINKS[name])
    for turn in Rotation.random(20, rng=1):
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = turn.as_matrix(), (0.01, -0.02, 0.03)
        again = skin(tuple(moved(shape, frame) for shape in LINKS[name]))
        assert len(again) == len(plain)
        for at in (slice(0, 3), slice(3, 6)):
            assert again[:, at] == pytest.approx(plain[:, at] @ frame[:3, :3].T + frame[:3, 3],
                                                 abs=1e-9)
        assert again[:, 6] == pytest.approx(plain[:, 6])


@pytest.mark.parametrize("name", LINKS)
def test_a_link_in_another_frame_weighs_as_much(name: str) -> None:
    plain = bulk_of(LINKS[name]).volume_m3
    for turn in Rotation.random(5, rng=2):
        frame = np.eye(4)
        frame[:3, :3] = turn.as_matrix()
        again = bulk_of(tuple(moved(shape, frame) for shape in LINKS[name]))
        assert again.volume_m3 == pytest.approx(plain, rel=2e-3)
    row = bulk_of(LINKS["five balls in a row"]).volume_m3
    assert row == pytest.approx(np.pi * 0.006**2 * (0.048 + 4 / 3 * 0.006), rel=6e-3)


def test_balls_in_a_row_are_one_capsule() -> None:
    found, = skin(tuple(moved(s, matrix_of((0.0, 0.0, 0.0, 0.0, 0.3, 0.0, 0.91**0.5)))
                        for s in LINKS["five balls in a row"]))[:, 6]
    assert found == pytest.approx(0.006)


def test_what_a_skin_is_off_and_its_slits_are_said(tmp_path: Path,
                                                   capsys: pytest.CaptureFixture[str]) -> None:
    model = with_link((box((0.0, 0.0, 0.02), (0.004, 0.04, 0.04)),))
    model = replace(model, fingers=(replace(model.fingers[0], joints=tuple(
        replace(joint, shapes=joint.shapes if n == 0 else (ROD,))
        for n, joint in enumerate(model.fingers[0].joints))), *(
            replace(finger, joints=tuple(replace(joint, shapes=(ROD,)) for joint in finger.joints))
            for finger in model.fingers[1:])))
    off, slit = skin_notes(model)
    where = f"joint {model.joints[0].name}: "
    assert slit == (f"{where}between its capsules is a slit of 14.0 mm, the widest of this hand; "
                    "what is narrower passes through")
    assert off.startswith(f"{where}its skin of capsules lies off its shapes by at most ")
    assert not skin_notes(hand_named("utah_mit"))
    file = tmp_path / "hand.toml"
    file.write_text(hand_text(hand_named("leap")))
    assert cli.run(["hand", str(file), "-o", str(file)]) == 0
    assert "a slit of 16.0 mm, the widest" in capsys.readouterr().err
