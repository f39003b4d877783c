"""Meshes that rounding opened are closed by welding; others stay as they are."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from warpgrasp.geometry.body import BodyError
from warpgrasp.objects import welding
from warpgrasp.objects.mesh_import import mesh_triangles
from warpgrasp.objects.welding import edge_counts, welded_faces

SIZE_MM = np.array([60.0, 40.0, 100.0])
TURN = Rotation.from_rotvec([0.3, -0.5, 0.7])


def block() -> trimesh.Trimesh:
    return trimesh.creation.box(SIZE_MM).subdivide()


def file_of(folder: Path, triangles: np.ndarray, kind: str = "stl") -> Path:
    """A file in which no two faces share a vertex."""
    soup = trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3),
                           process=False)
    soup.export(folder / f"soup.{kind}")
    return folder / f"soup.{kind}"


def shaken(share: float) -> np.ndarray:
    """Corners of a block's faces, each moved by itself by up to a share of the longest side."""
    triangles = block().triangles
    away = np.random.default_rng(0).uniform(-1.0, 1.0, triangles.shape)
    return triangles + share * SIZE_MM.max() * away / np.sqrt(3.0)


def turned_alone() -> np.ndarray:
    """Corners that single precision rotated face by face, with a rounding that depends on the face:
    one corner comes out in several ways."""
    turn = TURN.as_matrix().astype(np.float32)
    middle = block().triangles_center.astype(np.float32)[:, None]
    corners = block().triangles.astype(np.float32)
    return (corners - middle) @ turn.T + middle @ turn.T


@pytest.mark.parametrize("kind", ["stl", "ply"])
@pytest.mark.parametrize("triangles", [
    pytest.param(turned_alone(), id="turned"),
    *(pytest.param(shaken(share), id=f"{share:g}") for share in (1e-9, 1e-8, 1e-7, 1e-6, 4.9e-6))])
def test_vertices_that_differ_by_rounding_are_one(
        tmp_path: Path, triangles: np.ndarray, kind: str) -> None:
    assert len(np.unique(triangles.astype(np.float32).reshape(-1, 3), axis=0)) >= len(
        block().vertices)
    vertices, faces = mesh_triangles(file_of(tmp_path, triangles, kind), units="mm")
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    assert mesh.is_watertight
    assert (len(vertices), len(faces)) == (len(block().vertices), len(block().faces))
    assert mesh.volume == pytest.approx(SIZE_MM.prod() * 1e-9, rel=1e-4)


def test_gaps_and_holes_stay_open_and_are_counted_as_they_are(tmp_path: Path) -> None:
    with pytest.raises(BodyError, match=f"open: {3 * len(block().faces)} edges"):
        mesh_triangles(file_of(tmp_path, shaken(1e-3)), units="mm")
    with pytest.raises(BodyError, match=f"open: {3 * len(block().faces) - 3} edges"):
        mesh_triangles(file_of(tmp_path, shaken(1e-7)[1:]), units="mm")


def test_a_closed_mesh_keeps_vertices_that_are_near(tmp_path: Path) -> None:
    mesh = block()
    near = mesh.vertices[mesh.edges_unique[0, 0]].copy()
    mesh.vertices[mesh.edges_unique[0, 1]] = near + 1e-7 * SIZE_MM.max()
    mesh.export(tmp_path / "near.obj", digits=9)
    vertices, faces = mesh_triangles(tmp_path / "near.obj", units="mm")
    assert (len(vertices), len(faces)) == (len(mesh.vertices), len(mesh.faces))


def test_the_first_of_vertices_that_are_one_stands_for_all() -> None:
    soup = shaken(1e-7)
    vertices, faces = soup.reshape(-1, 3), np.arange(3 * len(soup)).reshape(-1, 3)
    found = welded_faces(vertices, faces)
    assert (edge_counts(found) == 2).all()
    assert (found <= faces).all()
    assert np.abs(vertices[found] - soup).max() < welding.WELDED * SIZE_MM.max()


def test_a_heap_of_vertices_is_not_compared_pair_by_pair(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(welding, "MOST_PAIRS", 100)
    soup = shaken(1e-7)
    faces = np.arange(3 * len(soup)).reshape(-1, 3)
    assert welded_faces(soup.reshape(-1, 3), faces) is faces
