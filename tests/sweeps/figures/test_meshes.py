from pathlib import Path

import numpy as np
import pytest
import trimesh

from fit.revolution.geometry import RevolutionBody, revolution_distance, revolution_volume
from fit.superquadric.geometry import Superquadric, superquadric, superquadric_inside_outside
from strategies.recovery.choose_model import Recovered, Shape
from sweeps.figures.meshes import (
    quadrilaterals,
    recovered_grid,
    square_path,
    surface_grid,
    true_mesh,
)
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
