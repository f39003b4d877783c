"""A user's function: what it may return, and how its faults become data."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from fit.superquadric.geometry import Superquadric
from strategies.poses.waypoints import BoundingCylinder
from strategies.reconstruct.free_form import reconstruct
from strategies.reconstruct.plug_in import checked_mesh
from strategies.reconstruct.prior_distance import DistanceToRecovered
from strategies.recovery.choose_model import Recovered
from strategies.recovery.evidence import Evidence
from warpgrasp.parameters import FitTable

LOW, HIGH = np.full(3, -0.1), np.full(3, 0.1)
FUNCTIONS = '''
import numpy as np
import trimesh

def balls(touches):
    middle = (touches.low_m + touches.high_m) / 2
    return lambda points, worlds: np.linalg.norm(points - middle[worlds][:, None], axis=2) - 0.03

def inside_out(touches):
    return lambda points, worlds: -balls(touches)(points, worlds)

def everywhere(touches):
    return lambda points, worlds: np.full(points.shape[:2], -1.0)

def nowhere(touches):
    return lambda points, worlds: np.full(points.shape[:2], 1.0)

def endless(touches):
    return lambda points, worlds: np.linalg.norm(points[..., :2], axis=2) - 0.03

def on_the_table(touches):
    return lambda points, worlds: np.linalg.norm(points - [0, 0, 0.01], axis=2) - 0.03

def forgets(touches):
    balls(touches)

def elsewhere(touches):
    ball = trimesh.creation.icosphere(2, 0.03)
    return [(ball.vertices + [1.0, 0, 0.03], ball.faces), (ball.vertices / 1e3, ball.faces)]

def twice_as_far(touches):
    return lambda points, worlds: 2.0 * balls(touches)(points, worlds)

def second_only(touches):
    return [None, trimesh.creation.icosphere(2, 0.03)]

def too_few(touches):
    return []

def writes(touches):
    touches.points_m[:] = 0.0
    return [None, None]

def leaves(touches):
    raise SystemExit(3)

def half(touches):
    ball = trimesh.creation.icosphere(2, 0.03)
    return [(ball.vertices, ball.faces), (ball.vertices, ball.faces[:-1])]

def writes_box(touches):
    touches.low_m[:] -= 0.05
    return balls(touches)

def writes_normals(touches):
    touches.normals[:] = 0.0
    return balls(touches)

def writes_asked(touches):
    def distance(points, worlds):
        points -= 0.01
        return balls(touches)(points, worlds)
    return distance

def writes_worlds(touches):
    def distance(points, worlds):
        found = balls(touches)(points, worlds)
        worlds[:] = 0
        return found
    return distance

class Late:
    faces = np.zeros((4, 3), int)

    @property
    def vertices(self):
        raise RuntimeError("the network is not there")

def late(touches):
    return [None, Late()]

def late_pair(touches):
    def pair():
        raise KeyError("no mesh")
        yield
    return [None, pair()]

def points_alone(touches):
    return [None, trimesh.PointCloud(np.zeros((9, 3)))]

def three(touches):
    ball = trimesh.creation.icosphere(2, 0.03)
    return [None, (ball.vertices, ball.faces, ball.face_normals)]

def file(touches):
    return [None, "ball.stl"]

def by_world(touches):
    return {0: None, 1: trimesh.creation.icosphere(2, 0.03)}

def not_real(touches):
    return lambda points, worlds: balls(touches)(points, worlds) + 0j

def not_finite(touches):
    return lambda points, worlds: np.full(points.shape[:2], np.nan)

def fails_far_off(touches):
    if (touches.points_m[..., 0] > 0.1).any():
        raise KeyError("nothing so far off was learnt")
    return balls(touches)

def one_not_finite(touches):
    def distance(points, worlds):
        return np.where(worlds[:, None] == 1, np.inf, balls(touches)(points, worlds))
    return distance

def rod(touches):
    def distance(points, worlds):
        along = np.clip(points[..., 2:], 0.02, 0.06)
        return np.linalg.norm(points - along * [0, 0, 1], axis=2) - 0.004
    return distance
'''


def spheres(worlds: int = 2) -> Recovered:
    """Recovered spheres of 30 mm at the origin."""
    zero = np.zeros((worlds, 2))
    return Recovered(np.ones(worlds, int), Superquadric(
        np.full((worlds, 3), 0.03), np.ones((worlds, 2)), np.zeros((worlds, 3)),
        np.tile([0.0, 0, 0, 1], (worlds, 1)), zero, zero))


def felt(points: np.ndarray) -> Evidence:
    """Contacts (world, point, 3) of 1 mm, and nothing else."""
    mask = np.ones(points.shape[:2], bool)
    return Evidence(points, mask, np.tile(1e-6 * np.eye(3), (*mask.shape, 1, 1)),
                    np.full(points.shape, np.nan), np.zeros((len(points), 0, 3)), 0.006,
                    np.zeros((len(points), 0), bool), np.zeros_like(mask),
                    np.full(mask.shape, np.inf))


def prior(worlds: int = 2) -> BoundingCylinder:
    return BoundingCylinder(*np.zeros((2, worlds)), np.full(worlds, 0.04), np.full(worlds, 0.08))


@pytest.fixture
def asked(tmp_path):
    """Runs one of `FUNCTIONS` on two worlds."""
    (tmp_path / "mine.py").write_text(FUNCTIONS)
    evidence = felt(np.random.default_rng(0).normal(size=(2, 9, 3)))
    return lambda name: reconstruct(f"{tmp_path}/mine.py:{name}", spheres(), evidence, prior(),
                                    FitTable())


def test_signed_distances_become_meshes(asked) -> None:
    found = asked("balls")
    assert found.name == "balls"
    assert found.made.all()
    assert not found.fault.any()
    for mesh in found.meshes:
        assert mesh.volume_m3 == pytest.approx(4 / 3 * np.pi * 0.03**3, rel=0.03)


def test_a_thin_rod_of_signed_distances_keeps_its_volume(asked) -> None:
    """On a grid of half as many cells along each side it lost 39 % of it."""
    for mesh in asked("rod").meshes:
        exact = np.pi * 0.004**2 * (0.04 + 4 / 3 * 0.004)
        assert mesh.volume_m3 == pytest.approx(exact, rel=0.1)


def test_a_world_without_an_answer_keeps_what_was_recovered(asked) -> None:
    found = asked("second_only")
    assert found.made.tolist() == [False, True]
    assert not found.fault.any()


def test_an_error_is_a_fault_of_the_worlds_that_it_is_about(tmp_path) -> None:
    """It was a fault of all."""
    (tmp_path / "mine.py").write_text(FUNCTIONS)
    points = np.full((7, 9, 3), 0.03)
    points[[1, 5], 2, 0] = 0.2
    found = reconstruct(f"{tmp_path}/mine.py:fails_far_off", spheres(7), felt(points), prior(7),
                        FitTable())
    assert np.flatnonzero(found.fault != "").tolist() == [1, 5]
    assert "KeyError: 'nothing so far off was learnt'" in found.fault[5]
    assert found.made.tolist() == [world not in (1, 5) for world in range(7)]
    alone = reconstruct(f"{tmp_path}/mine.py:balls", spheres(7), felt(points), prior(7), FitTable())
    for mine, other in zip(found.meshes, alone.meshes, strict=True):
        assert len(mine.faces) == 0 or np.array_equal(mine.vertices_m, other.vertices_m)


@pytest.mark.parametrize(("name", "said"), [
    ("too_few", "0 meshes for 2 worlds"), ("writes", "read-only"), ("leaves", "SystemExit"),
    ("writes_box", "read-only"), ("writes_normals", "read-only"), ("writes_asked", "read-only"),
    ("writes_worlds", "read-only"), ("not_real", "distances are complex"),
    ("forgets", "mine.py:24: forgets: answered with None; should be a list of a mesh or None"),
    ("not_finite", "not finite"), ("missing", "has no function 'missing'"),
])
def test_faults_name_the_function_and_what_is_wrong(asked, name: str, said: str) -> None:
    found = asked(name)
    assert not found.made.any()
    assert all(said in text for text in found.fault)


def test_distances_that_are_no_numbers_are_a_fault_of_their_world_alone(asked) -> None:
    found, whole = asked("one_not_finite"), asked("balls")
    assert found.made.tolist() == [True, False]
    assert found.fault[0] == ""
    assert "one_not_finite: a distance is not finite" in found.fault[1]
    assert np.array_equal(found.meshes[0].vertices_m, whole.meshes[0].vertices_m)


@pytest.mark.parametrize(("name", "cut"), [
    ("inside_out", [True, True]), ("everywhere", [True, True]), ("endless", [True, True]),
    ("balls", [False, False]), ("on_the_table", [False, False]),
])
def test_a_body_that_the_box_cuts_off_is_told(asked, name: str, cut: list[bool]) -> None:
    """Distances of the wrong sign are: outside of what was meant is the rest of the box."""
    found = asked(name)
    assert found.made.all()
    assert not found.fault.any()
    assert ["is cut off by the sides or the top of the box" in text for text in found.note] == cut
    assert [text != "" for text in found.note] == cut


@pytest.mark.parametrize(("name", "steep"), [("balls", False), ("twice_as_far", True)])
def test_what_are_no_distances_in_metres_is_told(asked, name: str, steep: bool) -> None:
    """Their zero set is right, but thin parts of it would be lost."""
    found = asked(name)
    assert found.made.all()
    assert ["change by more than the way" in text for text in found.note] == [steep] * 2


def test_a_body_in_another_frame_or_unit_is_told(asked) -> None:
    found = asked("elsewhere")
    assert found.made.all()
    assert "lies outside the box from low_m to high_m" in found.note[0]
    assert "its body is 0.06 mm across; should its vertices be in metres?" in found.note[1]


@pytest.mark.parametrize(("name", "none"), [
    ("nowhere", [True, True]), ("second_only", [True, False])])
def test_a_world_without_a_body_is_told(asked, name: str, none: list[bool]) -> None:
    found = asked(name)
    assert not found.fault.any()
    assert [f"{name}: gave no body, what was recovered stands" in text
            for text in found.note] == none


def test_a_fault_of_one_mesh_is_its_world_s_alone(asked) -> None:
    found = asked("half")
    assert found.made.tolist() == [True, False]
    assert found.fault[0] == ""
    assert "open" in found.fault[1]


@pytest.mark.parametrize(("name", "said"), [
    ("late", "vertices: RuntimeError: the network is not there"),
    ("late_pair", "pair: KeyError: 'no mesh'"), ("points_alone", "AttributeError"),
    ("three", ": is tuple of 3; should be a pair of vertices and faces, or"),
    ("file", ": is str; should be a pair"), ("by_world", ": is int; should be"),
])
def test_what_cannot_be_read_is_a_fault_of_its_world(asked, name: str, said: str) -> None:
    found = asked(name)
    assert not found.made.any()
    assert said in found.fault[1]


@pytest.mark.parametrize(("change", "said"), [
    (lambda v, f: (v[:, :2], f), "vertices of shape"), (lambda v, f: (v, f[:2]), "2 faces"),
    (lambda v, f: (v, f + len(v)), "faces name vertex"), (lambda v, f: (v, f[:, ::-1]), "outwards"),
    (lambda v, f: (v * np.nan, f), "not finite"), (lambda v, f: (v * 1e3, f), "in m"),
    (lambda v, f: (v, f.astype(float)), "whole numbers"), (lambda v, f: (v + 0j, f), "complex"),
    (lambda v, f: (v, np.where(f == 7, -1, f)), "faces name vertex -1 of 42; should be 0 to 41"),
    (lambda v, f: (v, np.concatenate([f[:1, ::-1], f[1:]])), "open, or"),
])
def test_meshes_are_checked(change, said: str) -> None:
    ball = trimesh.creation.icosphere(1, 0.03)
    good = np.array(ball.vertices), np.array(ball.faces)
    assert len(checked_mesh(good, LOW, HIGH).faces) == 80
    with pytest.raises(ValueError, match=said):
        checked_mesh(change(*good), LOW, HIGH)


def test_blocks_that_share_an_edge_are_not_said_to_be_open() -> None:
    """They were, though every edge borders as many faces of either way."""
    both = trimesh.util.concatenate([trimesh.creation.box([0.05] * 3).apply_translation(
        [x, x, 0.0]) for x in (-0.025, 0.025)])
    pair = np.array(both.vertices), np.array(both.faces)
    assert checked_mesh(pair, LOW, HIGH).volume_m3 == pytest.approx(2 * 0.05**3)
    vertices, number = np.unique(pair[0], axis=0, return_inverse=True)
    with pytest.raises(ValueError, match="an edge borders more than two faces"):
        checked_mesh((vertices, number.reshape(-1)[pair[1]]), LOW, HIGH)


def test_no_piece_of_a_mesh_is_inside_out() -> None:
    """Its volume counted as less than nothing; that of a cavity should."""
    ball, small = trimesh.creation.icosphere(1, 0.03), trimesh.creation.icosphere(1, 0.01)
    faces = np.concatenate([ball.faces, small.faces[:, ::-1] + len(ball.vertices)])
    for away in (0.0, 0.05):
        vertices = np.concatenate([ball.vertices, small.vertices + [away, 0.0, 0.0]])
        if not away:
            assert len(checked_mesh((vertices, faces), LOW, HIGH).faces) == 160
            continue
        with pytest.raises(ValueError, match="a piece of it is inside out"):
            checked_mesh((vertices, faces), LOW, HIGH)


def test_no_pieces_of_a_mesh_overlap() -> None:
    """What they share counted twice: such a block had 4/3 of its volume. Pieces may touch."""
    blocks = [trimesh.creation.box([0.06, 0.06, 0.08]) for _ in range(2)]
    for apart, twice in ((0.04, True), (0.0, True), (0.079, True), (0.08, False), (0.09, False)):
        one, other = blocks[0], blocks[1].copy()
        other.apply_translation([0.0, 0.0, apart])
        both = trimesh.util.concatenate([one, other])
        pair = np.array(both.vertices), np.array(both.faces)
        if twice:
            with pytest.raises(ValueError, match="pieces of it overlap"):
                checked_mesh(pair, LOW, HIGH)
        else:
            assert checked_mesh(pair, LOW, HIGH).volume_m3 == pytest.approx(2 * one.volume)


def test_the_mean_is_the_distance_to_what_was_recovered() -> None:
    points = np.array([[[0.05, 0, 0], [0, 0, 0.03], [0, 0.02, 0], [0, 0, 0]]])
    found = DistanceToRecovered(spheres())(points, np.array([1]))
    assert np.allclose(found, [[0.02, 0.0, -0.01, -0.03]], atol=1e-9)


def test_the_word_superquadric_rebuilds_nothing() -> None:
    assert reconstruct("superquadric", spheres(), felt(np.zeros((2, 9, 3))), prior(),
                       FitTable()) is None


def test_a_free_form_body_explains_what_the_model_leaves_over() -> None:
    way = np.random.default_rng(1).normal(size=(120, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    bump = 1.0 + 0.3 * (way[:, :1] > 0.6) * way[:, :1]
    evidence = felt(np.stack([0.03 * way, 0.03 * bump * way]))
    evidence = replace(evidence, normals=np.stack([way, way]))
    found = reconstruct("implicit", spheres(), evidence, prior(), FitTable(table_plane=False))
    assert found is not None
    assert found.made.all()
    ball = 4 / 3 * np.pi * 0.03**3
    assert found.meshes[0].volume_m3 == pytest.approx(ball, rel=0.1)
    assert found.meshes[1].volume_m3 > 1.05 * ball
    assert found.meshes[1].vertices_m[:, 0].max() > 0.0355
