"""Zero sets of signed distances on a grid that is refined only where the surface may pass."""

import numpy as np
import pytest

from fit.implicit.mesh import zero_set_meshes
from warpgrasp.objects.mesh_orientation import mesh_of, simple_mesh_distance

CELLS = 32
HALF_SIDE_M = 0.08
REACH_M = 0.05


@pytest.mark.parametrize("cells_thick", [0.6, 1.5, 6.0])
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


def test_a_grid_has_a_multiple_of_four_cells() -> None:
    with pytest.raises(ValueError, match="multiple of 4"):
        zero_set_meshes(lambda p, r, c: p[..., 0], np.zeros((1, 3)), np.ones((1, 3)), cells=10)
