"""Zero sets of signed distances on a grid that is refined only where the surface may pass."""

from io import BytesIO
from typing import Any

import numpy as np
import pytest
import trimesh

from fit.implicit.mesh import zero_set_meshes
from fit.implicit.record import TriangleMesh
from warpgrasp.objects.mesh_orientation import mesh_of, simple_mesh_distance

CELLS = 32
HALF_SIDE_M = 0.08
REACH_M = 0.05


@pytest.mark.parametrize("cells_thick", [
    0.6, *(pytest.param(thick, marks=pytest.mark.slow) for thick in (1.5, 6.0))])
def test_plates_that_hide_between_coarse_nodes_are_found(cells_thick: float) -> None:
    """Round plates of many directions: every node of the finest grid is on its side of the mesh,
    though plates pass between those of the coarse one, and most nodes were never asked for."""
    draw = np.random.default_rng(5)
    normals = np.concatenate([np.eye(3), draw.normal(size=(13, 3))])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    at = draw.uniform(-0.01, 0.01, len(normals))
    half = cells_thick * HALF_SIDE_M / CELLS

    def plate(points: np.ndarray, rows: np.ndarray) -> np.ndarray:
        along = np.einsum("rpk,rk->rp", points, normals[rows])
        across = np.linalg.norm(points - along[..., None] * normals[rows, None], axis=-1)
        return np.maximum(np.abs(along - at[rows, None]) - half, across - REACH_M)

    asked = []

    def values(points: np.ndarray, rows: np.ndarray, counts: np.ndarray) -> np.ndarray:
        asked.append(counts.sum())
        return plate(points, rows)

    corner = np.full((len(normals), 3), HALF_SIDE_M)
    meshes = zero_set_meshes(values, -corner, corner, cells=CELLS)
    along = np.linspace(-HALF_SIDE_M, HALF_SIDE_M, CELLS + 1)
    nodes = np.stack(np.meshgrid(along, along, along, indexing="ij"), -1).reshape(-1, 3)
    for row, mesh in enumerate(meshes):
        assert mesh.simple
        true = plate(nodes[None], np.array([row]))[0]
        found = simple_mesh_distance(mesh_of(mesh.vertices_m, mesh.faces), nodes)
        clear = np.abs(true) > 1e-6  # single precision
        assert ((found < 0.0) == (true < 0.0))[clear].all()
    assert sum(asked) < 0.5 * len(normals) * len(nodes)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_a_file_of_a_body_is_closed_for_whoever_joins_its_vertices(scale: float) -> None:
    """Where its surface passes through nodes, all but passes through them, is cut off by the grid,
    and stands on a table; also where distances are in another unit."""
    side, middle = HALF_SIDE_M, np.array([0.45, 0.1, 0.05])
    half = np.array([[8, 5, 12], [8, 20, 12], [9, 9, 12]]) * 2 * side / CELLS
    off = np.array([0.0, 1e-9, 1e-7])

    def box(points: np.ndarray, rows: np.ndarray, counts: np.ndarray) -> np.ndarray:
        away = np.abs(points - middle) - half[rows, None] - off[rows, None, None]
        return scale * np.maximum(away.max(-1), -points[..., 2])

    low, high = np.tile(middle - side, (3, 1)), np.tile(middle + side, (3, 1))
    meshes = zero_set_meshes(box, low, high, np.zeros(3), cells=CELLS)
    for row, mesh in enumerate(meshes):
        read = trimesh.load(BytesIO(mesh.as_ply()), file_type="ply")
        assert read.is_watertight, row
        assert read.volume == pytest.approx(mesh.volume_m3, rel=1e-4)
    wide, deep, tall = half[2]
    whole = 4 * wide * deep * (middle[2] + tall)
    assert meshes[2].volume_m3 == pytest.approx(whole, rel=0.01)  # edges are cut off


@pytest.mark.parametrize("far_m", [0.4, 1e6])
def test_a_mesh_far_from_the_origin_is_written_as_it_is(far_m: float) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    mesh = TriangleMesh(ball.vertices + [far_m, 0.0, 0.0], ball.faces)
    read: Any = trimesh.load(BytesIO(mesh.as_ply()), file_type="ply", process=False)
    assert np.abs(read.vertices - mesh.vertices_m).max() < 1e-7


def test_a_grid_has_a_multiple_of_four_cells() -> None:
    with pytest.raises(ValueError, match="multiple of 4"):
        zero_set_meshes(lambda p, r, c: p[..., 0], np.zeros((1, 3)), np.ones((1, 3)), cells=10)
