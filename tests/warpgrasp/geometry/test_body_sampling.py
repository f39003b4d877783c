"""Points a body is scored by."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.stats import qmc

from warpgrasp.geometry.body import Body, BodyError, Part, distance_to_bodies, scene_of
from warpgrasp.geometry.body_sampling import sample_body, sobol_points
from warpgrasp.geometry.scene import Shape
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.objects.mesh_import import body_from_mesh


def test_sobol_points_are_scipys() -> None:
    assert np.array_equal(sobol_points(12), qmc.Sobol(3, scramble=False).random_base2(12))


def test_a_sample_is_of_its_bodys_own_box() -> None:
    """Of one shape, in two boxes that hold it: two samples."""
    ball = (Part(Shape.SPHERE, size_m=(0.03, 0.0, 0.0)),)
    near = sample_body(Body("near", ball, (-0.03, -0.03, 0.0), (0.03, 0.03, 0.06)))
    wide = sample_body(Body("wide", ball, (-0.03, -0.03, 0.0), (0.03, 0.03, 0.09)))
    for sample in (near, wide):
        assert sample.volume_m3 == pytest.approx(4 / 3 * np.pi * 0.03**3, rel=0.01)
    assert not np.array_equal(near.surface_m, wide.surface_m)


@pytest.mark.parametrize("turn", [[35, 45, 0], [45, 45, 30]])
@pytest.mark.parametrize(("radius", "height"), [(2, 300), (3, 500), (5, 500)])
def test_a_slanted_rod_has_its_volume(radius: float, height: float, turn: list[float]) -> None:
    """Against the capsule's formula; it fills some thousandths of its box."""
    body = body_from_table({"name": "rod", "compound": [{
        "shape": "capsule", "radius_mm": radius, "height_mm": height, "rpy_deg": turn}]}, Path())
    sample = sample_body(body)
    true = np.pi * radius**2 * (height - 2 * radius + 4 / 3 * radius) * 1e-9
    assert sample.volume_m3 == pytest.approx(true, rel=0.006)
    assert len(np.unique(sample.inside_m, axis=0)) > 1000


@pytest.mark.parametrize("name", ["block", "wedge", "small_cylinder"])
def test_normals_of_ends_point_up_and_down(name: str) -> None:
    body = body_from_name(name)
    sample = sample_body(body, surface=16384)
    x, y, z = sample.surface_m.T
    within = np.hypot(x, y) < 0.015
    for height, up in ((0.0, -1.0), (body.high_m[2], 1.0)):
        there = within & (np.abs(z - height) < 1e-5)
        if name != "wedge" or height == 0.0:  # its top is an edge
            assert there.sum() > 50
            assert np.allclose(sample.surface_normal[there], [0.0, 0.0, up], atol=1e-6)


def test_where_parts_meet_is_no_surface() -> None:
    half = {"shape": "block", "size_mm": [60, 60, 60]}
    stack = body_from_table({"name": "stack", "compound": [half, half | {"at_mm": [0, 0, 60]}]},
                            Path())
    x, y, z = np.abs(sample_body(stack).surface_m - [0.0, 0.0, 0.060]).T
    assert np.allclose(np.maximum(np.maximum(x, y) - 0.030, z - 0.060), 0.0, atol=2e-4)


@pytest.mark.parametrize(("surface", "within"), [(None, 0.003), (2048, 0.03)])
def test_points_stand_for_their_shares_of_the_area(surface: int | None, within: float) -> None:
    """Of a block: the area within 3 mm of its edges."""
    body = body_from_name("block")
    size = np.array(body.parts[0].size_m)
    sample = sample_body(body, surface=surface)
    assert sample.surface_share.sum() == pytest.approx(1.0)
    depth = np.sort(0.5 * size - np.abs(sample.surface_m - [0.0, 0.0, size[2] / 2]), axis=1)
    faces = np.array([[size[0], size[1]], [size[1], size[2]], [size[2], size[0]]])
    middle = (faces - 0.006).prod(1).sum() / faces.prod(1).sum()
    assert sample.surface_share[depth[:, 1] < 0.003].sum() == pytest.approx(1 - middle, rel=within)


def test_normals_of_a_grid_are_those_of_its_surface(tmp_path: Path) -> None:
    """Where it is rounded by its cells, two tenths of a millimetre outside are another normal."""
    trimesh.creation.cylinder(0.03, 0.1).export(tmp_path / "can.ply")
    body = body_from_mesh(tmp_path / "can.ply", units="m")
    sample = sample_body(body, surface=None)
    slope = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int),
                               sample.surface_m[None])[1][0]
    slope /= np.linalg.norm(slope, axis=1, keepdims=True)
    away = np.degrees(np.arccos(np.clip((slope * sample.surface_normal).sum(1), -1.0, 1.0)))
    assert np.quantile(away, 0.99) < 2.0


@pytest.mark.parametrize(("surface", "inside", "told"), [
    (0, 64, "surface 0: wants 1 to"), (-1, 64, "surface -1: wants 1 to"),
    (2.5, 64, "surface 2.5: wants"), (64, 0, "inside 0: wants 1 to")])
def test_a_sample_has_a_point_at_least(surface: int, inside: int, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        sample_body(body_from_name("block"), surface=surface, inside=inside)


def test_a_body_that_reaches_out_of_its_box_is_refused() -> None:
    """It had the volume of what is in the box, and stable poses were sought without an end."""
    block = body_from_name("block")
    assert sample_body(block).volume_m3 == pytest.approx(576e-6, rel=2e-3)
    for high in ((0.02, 0.02, 0.02), (0.03, 0.04, 0.115)):
        with pytest.raises(BodyError, match=r"block: reaches out of its box from .* should be cor"):
            sample_body(replace(block, low_m=(-high[0], -high[1], 0.0), high_m=high))
