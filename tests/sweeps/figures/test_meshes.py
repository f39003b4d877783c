from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from matplotlib.figure import Figure
from scipy.spatial.transform import Rotation

from fit.plane_record import PlaneFit
from fit.revolution.geometry import RevolutionBody, revolution_distance, revolution_volume
from fit.revolution.record import RevolutionFit
from fit.superquadric.geometry import Superquadric, superquadric, superquadric_inside_outside
from strategies.recovery.choose_model import Recovered, Shape
from sweeps.figures.faces import _neighbours
from sweeps.figures.fits import _faces
from sweeps.figures.meshes import (
    _box,
    _volume_m3,
    quadrilaterals,
    recovered_grid,
    square_path,
    surface_grid,
    true_mesh,
    turned_mesh,
)
from sweeps.figures.solids import draw_solid, lit, visible
from sweeps.report.replay import _grid_triangles
from warpgrasp.objects.catalogue import body_from_name, body_from_table


def volume(grid: np.ndarray) -> float:
    """Of the closed surface, by the divergence theorem over its triangles; outward: positive."""
    q = quadrilaterals(grid)
    return sum(float(np.einsum("fi,fi->f", a, np.cross(b, c)).sum()) / 6
               for a, b, c in ((q[:, 0], q[:, 1], q[:, 2]), (q[:, 0], q[:, 2], q[:, 3])))


def test_the_square_is_walked_evenly() -> None:
    x, y = square_path(np.linspace(-4, 4, 81))
    assert np.allclose(np.maximum(np.abs(x), np.abs(y)), 1.0)
    assert np.allclose(np.hypot(np.diff(x), np.diff(y)), 0.1)


@pytest.mark.parametrize(("exponents", "expected"), [
    ((0.1, 0.1), 8.0), ((0.1, 1.0), 2 * np.pi), ((1.0, 1.0), 4 / 3 * np.pi)])
def test_superquadrics_are_closed_and_of_their_size(
        exponents: tuple[float, float], expected: float) -> None:
    body = superquadric(np.array([[0.03, 0.04, 0.06]]), np.array([exponents]))
    grid = surface_grid(body, 32)
    gauge = superquadric_inside_outside(body, grid.reshape(1, -1, 3))
    assert np.allclose(gauge, 1.0, atol=1e-6)
    assert volume(grid) == pytest.approx(expected * 0.03 * 0.04 * 0.06, rel=0.03)
    assert np.allclose(grid[:, 0], grid[:, -1])


def test_a_revolution_is_drawn_where_it_stands_for_the_body() -> None:
    turned = RevolutionBody(
        np.array([[0.4, 0.1, 0.0]]), np.array([[0.0, 0.6, 0.8]]),
        np.array([[0.0, 0.05, 0.1, np.nan]]), np.array([[0.03, 0.04, 0.02, np.nan]]))
    straight = Superquadric(*(np.zeros((1, n)) for n in (3, 2, 3, 4, 2, 2)))
    grid = recovered_grid(Recovered(np.array([Shape.REVOLUTION]), straight, turned), 0, 48)
    assert np.abs(revolution_distance(turned, grid.reshape(1, -1, 3))).max() < 1e-9
    assert abs(volume(grid)) == pytest.approx(float(revolution_volume(turned)[0]), rel=0.01)
    assert volume(grid) > 0


@pytest.mark.parametrize(("length_mm", "cells"), [(80, 12), (80, 24), (80, 48), (300, 24)])
def test_a_true_body_keeps_its_thin_walls(length_mm: float, cells: int) -> None:
    plate = body_from_table({"name": "plate", "compound": [
        {"shape": "block", "size_mm": [length_mm, 60, 1.5]}]}, Path())
    vertices, faces = true_mesh(plate, cells)
    mesh = trimesh.Trimesh(vertices, faces[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3), process=False)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(1e-9 * length_mm * 60 * 1.5, rel=0.1)


def test_a_true_body_without_thin_walls_is_as_coarse_as_asked() -> None:
    assert len(true_mesh(body_from_name("block"), 24)[1]) < 2_000


def test_fits_are_drawn_as_large_as_they_are() -> None:
    axes = np.array([[[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0]]])
    middle, extent = np.array([[0.1, 0.2, 0.3]]), np.array([[0.06, 0.04]])
    plane = PlaneFit(**without_values(PlaneFit) | {
        "centre_m": middle, "axes": axes, "extent_m": extent})
    face, = _faces(plane, 0)
    assert np.allclose(face.mean(0), middle[0])
    sides = np.sort(np.linalg.norm(np.roll(face, -1, 0) - face, axis=1))
    assert np.allclose(sides, [0.04, 0.04, 0.06, 0.06])
    assert np.allclose(np.abs((face - middle[0]) @ axes[0].T), extent[0] / 2)

    turned = RevolutionFit(**without_values(RevolutionFit) | {
        "position_m": middle, "axis": np.array([[0.0, 0.6, 0.8]]), "height_m": np.array([0.1]),
        "radius_m": np.array([[0.04, 0.03, 0.01]])})
    arm = _faces(turned, 0).reshape(-1, 3) - middle[0]
    height = arm @ turned.axis[0]
    away = np.linalg.norm(arm - height[:, None] * turned.axis[0], axis=1)
    wanted = np.interp(height, [0.0, 0.05, 0.1], turned.radius_m[0])
    assert np.allclose(away[away > 1e-9], wanted[away > 1e-9])
    assert (height.min(), height.max()) == pytest.approx((0.0, 0.1), abs=1e-9)


def test_a_solid_shows_the_faces_and_contacts_on_its_near_side() -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    faces, eye = np.asarray(box.triangles), np.array([0.6, 0.5, 0.4])
    points = 0.05 * np.concatenate([np.eye(3), -np.eye(3)])
    assert visible(points, faces, eye).tolist() == [True] * 3 + [False] * 3
    axes: Any = Figure().add_subplot(projection="3d")
    draw_solid(axes, faces, eye)
    assert len(axes.collections[0].get_facecolor()) == 6
    assert lit(faces, "#ffffff", eye).max(1).argmax() in np.flatnonzero(box.face_normals @ eye > 0)


def test_a_turned_mesh_stands_as_its_pose_says() -> None:
    body = body_from_table({"name": "l", "compound": [
        {"shape": "block", "size_mm": [60, 30, 20]},
        {"shape": "block", "size_mm": [10, 10, 40], "at_mm": [20, 10, 0]}]}, Path())
    turn = Rotation.from_rotvec([0.0, 0.0, 1.1])
    straight, turned = true_mesh(body, 24), turned_mesh(
        body, np.array([0.4, 0.1, 0.0, *turn.as_quat()]), 24)
    np.testing.assert_array_equal(straight[1], turned[1])
    np.testing.assert_allclose(turned[0], turn.apply(straight[0]), atol=1e-12)


def test_a_box_that_stands_for_a_body_and_a_grid_are_closed_and_look_outward() -> None:
    body = body_from_name("block")
    vertices, faces = _box(body)
    assert _volume_m3(vertices, faces) == pytest.approx(0.06 * 0.08 * 0.12)
    for quad in vertices[faces]:  # each in one plane, none crossed
        assert np.linalg.norm(np.cross(quad[2] - quad[0], quad[3] - quad[1])) == pytest.approx(
            2 * np.prod(np.sort(np.ptp(quad, axis=0))[1:]))
    grid = surface_grid(superquadric(np.array([[0.03, 0.04, 0.06]]), np.ones((1, 2))), 16)
    mesh = trimesh.Trimesh(grid.reshape(-1, 3), _grid_triangles(grid))
    assert mesh.volume == pytest.approx(volume(grid))


def test_the_angle_of_neighbours_is_not_that_of_faces_side_by_side() -> None:
    at = np.radians([0.0, 10.0, 95.0])
    normals = np.stack([np.cos(at), np.sin(at), 0.0 * at], 1)
    assert _neighbours(normals) == pytest.approx(95.0)
    assert _neighbours(normals[:2]) is None


def without_values(record: type) -> dict[str, Any]:
    return {field.name: None for field in fields(record)}
