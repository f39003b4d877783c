"""The geometry of a superquadric against closed forms and against itself."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fit.rotation import matrix_of_quaternion, quaternion_of_matrix, turn_points
from fit.superquadric.geometry import (
    from_straight_frame,
    straight_coordinates,
    superquadric,
    superquadric_inside_outside,
    superquadric_normals,
    superquadric_points,
    superquadric_surface,
    superquadric_volume,
)
from fit.superquadric.uncertainty import distance_slopes, surface_distance

BODIES = superquadric(
    [[0.03, 0.04, 0.06], [0.05, 0.02, 0.03], [0.03, 0.03, 0.05], [0.04, 0.03, 0.08]],
    [[1.0, 1.0], [0.1, 0.1], [0.1, 1.0], [0.6, 1.4]],
    [[0.1, 0.2, 0.3], [0.0, 0.0, 0.0], [-0.1, 0.0, 0.1], [0.4, 0.0, 0.0]],
    [[0.5, 0.5, 0.5, 0.5], [0.0, 0.0, 0.6, 0.8], [0.0, 0.0, 0.0, 1.0], [0.48, 0.6, 0.0, 0.64]],
    [[0.0, 0.0], [0.0, 0.0], [-0.5, 0.3], [0.4, 0.6]],
    [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [5.0, 0.7]],
)


def test_surface_points_lie_on_the_surface_with_outward_normals() -> None:
    points, normals, area = superquadric_surface(BODIES, 2000)
    assert points.shape == normals.shape
    assert area.shape == points.shape[:2]
    assert np.allclose(superquadric_inside_outside(BODIES, points), 1, atol=1e-9)
    assert (superquadric_inside_outside(BODIES, points + 1e-4 * normals) > 1).all()


def test_volume_is_what_the_surface_encloses() -> None:
    points, normals, area = superquadric_surface(BODIES, 20000)
    arms = points - BODIES.position_m[:, None]
    enclosed = np.einsum("fpi,fpi,fp->f", arms, normals, area) / 3
    assert np.allclose(enclosed, superquadric_volume(BODIES), rtol=5e-3)


def test_volume_of_an_ellipsoid() -> None:
    body = superquadric([0.03, 0.04, 0.06], [1, 1])
    assert np.allclose(superquadric_volume(body), 4 / 3 * np.pi * 0.03 * 0.04 * 0.06, rtol=1e-12)


def test_a_small_first_exponent_is_a_cylinder_along_z() -> None:
    body = superquadric([0.03, 0.03, 0.05], [0.1, 1.0])
    rim = np.array([[[0.03, 0, 0.04], [0.0212132, 0.0212132, -0.04], [0.0, 0.0, 0.05]]])
    assert np.allclose(superquadric_inside_outside(body, rim), 1, atol=1e-2)


finite = st.floats(-1, 1)


@settings(max_examples=60)
@given(
    taper=st.tuples(finite, finite),
    curvature=st.floats(0, 8),
    alpha=st.floats(-3, 3),
    point=st.tuples(finite, finite, finite),
)
def test_straightening_undoes_taper_and_bend(taper, curvature, alpha, point) -> None:
    body = superquadric([0.03, 0.04, 0.06], [0.5, 0.5], [0.1, 0, 0], [0.48, 0.6, 0, 0.64],
                        np.multiply(taper, 0.9), [curvature, alpha])
    straight = np.array([[point]]) * body.size_m[:, None]
    again = straight_coordinates(body, from_straight_frame(body, straight))
    assert np.allclose(np.stack(again, axis=-1), straight, atol=1e-9)


def test_normals_of_an_ellipsoid() -> None:
    body = superquadric([0.03, 0.04, 0.06], [1, 1])
    points, _, _ = superquadric_surface(body, 200)
    exact = points / body.size_m[:, None] ** 2
    exact /= np.linalg.norm(exact, axis=-1, keepdims=True)
    assert np.allclose(superquadric_normals(body, points), exact, atol=1e-6)


@given(st.tuples(finite, finite, finite, finite))
def test_quaternion_of_its_own_matrix(q) -> None:
    if np.linalg.norm(q) < 1e-3:
        return
    unit = np.array(q) / np.linalg.norm(q)
    back = quaternion_of_matrix(matrix_of_quaternion(unit))
    assert np.allclose(matrix_of_quaternion(back), matrix_of_quaternion(unit), atol=1e-12)
    assert back[3] >= 0
    assert np.linalg.norm(back) == pytest.approx(1)


def test_turned_points_are_the_products_and_hang_on_no_neighbour() -> None:
    rng = np.random.default_rng(8)
    quaternion = rng.normal(size=(9, 4))
    rotation = matrix_of_quaternion(quaternion / np.linalg.norm(quaternion, axis=1)[:, None])
    points = rng.normal(size=(9, 33, 3))
    turned = turn_points(rotation, points)
    assert np.allclose(turned, points @ rotation.swapaxes(1, 2), atol=1e-14)
    assert np.array_equal(turn_points(rotation[3:8:2], points[3:8:2]), turned[3:8:2])


def test_bodies_of_batches_of_any_one_length() -> None:
    """Also of none; single values are those of every body."""
    for count in (0, 1, 3):
        sizes = np.tile([0.03, 0.04, 0.05], (count, 1))
        bodies = superquadric(sizes, [0.5, 1.0])
        assert superquadric_volume(bodies).shape == (count,)
        assert all(len(field) == count for field in bodies)
    with pytest.raises(ValueError, match="superquadric: batches of 2, 3, should be of one length"):
        superquadric(np.ones((2, 3)), np.ones((3, 2)))


@pytest.mark.usefixtures("unchecked")
@pytest.mark.parametrize(("changed", "said"), [
    ({"size_m": (-0.03, 0.04, 0.05)}, r"size_m: \[-0.03, 0.04, 0.05\], should be above 0"),
    ({"size_m": (0.03, 0.04)}, r"size_m: shape \(1, 2\), should be \(any, 3\)"),
    ({"exponents": (0.0, 1.0)}, r"exponents: \[0.0, 1.0\], should be above 0"),
    ({"quaternion_xyzw": (0, 0, 0, 2)}, "quaternion_xyzw: .* should be of length 1"),
    ({"taper": (3, 3)}, "taper: .* should be from -1 to 1"),
    ({"bend": (-2.0, 0.0)}, r"bend: .* should be of a curvature from 0: turn its direction by pi"),
    ({"size_m": "abc"}, "size_m: is no array of numbers"),
])
def test_numbers_of_no_superquadric_are_refused(changed: dict[str, Any], said: str) -> None:
    """A negative size had a negative volume, and a quaternion of length 2 turned and stretched."""
    with pytest.raises(ValueError, match=said):
        superquadric(**{"size_m": (0.03, 0.04, 0.05), "exponents": (0.5, 1.0)} | changed)


def test_a_body_that_is_not_known_spares_the_others() -> None:
    bodies = superquadric([[0.03, 0.04, 0.05], [np.nan] * 3], [1.0, 1.0])
    volume = superquadric_volume(bodies)
    assert np.isclose(volume[0], 4 / 3 * np.pi * 0.03 * 0.04 * 0.05)
    assert np.isnan(volume[1])


@pytest.mark.usefixtures("unchecked")
def test_points_are_those_of_each_body() -> None:
    """Points of one set without their first axis were taken for as many sets."""
    bodies = superquadric(np.tile([0.03, 0.04, 0.05], (4, 1)), [1.0, 1.0])
    points = superquadric_points(bodies, 20)
    for asked in (superquadric_inside_outside, superquadric_normals, from_straight_frame,
                  surface_distance, distance_slopes):
        np.testing.assert_array_equal(np.asarray(asked(bodies, points.tolist())[0]),
                                      np.asarray(asked(bodies, points)[0]))
        with pytest.raises(ValueError, match=r"points: shape \(4, 3\), should be \(any, any, 3\)"):
            asked(bodies, points[0, :4])
        with pytest.raises(ValueError, match="points: 3 sets for 4 bodies, should be one each"):
            asked(bodies, points[:3])
