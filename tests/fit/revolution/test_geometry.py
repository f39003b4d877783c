"""Bodies of revolution against trimesh and closed forms."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh
from matplotlib.path import Path as Polygon
from scipy.spatial import KDTree

from fit.revolution.geometry import (
    RevolutionBody,
    revolution_distance,
    revolution_inside,
    revolution_surface,
    revolution_volume,
)

Z = np.array([0.0, 0.05, 0.12, 0.20])
R = np.array([0.03, 0.035, 0.012, 0.014])


def body(axis: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> RevolutionBody:
    way = np.array([axis]) / np.linalg.norm(axis)
    # A second row with fewer nodes: shorter contours are padded with NaN.
    return RevolutionBody(
        np.array([[0.1, -0.2, 0.3], [0.0, 0.0, 0.0]]), np.concatenate([way, way]),
        np.stack([Z, [0.0, 0.1, np.nan, np.nan]]), np.stack([R, [0.02, 0.02, np.nan, np.nan]]))


def test_volume_does_not_hang_on_longer_contours_beside() -> None:
    rng = np.random.default_rng(3)
    for nodes in range(8, 40):
        z, r = np.sort(rng.random((1, nodes))), rng.random((1, nodes))
        place = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
        wide = (np.pad(v, ((0, 0), (0, 7)), constant_values=np.nan) for v in (z, r))
        assert revolution_volume(RevolutionBody(*place, z, r)) == revolution_volume(
            RevolutionBody(*place, *wide))


def mesh() -> trimesh.Trimesh:
    line = np.column_stack([np.r_[0.0, R, 0.0], np.r_[Z[0], Z, Z[-1]]])
    return trimesh.creation.revolve(line, sections=720)


def test_volume_is_that_of_frustums_and_of_a_cylinder() -> None:
    assert revolution_volume(body()) == pytest.approx([mesh().volume, np.pi * 0.02**2 * 0.1],
                                                      rel=1e-4)


def test_inside_and_distance_agree_with_the_contour_in_its_plane() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform([-0.05, -0.05, -0.02], [0.05, 0.05, 0.22], (400, 3))
    shifted = points + np.array([0.1, -0.2, 0.3])
    both = np.stack([shifted, shifted])
    flat = np.column_stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]])
    corners = np.column_stack([np.r_[0.0, R, 0.0], np.r_[Z[0], Z, Z[-1]]])
    dense = np.concatenate([np.linspace(a, b, 4000) for a, b in pairwise(corners)])
    distance, _ = KDTree(dense).query(flat)
    clear = distance > 1e-4
    inside = Polygon(corners).contains_points(flat)
    assert (revolution_inside(body(), both)[0][clear] == inside[clear]).all()
    assert np.allclose(revolution_distance(body(), both)[0], distance, atol=1e-5)


def test_surface_lies_on_the_body_and_its_areas_sum_to_it() -> None:
    tilted = body((0.2, -0.1, 1.0))
    points, normals, area = revolution_surface(tilted)
    assert np.allclose(revolution_distance(tilted, points), 0.0, atol=1e-12)
    assert area.sum(1) == pytest.approx(
        [mesh().area, 2 * np.pi * 0.02 * 0.1 + 2 * np.pi * 0.02**2], rel=2e-2)
    assert np.allclose(np.linalg.norm(normals, axis=-1), 1.0)
    out, into = (revolution_inside(tilted, points + s * 1e-6 * normals) for s in (1, -1))
    assert not out.any()
    assert into.all()


def test_a_row_is_a_body_of_its_own() -> None:
    points, _, area = revolution_surface(body())
    alone, _, alone_area = revolution_surface(body()[1])
    assert np.array_equal(points[1:], alone)
    assert np.array_equal(area[1:], alone_area)


@pytest.mark.usefixtures("unchecked")
def test_an_axis_is_of_length_1_and_shapes_agree() -> None:
    """Heights along a longer axis are too large: points inside were outside."""
    one = body()
    RevolutionBody(one.foot_m, one.axis * [[np.nan], [1.0]], one.height_m, one.radius_m)
    with pytest.raises(ValueError, match=r"axis: \[0.0, 0.0, 2.0\], should be of length 1"):
        RevolutionBody(one.foot_m, 2.0 * one.axis, one.height_m, one.radius_m)
    with pytest.raises(ValueError, match=r"radius_m: shape \(2, 3\), should be \(2, 4\)"):
        RevolutionBody(one.foot_m, one.axis, one.height_m, one.radius_m[:, :3])


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(("height", "radius", "said"), [
    ([0.0, 0.1, 0.05], [0.03, 0.03, 0.03], r"height_m: \[0.0, 0.1, 0.05\], should be rising"),
    ([0.0, 0.1, 0.2], [0.03, -0.03, 0.03], r"radius_m: \[0.03, -0.03, 0.03\], should be 0 or more"),
    ([0.0, np.nan, 0.2], [0.03, 0.03, 0.03], r"height_m: \[0.0, nan, 0.2\], should be finite"),
    ([0.0, 0.1, np.inf], [0.03, 0.03, 0.03], r"height_m: \[0.0, 0.1, inf\], should be finite"),
])
def test_contours_rise_from_node_to_node(height: list[float], radius: list[float], said: str
                                         ) -> None:
    """Others have a volume as well, and no point inside."""
    place = np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]])
    RevolutionBody(*place, np.array([[0.0, 0.0, np.nan]]), np.array([[0.03, 0.0, np.nan]]))
    with pytest.raises(ValueError, match=said):
        RevolutionBody(*place, np.array([height]), np.array([radius]))


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize("ask", [revolution_inside, revolution_distance])
def test_points_are_sets_one_for_each_body(ask) -> None:
    """Rows of one set were taken for sets."""
    for wrong in ((2, 3), (5, 3), (3, 5, 3), (2, 5, 2)):
        with pytest.raises(ValueError, match=r"points: shape .*, should be \(2, any, 3\)"):
            ask(body(), np.zeros(wrong))
