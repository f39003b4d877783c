"""The kind of shape that touches support."""

import numpy as np
import pytest
from quality_bodies import touches

from fit.choice import MODELS, choose_shape, count_places
from fit.polyhedron import fit_polyhedron
from fit.superquadric.geometry import superquadric

pytestmark = pytest.mark.slow


def wedge(n: int, count: int, noise: float, rng) -> np.ndarray:
    """Touches on the four side faces of a ridge 60 x 60 x 100 mm."""
    points = np.empty((n, count, 3))
    for k in range(n):
        z = 0.1 * (1 - np.sqrt(rng.random(count)))
        side = rng.integers(0, 2, count) * 2 - 1
        wide = 0.03 * (1 - z / 0.1)
        slope = rng.random(count) < 0.6
        points[k] = np.where(slope[:, None],
                             np.stack([side * wide, rng.uniform(-0.03, 0.03, count), z], 1),
                             np.stack([rng.uniform(-1, 1, count) * wide, side * 0.03, z], 1))
    return points + noise * rng.normal(size=points.shape)


def bottle(n: int, count: int, noise: float, rng) -> np.ndarray:
    z = rng.uniform(0.02, 0.2, (n, count))
    radius = np.interp(z, [0.0, 0.09, 0.13, 0.2], [0.035, 0.035, 0.014, 0.014])
    turn = rng.uniform(-np.pi, np.pi, (n, count))
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=2)
    return points + noise * rng.normal(size=points.shape)


@pytest.fixture(scope="module")
def chosen():
    rng = np.random.default_rng(0)
    ellipsoid = superquadric([0.03, 0.045, 0.06], [0.8, 0.9], [[0.4, 0, 0.06]] * 4)
    sets = np.concatenate([touches(ellipsoid, 60, 1e-3, rng), wedge(4, 60, 1e-3, rng),
                           bottle(4, 60, 1e-3, rng)])
    return choose_shape(sets, table_z=0.0)


def test_ellipsoids_need_no_more_than_eleven_parameters(chosen) -> None:
    assert chosen.names()[:4].count("superquadric") >= 3


def test_wedges_are_polyhedra_or_tapered(chosen) -> None:
    assert set(chosen.names()[4:8]) <= {"polyhedron", "tapered"}


def test_bottles_are_revolutions(chosen) -> None:
    assert chosen.names()[8:].count("revolution") >= 3
    assert np.allclose(chosen.probability.sum(axis=1), 1)
    assert chosen.probability.shape[1] == len(MODELS)


def test_a_place_touched_twice_counts_once() -> None:
    points = np.array([[[0.0, 0, 0], [0.0, 0, 0.0001], [0.1, 0, 0], [9, 9, 9]]])
    assert count_places(points, np.array([[True, True, True, False]]), 1e-3) == 2


def test_places_hang_on_neither_order_nor_origin() -> None:
    rng = np.random.default_rng(2)
    points = rng.uniform(0, 0.004, (1, 60, 3))
    mask = np.ones((1, 60), bool)
    count = count_places(points, mask, 1e-3)
    assert 0 < count < 60
    for shift in rng.uniform(-0.5, 0.5, (20, 3)):
        assert count_places(points[:, rng.permutation(60)] + shift, mask, 1e-3) == count
    pair = np.array([[[0.0, 0, 0], [0.0, 0, 0.999e-3]], [[0.0, 0, 0], [0.0, 0, 1.001e-3]]])
    for shift in rng.uniform(-0.5, 0.5, (20, 3)):
        assert count_places(pair + shift, np.ones((2, 2), bool), 1e-3).tolist() == [1, 2]


def test_a_set_that_cannot_be_fitted_chooses_nothing_and_spoils_nobody(chosen) -> None:
    rng = np.random.default_rng(0)
    ellipsoid = superquadric([0.03, 0.045, 0.06], [0.8, 0.9], [[0.4, 0, 0.06]] * 4)
    good = touches(ellipsoid, 60, 1e-3, rng)[:2]
    sets = np.full((2, 300, 3), np.nan)
    sets[:, :60] = good
    mask = np.isfinite(sets).all(axis=2)
    sets[1, 0] = 1e200
    found = choose_shape(sets, mask, table_z=0.0)
    assert found.names() == [chosen.names()[0], "none"]
    assert np.array_equal(found.criterion[0], chosen.criterion[0])


def test_a_box_has_six_faces() -> None:
    rng = np.random.default_rng(1)
    box = superquadric([0.03, 0.04, 0.06], [0.1, 0.1], [0.0, 0.0, 0.06])
    points = rng.uniform(-1, 1, (1, 120, 3)) * box.size_m[:, None]
    axis = rng.integers(0, 3, 120)
    rows = np.arange(120)
    points[0, rows, axis] = box.size_m[0, axis] * np.sign(points[0, rows, axis])
    found = fit_polyhedron(points + box.position_m[:, None], np.ones((1, 120), bool), box)
    assert found.used.all()
    assert np.abs(found.distance_m).max() < 1e-9
