"""What a hand touches with does not depend on the frames that its links are said in."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from sweeps.cli import main as cli
from warpgrasp.hands.capsule_fit import capsule_of_cylinder, fit_shape, skin_notes
from warpgrasp.hands.hand_file import hand_named
from warpgrasp.hands.hand_frames import matrix_of, place_of
from warpgrasp.hands.hand_model import Box, Capsule, HandModel, Shape, vector_of
from warpgrasp.hands.hand_writer import hand_text
from warpgrasp.hands.touch_shapes import bulk_of, palmar_directions, touch_model


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


def test_a_capsule_and_boxes_weigh_what_their_hulls_do() -> None:
    """A capsule has a formula of its own, which its hull agrees with."""
    alone, within = bulk_of((ROD,)), bulk_of((ROD, ball((0.0, 0.0, 0.015), 0.004)))
    assert alone.volume_m3 == pytest.approx(within.volume_m3, rel=0.01)
    assert alone.centre_m == pytest.approx(within.centre_m, abs=1e-5)
    ends = box((0.0, 0.0, 0.0), (0.03, 0.02, 0.01)), box((0.01, 0.0, 0.05), (0.006, 0.004, 0.002))
    corners = np.concatenate([
        trimesh.creation.box(b.size).vertices + b.place[:3] for b in ends])
    hull = trimesh.convex.convex_hull(corners)
    assert bulk_of(ends).volume_m3 == pytest.approx(hull.volume)
    assert bulk_of(ends).centre_m == pytest.approx(tuple(hull.center_mass))


def test_a_capsule_closes_across_its_axis_towards_where_it_moves() -> None:
    moved, along = np.random.default_rng(3).normal(size=(2, 40, 3))
    moved[::4], along[::8] = 3.0 * along[::4], 0.0  # moves along its axis; is a ball
    found = palmar_directions(moved, along)
    assert np.linalg.norm(found, axis=1) == pytest.approx(1.0)
    assert (found * along).sum(1) == pytest.approx(0.0, abs=1e-12)
    aside = np.arange(40) % 4 > 0
    normal = np.cross(moved, along)[aside]  # of the plane of motion and axis
    assert (found[aside] * normal).sum(1) == pytest.approx(0.0, abs=1e-12)
    assert ((found * moved).sum(1)[aside] > 0.0).all()


@pytest.mark.parametrize(("radius", "length"), [(0.01, 0.012), (0.01, 0.03), (0.005, 0.06)])
def test_the_capsule_of_a_cylinder_is_nearest_to_its_surface_in_the_mean(
        radius: float, length: float) -> None:
    """By points spread evenly over it; its rim is farthest off, or as far as an end's middle."""
    mesh = trimesh.creation.cylinder(radius, length, sections=256)
    points = trimesh.sample.sample_surface(mesh, 100_000, seed=1)[0]
    off, up = np.hypot(points[:, 0], points[:, 1]), np.abs(points[:, 2])

    def square(half: float, thick: float) -> float:
        return float(((np.hypot(off, np.maximum(up - half, 0.0)) - thick) ** 2).mean())

    half, thick, error = capsule_of_cylinder(radius, length)
    for change in (-3e-4, 3e-4):
        assert square(half, thick) <= square(max(half + change, 0.0), thick)
        assert square(half, thick) < square(half, thick + change / 3)
    rim, middle = np.hypot(radius, length / 2 - half), length / 2 - half
    assert error == pytest.approx(max(rim - thick, abs(middle - thick), abs(radius - thick)),
                                  abs=1e-9)


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
    apart = skin_notes(replace(model, fingers=(replace(model.fingers[0], joints=(
        replace(model.fingers[0].joints[0], shapes=(
            box((0.0, 0.0, 0.005), (0.01,) * 3), box((0.0, 0.0, 0.055), (0.01,) * 3))),
        *model.fingers[0].joints[1:])), *model.fingers[1:])))[0]
    # The skin fills the gap of 40 mm between boxes; its middle is off both by nearly half of it.
    assert float(apart.split("at most ")[1].split()[0]) == pytest.approx(20.0, abs=1.0)
    file = tmp_path / "hand.toml"
    file.write_text(hand_text(hand_named("leap")))
    assert cli.run(["hand", str(file), "-o", str(file)]) == 0
    assert "a slit of 16.0 mm, the widest" in capsys.readouterr().err


def test_a_bulky_mesh_is_a_box_where_that_is_nearer() -> None:
    """A palm of 80 x 90 x 110 mm was a ball 18 mm off; of a barrel, or of what is small, the
    capsule is as near."""
    turn = trimesh.transformations.rotation_matrix(0.7, [1.0, 2.0, 0.5], [0.0, 0.0, 0.0])
    turn[:3, 3] = [0.01, -0.02, 0.03]
    block = trimesh.creation.box((0.08, 0.09, 0.11), transform=turn)
    palm = fit_shape(np.asarray(block.vertices))
    assert isinstance(palm, Box)
    assert sorted(palm.size) == pytest.approx([0.08, 0.09, 0.11], abs=1e-6)
    assert palm.fit_error_m == 0.0
    small = fit_shape(np.asarray(block.vertices) / 5.0)
    assert isinstance(small, Capsule)
    barrel = trimesh.creation.capsule(height=0.03, radius=0.04)
    assert isinstance(fit_shape(np.asarray(barrel.vertices)), Capsule)
    # Rounded: as near to either, which stays a capsule.
    sphere = trimesh.creation.icosphere(subdivisions=3, radius=0.06)
    assert isinstance(fit_shape(np.asarray(sphere.vertices) * [1.0, 1.2, 1.3]), Capsule)
