"""What a hand touches: true distances, beside meshes that trimesh makes of the same solids."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from warpgrasp.geometry.body import Body, BodyError, distance_to_bodies, scene_of
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects import body_baking
from warpgrasp.objects.body_baking import check_walls, distance_falls_short, touched_body
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.objects.grid_baking import baked_body
from warpgrasp.objects.mesh_orientation import mesh_gap, mesh_of

RADIUS, HEIGHT, WALL, BOTTOM = 40.0, 80.0, 5.0, 6.0


def compound(*parts: dict) -> Body:
    return body_from_table({"name": "made", "compound": list(parts)}, Path())


def cup(cutter_mm: float) -> Body:
    """A cup; it is the same solid however high its cutter rises."""
    return compound(
        {"shape": "cylinder", "radius_mm": RADIUS, "height_mm": HEIGHT},
        {"shape": "cylinder", "join": "difference", "radius_mm": RADIUS - WALL,
         "height_mm": cutter_mm, "at_mm": [0, 0, BOTTOM]})


def cup_mesh() -> trimesh.Trimesh:
    inner = RADIUS - WALL
    return trimesh.creation.revolve(np.array([
        [0, 0], [RADIUS, 0], [RADIUS, HEIGHT], [inner, HEIGHT], [inner, BOTTOM], [0, BOTTOM]])
        / 1e3, sections=720)


def superquadric_mesh(size_mm: list[float], e1: float, e2: float) -> trimesh.Trimesh:
    """A sphere whose vertices are moved along their rays onto the surface."""
    mesh = trimesh.creation.icosphere(subdivisions=6)
    x, y, z = (np.abs(mesh.vertices) / (np.array(size_mm) / 1e3)).T
    gauge = ((x ** (2 / e2) + y ** (2 / e2)) ** (e2 / e1) + z ** (2 / e1)) ** (e1 / 2)
    mesh.vertices = mesh.vertices / gauge[:, None] + [0.0, 0.0, size_mm[2] / 1e3]
    return mesh


def errors_m(body: Body, mesh: trimesh.Trimesh, low_m: float, high_m: float) -> np.ndarray:
    """Errors of the distance at places so far from the mesh, outside it."""
    points = np.random.default_rng(1).uniform(
        np.array(body.low_m) - high_m, np.array(body.high_m) + high_m, (20_000, 3))
    found, _ = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int), points[None])
    gap = mesh_gap(mesh_of(np.asarray(mesh.vertices), np.asarray(mesh.faces), winding=False),
                   points)
    there = (found[0] > 0.0) & (gap > low_m) & (gap < high_m)
    assert there.sum() > 100
    return found[0][there] - gap[there]


def test_a_cup_has_no_lid() -> None:
    """Its formula is 3 mm in the middle of the mouth, and the distance 35 mm."""
    body = cup(HEIGHT)
    touched = touched_body(body)
    mouth = np.array([[[0.0, 0.0, HEIGHT / 1e3]]])
    formula, _ = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int), mouth)
    distance, _ = distance_to_bodies(scene_of([touched], "cpu"), np.zeros(1, int), mouth)
    assert formula[0, 0] < 0.010
    # On its axis the distance has a peak, which the spline of the nodes rounds.
    assert distance[0, 0] == pytest.approx((RADIUS - WALL) / 1e3, abs=1.5e-3)
    assert np.abs(errors_m(touched, cup_mesh(), 0.0, 0.02)).max() < 6e-4
    assert np.quantile(np.abs(errors_m(touched, cup_mesh(), 0.0, 0.02)), 0.9) < 1.5e-4
    tall = touched_body(cup(3 * HEIGHT))
    places = np.random.default_rng(2).uniform(-0.06, 0.1, (1, 2000, 3))
    short, long = (distance_to_bodies(scene_of([one], "cpu"), np.zeros(1, int), places)[0]
                   for one in (touched, tall))
    assert np.abs(short - long).max() < 5e-4


@pytest.mark.slow
@settings(max_examples=2, deadline=None)
@given(st.lists(st.floats(12.0, 60.0), min_size=3, max_size=3), st.floats(0.3, 1.0),
       st.floats(0.5, 1.0))
def test_superquadrics_have_true_distances(size_mm: list[float], e1: float, e2: float) -> None:
    body = body_from_table({"name": "made", "superquadric": {
        "size_mm": size_mm, "exponents": [e1, e2]}}, Path())
    touched = touched_body(body)
    mesh = superquadric_mesh(size_mm, e1, e2)
    assert np.abs(errors_m(touched, mesh, 0.006, 0.010)).max() < 3e-4
    assert np.abs(errors_m(touched, mesh, 0.018, 0.022)).max() < 1.5e-3  # in part outside the grid


def test_a_flat_disc_is_not_touched_from_afar() -> None:
    """Its formula falls short by up to 3 mm where links touch."""
    size = [60.0, 60.0, 12.0]
    body = body_from_table({"name": "disc", "superquadric": {
        "size_mm": size, "exponents": [1.0, 1.0]}}, Path())
    mesh = superquadric_mesh(size, 1.0, 1.0)
    assert errors_m(body, mesh, 0.006, 0.010).min() < -2e-3
    assert np.abs(errors_m(touched_body(body), mesh, 0.006, 0.010)).max() < 1.5e-4


def test_solids_and_their_unions_are_touched_as_they_are() -> None:
    united = compound({"shape": "block", "size_mm": [40, 40, 40]},
                      {"shape": "sphere", "radius_mm": 20, "at_mm": [20, 0, 30]})
    for body in (body_from_name("block"), body_from_name("wine_bottle"), united):
        assert not distance_falls_short(body)
        assert touched_body(body) is body


def test_thin_walls_are_kept_by_finer_nodes_or_refused() -> None:
    def plate(thick_mm: float) -> Body:
        return compound({"shape": "block", "size_mm": [80, 80, 40]},
                        {"shape": "block", "join": "difference",
                         "size_mm": [100, 80 - 2 * thick_mm, 60], "at_mm": [0, 0, -10]})

    thin = touched_body(plate(2.0))
    assert thin.parts[0].grid_cell_m < 1.2e-3
    inside = np.array([[[0.0, 0.039, 0.02]]])
    assert distance_to_bodies(scene_of([thin], "cpu"), np.zeros(1, int), inside)[0] < 0.0
    with pytest.raises(BodyError, match=r"made: it has superquadrics or cuts.*thicken them"):
        touched_body(plate(0.4))
    leaf = body_from_table({"name": "leaf", "superquadric": {
        "size_mm": [1, 100, 100], "exponents": [0.1, 0.1]}}, Path())
    with pytest.raises(BodyError, match=r"leaf: it has superquadrics or cuts.*thicken them"):
        check_walls(leaf)


@pytest.mark.parametrize("radius_mm", [1.0, 2.0])
def test_a_thin_rod_beside_a_cut_is_there_to_be_touched(
        radius_mm: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The mesh of which distances are baked had lost it: its own surface was 68 mm away."""
    monkeypatch.setenv("WARPGRASP_CACHE", str(tmp_path))
    body = body_from_table({"name": "aerial", "compound": [
        {"shape": "block", "size_mm": [60, 60, 60]},
        {"shape": "cylinder", "radius_mm": radius_mm, "height_mm": 200, "at_mm": [20, 0, 0]},
        {"shape": "cylinder", "radius_mm": 10, "height_mm": 20, "at_mm": [0, 0, 50],
         "join": "difference"}]}, Path())
    touched = touched_body(body)
    surface = sample_body(body, surface=1024)
    beside = surface.surface_m[surface.surface_m[:, 2] > 0.08]
    assert len(beside) > 20
    off, _ = distance_to_bodies(scene_of([touched], "cpu"), np.zeros(1, int), beside[None])
    assert np.abs(off).max() < 1.5e-3


def test_a_grid_is_kept_for_the_box_that_it_fills(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A body whose box was too small was touched so even when its box was right."""
    def ball(body: Body) -> Body:
        return baked_body(np.array(body.low_m), np.array(body.high_m),
                          lambda points: np.linalg.norm(points, axis=1) - 0.01, 8)

    monkeypatch.setenv("WARPGRASP_CACHE", str(tmp_path))
    monkeypatch.setattr(body_baking, "_baked", ball)
    right = cup(HEIGHT)
    small = replace(right, low_m=(-0.02, -0.02, 0.0), high_m=(0.02, 0.02, 0.05))
    assert touched_body(small).high_m == small.high_m
    assert touched_body(right).high_m == right.high_m
