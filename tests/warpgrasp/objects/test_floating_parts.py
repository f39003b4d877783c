"""Parts that nothing holds are found, in meshes and in compounds, and no others."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from warpgrasp.geometry.body import Body
from warpgrasp.objects.catalogue import body_from_table
from warpgrasp.objects.catalogue_names import FAMILY_NAMES
from warpgrasp.objects.families import family_table
from warpgrasp.objects.floating import floating_parts
from warpgrasp.objects.mesh_import import body_from_mesh

FLOOR = {"shape": "block", "size_mm": [60, 60, 20]}


def compound(*parts: dict[str, Any]) -> Body:
    return body_from_table({"name": "x", "compound": [*parts]}, Path())


@pytest.mark.parametrize("radius", [5.0, 15.0])
@pytest.mark.parametrize("gap", [7.0, 40.0])
def test_a_ball_above_a_block_floats(radius: float, gap: float) -> None:
    found = floating_parts(compound(
        FLOOR, {"shape": "sphere", "radius_mm": radius, "at_mm": [10, -5, 20 + gap]}))
    low = np.array([10 - radius, -5 - radius, 20 + gap]) / 1e3
    assert len(found) == 1
    np.testing.assert_allclose(found[0].low_m, low, atol=1e-4)
    np.testing.assert_allclose(found[0].high_m, low + 2 * radius / 1e3, atol=1e-4)


@pytest.mark.parametrize("parts", [
    ({"shape": "sphere", "radius_mm": 15, "at_mm": [10, -5, 20]},),  # touches it in a point
    ({"shape": "sphere", "radius_mm": 15, "at_mm": [70, 0, 0]},),  # beside it
    ({"shape": "sphere", "radius_mm": 15, "at_mm": [0, 0, 60]},
     {"shape": "cylinder", "radius_mm": 3, "height_mm": 60}),  # a post holds it
    ({"shape": "cylinder", "radius_mm": 10, "height_mm": 30, "join": "difference"},)])
def test_parts_that_something_holds_do_not_float(parts: tuple[dict[str, Any], ...]) -> None:
    assert not floating_parts(compound(FLOOR, *parts))


@pytest.mark.parametrize("name", [f"{family}-{seed}" for family in FAMILY_NAMES for seed in (0, 5)])
def test_no_object_of_a_family_floats(name: str) -> None:
    assert not floating_parts(body_from_table(family_table(name), Path()))


def test_a_thin_wire_is_in_one_piece() -> None:
    """One that is bent to a ring, leant, on a foot."""
    ring = {"shape": "cylinder", "radius_mm": 150, "height_mm": 2, "at_mm": [0, 0, 150],
            "rpy_deg": [80, 30, 0]}
    hollow = ring | {"radius_mm": 148, "join": "difference"}
    assert not floating_parts(compound(ring, hollow))


def test_what_is_cut_off_floats() -> None:
    """A slit through a block leaves its upper half."""
    slit = {"shape": "block", "size_mm": [70, 70, 6], "at_mm": [0, 0, 7], "join": "difference"}
    part, = floating_parts(compound(FLOOR, slit))
    assert (part.low_m[2], part.high_m[2]) == pytest.approx((0.013, 0.020), abs=2e-4)


def test_a_part_of_a_mesh_floats(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WARPGRASP_CACHE", str(tmp_path))
    for gap, count in ((0.01, 1), (-0.002, 0)):
        boxes = [trimesh.creation.box((0.06, 0.06, 0.02)), trimesh.creation.box((0.03, 0.02, 0.02))]
        boxes[1].apply_translation((0.0, 0.0, 0.02 + gap))
        trimesh.util.concatenate(boxes).export(tmp_path / "two.stl")
        found = floating_parts(body_from_mesh(tmp_path / "two.stl", units="m"))
        assert len(found) == count
        for part in found:
            np.testing.assert_allclose(part.low_m, (-0.015, -0.01, 0.02 + gap), atol=1e-3)
