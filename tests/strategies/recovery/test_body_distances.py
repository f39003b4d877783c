"""Bodies asked by kernels, against the plain NumPy of their shapes in `fit`."""

import numpy as np
import pytest

from fit.revolution.geometry import RevolutionBody, revolution_distance
from fit.superquadric.geometry import Superquadric, superquadric, superquadric_inside_outside
from fit.superquadric.uncertainty import surface_distance
from strategies.recovery import body_distances
from strategies.recovery.body_distances import (
    contour_distances,
    radial_distances,
    surface_distances,
)

POINTS = 60


def bodies(count: int = 40) -> Superquadric:
    """Tapered bodies of every exponent, one in three bent."""
    rng = np.random.default_rng(8)
    turn = rng.normal(size=(count, 4))
    bend = np.stack([np.where(np.arange(count) % 3 == 0, 6.0, 0.0), rng.uniform(-3, 3, count)], 1)
    return superquadric(
        rng.uniform(0.01, 0.08, (count, 3)), rng.uniform(0.1, 1.9, (count, 2)),
        rng.normal(0.0, 0.05, (count, 3)), turn / np.linalg.norm(turn, axis=1, keepdims=True),
        rng.uniform(-0.9, 0.9, (count, 2)), bend)


def points_about(body: Superquadric) -> np.ndarray:
    rng = np.random.default_rng(9)
    return body.position_m[:, None] + rng.normal(0.0, 0.05, (len(body.size_m), POINTS, 3))


def test_distances_are_those_of_the_geometry() -> None:
    body = bodies()
    points = points_about(body)
    asked = np.ones(points.shape[:2], bool)
    wanted, normal = surface_distance(body, points)
    by_gradient, outwards = surface_distances(body, points, asked)
    assert np.quantile(np.linalg.norm(outwards - normal, axis=-1), 0.999) < 1e-8
    assert np.quantile(np.abs(by_gradient - wanted), 0.999) < 1e-8


def test_a_point_lies_by_its_radial_distance_beyond_the_surface() -> None:
    body = bodies()
    straight = body._replace(taper=np.zeros_like(body.taper), bend=np.zeros_like(body.bend))
    points = points_about(straight)
    radial = radial_distances(straight, points, np.ones(points.shape[:2], bool))
    middle = straight.position_m[:, None]
    out = points - middle
    length = np.linalg.norm(out, axis=-1)
    on = middle + (1.0 - radial / length)[..., None] * out
    np.testing.assert_allclose(superquadric_inside_outside(straight, on), 1.0, rtol=1e-6)
    assert (radial < length).all()  # on this side of the centre
    assert ((radial > 0.0) == (superquadric_inside_outside(straight, points) > 1.0)).all()


def test_a_world_depends_on_nothing_beside_it_and_points_not_asked_for_are_far() -> None:
    body = bodies()
    points = points_about(body)
    asked = np.random.default_rng(1).uniform(size=points.shape[:2]) < 0.7
    one = Superquadric(*(f[3:4] for f in body)), points[3:4], asked[3:4]
    distance, normal = surface_distances(body, points, asked)
    alone, its_normal = surface_distances(*one)
    assert np.array_equal(distance[3:4], alone)
    assert np.array_equal(normal[3:4], its_normal)
    assert (distance[~asked] == 1.0).all()
    assert not normal[~asked].any()
    radial = radial_distances(body, points, asked)
    assert np.array_equal(radial[3:4], radial_distances(*one))
    assert np.isinf(radial[~asked]).all()


def test_points_side_by_side_are_those_taken_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    body = bodies()
    points = points_about(body)
    asked = np.random.default_rng(1).uniform(size=points.shape[:2]) < 0.7
    side_by_side = *surface_distances(body, points, asked), radial_distances(body, points, asked)
    monkeypatch.setattr(body_distances, "has_lanes", lambda device: False)
    one_by_one = *surface_distances(body, points, asked), radial_distances(body, points, asked)
    for these, those in zip(side_by_side, one_by_one, strict=True):
        assert np.allclose(these, those, rtol=1e-9, atol=1e-12)


def test_along_rays_from_the_centre_the_surface_lies_where_it_is_told() -> None:
    body = bodies()
    straight = body._replace(taper=np.zeros_like(body.taper), bend=np.zeros_like(body.bend))
    points = points_about(straight)
    away = points - straight.position_m[:, None]
    radial = radial_distances(straight, points, np.ones(points.shape[:2], bool))
    foot = points - radial[..., None] * away / np.linalg.norm(away, axis=-1, keepdims=True)
    np.testing.assert_allclose(superquadric_inside_outside(straight, foot), 1.0, atol=1e-9)


def contours(count: int = 30, most: int = 12) -> RevolutionBody:
    """Contours of 1 to `most` nodes about leaning axes, NaN after the last; the first has none."""
    rng = np.random.default_rng(10)
    axis = rng.normal(size=(count, 3))
    after = np.arange(most) >= rng.integers(1, most + 1, (count, 1))
    after[0] = True
    return RevolutionBody(
        rng.normal(0.0, 0.05, (count, 3)), axis / np.linalg.norm(axis, axis=1, keepdims=True),
        np.where(after, np.nan, np.cumsum(rng.uniform(0.0, 0.03, (count, most)), axis=1)),
        np.where(after, np.nan, rng.uniform(0.0, 0.05, (count, most))))


def test_distances_to_contours_are_those_of_the_geometry() -> None:
    body = contours()
    rng = np.random.default_rng(11)
    points = body.foot_m[:, None] + rng.normal(0.0, 0.1, (len(body), POINTS, 3))
    asked = rng.uniform(size=points.shape[:2]) < 0.7
    distance = contour_distances(body, points, asked)
    wanted = revolution_distance(body, points)
    assert np.allclose(distance[1:][asked[1:]], wanted[1:][asked[1:]], atol=1e-15)
    assert np.isinf(distance[~asked]).all()
    assert np.isinf(distance[0]).all(), "where there is no contour"
    assert np.array_equal(contour_distances(body[3], points[3:4], asked[3:4]), distance[3:4])
