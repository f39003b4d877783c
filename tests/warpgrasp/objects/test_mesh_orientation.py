"""Distances of points to meshes, and on which side of them they are."""

import numpy as np
import pytest
import trimesh

from warpgrasp.objects.mesh_orientation import (
    mesh_distance,
    mesh_gap,
    mesh_of,
    simple_mesh_distance,
)


def test_gaps_are_distances_and_a_coarser_winding_number_has_the_same_sides() -> None:
    """Of a ring, whose hole is outside, against the ring's own distance."""
    ring = trimesh.creation.torus(0.04, 0.012, major_sections=96, minor_sections=48)
    mesh = mesh_of(np.asarray(ring.vertices), np.asarray(ring.faces))
    points = np.random.default_rng(3).uniform(-0.07, 0.07, (4000, 3)) * [1.0, 1.0, 0.4]
    true = np.hypot(np.hypot(points[:, 0], points[:, 1]) - 0.04, points[:, 2]) - 0.012
    exact, coarse = (mesh_distance(mesh, points, accuracy=a) for a in (2.0, 1.5))
    flat = 0.04 * (1.0 - np.cos(np.pi / 96)) + 0.012 * (1.0 - np.cos(np.pi / 48))  # of its faces
    assert np.abs(mesh_gap(mesh, points) - np.abs(true)).max() < 1.3 * flat
    clear = np.abs(true) > 1.3 * flat
    assert (np.sign(exact) == np.sign(true))[clear].all()
    assert (exact == coarse).all()
    by_rays = simple_mesh_distance(
        mesh_of(np.asarray(ring.vertices), np.asarray(ring.faces), winding=False), points)
    assert (by_rays == exact).all()


@pytest.mark.parametrize(("name", "wrong", "told"), [
    ("faces", np.array([[0, 1, 4]]), "vertex of a face 4: wants 0 to 3"),
    ("faces", np.array([[0, -1, 2]]), "vertex of a face -1: wants 0 to 3"),
    ("faces", np.zeros((0, 3), int), "number of faces 0: wants 1 to"),
    ("faces", np.array([[0, 1, 2, 3]]), r"faces: of shape \(1, 4\); should be \(face, 3\)"),
    ("faces", np.array([[0.0, 1.0, 2.0]]), "faces: is of float64; should be of whole numbers"),
    ("vertices_m", np.eye(3), "vertex of a face 3: wants 0 to 2"),
    ("vertices_m", np.full((4, 3), np.nan), r"vertices_m: is nan at \(0, 0\); should be finite"),
    ("points_m", np.zeros((2, 2)), r"points_m: of shape \(2, 2\); should be \(point, 3\)")])
def test_what_is_no_mesh_is_told(name: str, wrong: np.ndarray, told: str) -> None:
    """Warp reads the vertices that faces name from anywhere in memory."""
    given = {"vertices_m": np.concatenate([np.zeros((1, 3)), np.eye(3)]),
             "faces": np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
             "points_m": np.zeros((2, 3))} | {name: wrong}
    with pytest.raises((TypeError, ValueError), match=told):
        mesh_gap(mesh_of(given["vertices_m"], given["faces"]), given["points_m"])
