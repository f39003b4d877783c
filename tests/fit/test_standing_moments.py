"""Descriptions of meshes: those of the same superquadrics in closed form, wherever they stand."""

import numpy as np
import pytest
import trimesh

from fit.standing_moments import DESCRIPTION, mesh_description
from fit.superquadric.geometry import superquadric
from fit.superquadric.moments import superquadric_description


@pytest.mark.parametrize("size_m", [(0.03, 0.03, 0.03), (0.02, 0.05, 0.08), (0.06, 0.04, 0.01)])
def test_an_ellipsoid_is_described_as_its_superquadric(size_m: tuple[float, ...]) -> None:
    ball = trimesh.creation.icosphere(4)
    ball.apply_scale(size_m)
    ball.apply_translation([0.4, -0.1, size_m[2]])
    body = superquadric(size_m, (1.0, 1.0), (0.4, -0.1, size_m[2]))
    found = mesh_description(ball.triangles)
    assert found.shape == (len(DESCRIPTION),)
    np.testing.assert_allclose(found, superquadric_description(body)[0], atol=0.01)


def test_moments_of_a_block_are_exact_to_the_fourth_order() -> None:
    a, b, c = 0.06, 0.10, 0.14
    block = trimesh.creation.box((a, b, c))
    block.apply_translation([0.3, 0.2, c / 2])
    found = dict(zip(DESCRIPTION, mesh_description(block.triangles), strict=True))
    x2, y2, z2 = a**2 / 12, b**2 / 12, c**2 / 12
    spread, x4, y4 = x2 + y2, a**4 / 80, b**4 / 80
    expected = {
        "log_size": np.log(a * b * c) / 3, "log_centre_height": np.log(c / 2),
        "log_height_std": np.log(z2) / 2, "log_section": np.log(np.sqrt(x2 * y2)) / 2,
        "elongation": (y2 - x2) / spread, "taper": 0.0, "uneven_taper": 0.0,
        "squareness": abs(x4 + y4 - 6 * x2 * y2) / spread**2, "height_kurtosis": 9 / 5}
    for name, value in expected.items():
        assert found[name] == pytest.approx(value, abs=1e-9), name


def test_neither_place_nor_turn_matters() -> None:
    cone = trimesh.creation.cone(0.04, 0.12, sections=40)
    moved = cone.copy()
    moved.apply_transform(trimesh.transformations.rotation_matrix(1.1, [0, 0, 1]))
    moved.apply_translation([0.5, 0.1, 0.0])
    np.testing.assert_allclose(mesh_description(moved.triangles), mesh_description(cone.triangles),
                               atol=1e-9)


def test_a_hollow_is_no_part_of_the_body() -> None:
    """An inner shell that faces inwards: its moments are taken off."""
    outer, inner = trimesh.creation.box((0.08, 0.08, 0.08)), trimesh.creation.box((0.06,) * 3)
    inner.invert()
    shell = np.concatenate([outer.triangles, inner.triangles])
    hollow, full = mesh_description(shell), mesh_description(outer.triangles)
    assert 3 * (full[0] - hollow[0]) == pytest.approx(-np.log(1 - (6 / 8) ** 3), abs=1e-9)
    assert hollow[2] > full[2]  # what is left lies farther from the middle
