import numpy as np
import pytest
import trimesh

from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.geometry.meshing import body_mesh
from warpgrasp.objects.catalogue import body_from_name, body_from_table

RING = {"name": "ring", "compound": [
    {"shape": "cylinder", "radius_mm": 40, "height_mm": 90},
    {"shape": "cylinder", "join": "difference", "radius_mm": 30, "height_mm": 100}]}


@pytest.mark.parametrize("name", ["block", "large_cylinder", "funnel", "wine_bottle"])
def test_a_mesh_is_closed_and_holds_the_bodys_volume(name: str) -> None:
    body = body_from_name(name)
    vertices, faces = body_mesh(body, 40)
    triangles = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(sample_body(body).volume_m3, rel=0.03)  # outward: positive
    assert mesh.bounds == pytest.approx(np.array([body.low_m, body.high_m]), abs=0.004)


def test_a_hole_stays_a_hole() -> None:
    from pathlib import Path

    vertices, faces = body_mesh(body_from_table(RING, Path()), 28)
    edges = np.sort(np.concatenate([faces[:, [n, (n + 1) % 4]] for n in range(4)]), axis=1)
    characteristic = len(vertices) - len(np.unique(edges, axis=0)) + len(faces)
    assert characteristic == 0  # Euler's, of a torus


@pytest.mark.parametrize("cells", [0, -1, 2.5, 100_000])
def test_a_number_of_cells_that_makes_no_grid_is_refused(cells: int) -> None:
    with pytest.raises(ValueError, match=f"cells: is {cells}; should be a whole number from 1 to "):
        body_mesh(body_from_name("block"), cells)
