"""Polyhedra from planes: surfaces that close, volumes and distances known otherwise."""

import numpy as np
import pytest
import trimesh

from fit.interpretation_tree import interpret, interpret_sets, model_of_planes
from fit.polyhedron import polyhedron_distance, polyhedron_mesh

CUBE = np.concatenate([np.eye(3), -np.eye(3)])
SIZE_M = np.array([0.03, 0.04, 0.06])


def drawn_planes(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Planes about a point that are no corner's alone: a box and six more cuts."""
    rng = np.random.default_rng(seed)
    cuts = rng.normal(size=(6, 3))
    cuts /= np.linalg.norm(cuts, axis=1, keepdims=True)
    normals = np.concatenate([CUBE, cuts])
    return normals, np.append(np.tile(SIZE_M, 2), rng.uniform(0.03, 0.06, 6))


def test_a_box_has_its_volume_and_the_distance_that_a_formula_gives() -> None:
    normals, offset = CUBE, np.tile(SIZE_M, 2)
    assert polyhedron_mesh(normals, offset).volume_m3 == pytest.approx(8.0 * SIZE_M.prod())
    points = np.random.default_rng(0).uniform(-0.15, 0.15, (400, 3))
    beyond = np.abs(points) - SIZE_M
    known = np.linalg.norm(np.maximum(beyond, 0.0), axis=1) + np.minimum(beyond.max(1), 0.0)
    assert np.allclose(polyhedron_distance(normals, offset, points), known, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_any_polyhedron_closes_and_agrees_with_trimesh(seed: int) -> None:
    normals, offset = drawn_planes(seed)
    found = polyhedron_mesh(normals, offset)
    mesh = trimesh.Trimesh(found.vertices_m, found.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.is_convex
    hull = trimesh.convex.convex_hull(found.vertices_m)
    assert found.volume_m3 == pytest.approx(float(hull.volume), rel=1e-9)
    points = np.random.default_rng(seed + 10).uniform(-0.12, 0.12, (200, 3))
    signed = polyhedron_distance(normals, offset, points)
    away = trimesh.proximity.closest_point_naive(mesh, points)[1]
    assert np.allclose(np.abs(signed), away, atol=1e-8)
    assert ((signed < 0.0) == ((points @ normals.T) < offset).all(1)).all()


def test_planes_that_hold_nothing_have_no_surface_and_open_ones_are_refused() -> None:
    offset = np.append(np.tile(SIZE_M, 2), -0.1)  # beyond the box
    normals = np.append(CUBE, [[0.0, 0.0, 1.0]], axis=0)
    assert len(polyhedron_mesh(normals, offset).faces) == 0
    assert np.isinf(polyhedron_distance(normals, offset, np.zeros((2, 3)))).all()
    with pytest.raises(ValueError, match="close no body"):
        polyhedron_mesh(CUBE[:5], offset[:5])


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_planes_that_are_none_are_refused(number: float) -> None:
    offset = np.tile(SIZE_M, 2)
    offset[1] = number
    with pytest.raises(ValueError, match="not finite"):
        polyhedron_mesh(CUBE, offset)
    for few in (0, 1, 2):
        with pytest.raises(ValueError, match="close no body"):
            polyhedron_mesh(CUBE[:few], offset[:1].repeat(few))
    with pytest.raises(ValueError, match=r"points_m: shape \(3,\), should be \(any, 3\)"):
        polyhedron_distance(CUBE, np.tile(SIZE_M, 2), np.zeros(3))


def test_no_touch_lies_on_a_body_that_planes_leave_nothing_of() -> None:
    nothing = model_of_planes("nothing", CUBE, -np.tile(SIZE_M, 2))
    assert interpret(np.eye(3), np.eye(3), nothing, angle_rad=0.1, distance_m=0.01) == []


def test_touches_of_parallel_faces_tell_no_turn_and_do_not_disturb_others() -> None:
    box = model_of_planes("box", CUBE, np.tile(SIZE_M, 2))
    parallel = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    limits = {"angle_rad": 0.1, "distance_m": 0.002}
    assert interpret(parallel * SIZE_M, parallel, box, **limits) == []
    both = np.stack([parallel, np.eye(3)[:2]])
    none, found = interpret_sets(both * SIZE_M, both, box, **limits)
    assert none == []
    assert len(found) > 0
    assert [one.assignment for one in found] == [
        one.assignment for one in interpret(both[1] * SIZE_M, both[1], box, **limits)]


@pytest.mark.parametrize("length", [2.0, 0.0, np.nan])
def test_normals_that_are_no_unit_vectors_are_refused(length: float) -> None:
    """Angles between them would be wrong, and nothing would be found."""
    box, normals = model_of_planes("box", CUBE, np.tile(SIZE_M, 2)), np.eye(3)
    normals[1] *= length
    with pytest.raises(ValueError, match="a normal is no unit vector; divide it by its length"):
        interpret(np.eye(3) * SIZE_M, normals, box, angle_rad=0.1, distance_m=0.002)


@pytest.mark.parametrize(("sets", "touches"), [(0, 3), (0, 0), (2, 0)])
def test_no_sets_and_sets_without_touches_have_no_interpretation(sets: int, touches: int) -> None:
    box, nothing = model_of_planes("box", CUBE, np.tile(SIZE_M, 2)), np.zeros((sets, touches, 3))
    assert interpret_sets(nothing, nothing, box, angle_rad=0.1, distance_m=0.002) == [[]] * sets


@pytest.mark.parametrize(("turn", "beyond_m"), [
    (0.0, 0.0), (0.0, 5e-7), (1e-8, 0.0), (2e-5, 0.0), (5e-4, 0.0), (2e-3, 0.0)])
def test_a_plane_beside_another_leaves_the_surface_closed(turn: float, beyond_m: float) -> None:
    cube = np.concatenate([np.eye(3), -np.eye(3)])
    normals = np.vstack([cube, [np.cos(turn), np.sin(turn), 0.0]])
    offset_m = np.append(np.full(6, 0.05), 0.05 + beyond_m)
    mesh = polyhedron_mesh(normals, offset_m)
    made = trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False)
    assert made.is_watertight
    assert made.volume == pytest.approx(1e-3, rel=3e-3)
    away = polyhedron_distance(normals, offset_m, np.array([[0.1, 0.0, 0.0]]))
    assert away == pytest.approx([0.05], abs=1e-6)
    with pytest.raises(ValueError, match="no unit vector"):
        polyhedron_mesh(2.0 * normals, 2.0 * offset_m)


def test_a_corner_cut_off_by_a_micrometre_leaves_the_surface_closed() -> None:
    """The faces about it had different corners there, so that the surface had holes."""
    cut = np.array([10.0, 3.0, 1.0]) / np.sqrt(110.0)
    normals, half_m = np.vstack([CUBE, cut]), 0.02
    mesh = polyhedron_mesh(normals, np.append(np.full(6, half_m), half_m * cut.sum() - 1e-6))
    assert trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False).is_watertight


def test_touches_on_two_faces_are_found_wherever_they_lie_along_the_edge_between() -> None:
    """Nothing but the faces' ends tells where they lie along it, and not the middle of touches."""
    box = model_of_planes("box", CUBE, np.tile(SIZE_M, 2))
    points = np.array([[0.03, 0.01, 0.059], [0.02, 0.04, 0.055], [0.0, 0.04, 0.05],
                       [0.03, -0.02, -0.055]])
    faces = (0, 1, 1, 0)
    found = interpret(points, CUBE[list(faces)], box, angle_rad=0.1, distance_m=0.001)
    true = next(one for one in found if one.assignment == faces)
    assert np.abs(points - true.position_m)[:, 2].max() <= 0.062
