"""How far bodies reach seen from above, against what their formulas and meshes say."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from warpgrasp.geometry.body import distance_to_bodies, scene_of
from warpgrasp.geometry.outline import DIRECTIONS, outline_of, radius_around
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.objects.families import family_table


@pytest.mark.parametrize(("name", "radius_m"), [
    ("block", np.hypot(0.030, 0.040)), ("wedge", np.hypot(0.030, 0.030)),
    ("large_cylinder", 0.035), ("funnel", 0.050), ("coke_bottle", 0.030)])
def test_the_cylinder_around_a_body_is_as_wide_as_it_is(name: str, radius_m: float) -> None:
    assert radius_around(body_from_name(name)) == pytest.approx(radius_m, abs=5e-6)


def test_a_superquadric_reaches_as_far_as_its_formula() -> None:
    """Its distances are estimates. Seen from above it is |x/a|^(2/e) + |y/b|^(2/e) = 1, whose
    support in a direction is the norm dual to that of 2/e."""
    table = {"superquadric": {"size_mm": [50.0, 20.0, 40.0], "exponents": [0.3, 0.6]},
             "name": "rounded"}
    body = body_from_table(table, Path())
    angle = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    way = np.stack([np.cos(angle), np.sin(angle)], 1)
    power = 2 / 0.6
    true = (np.abs(way * [0.05, 0.02]) ** (power / (power - 1))).sum(1) ** ((power - 1) / power)
    assert np.abs((outline_of(body) * way).sum(1) - true).max() < 1e-5


@pytest.mark.parametrize("name", [
    pytest.param("mug-1", marks=pytest.mark.slow), "hammer-1",
    pytest.param("toy-1", marks=pytest.mark.slow)])
def test_no_place_of_a_body_lies_beyond_its_outline(name: str) -> None:
    """Of compounds with edges, by points that fill a box and distances alone."""
    body = body_from_table(family_table(name), Path())
    hull = ConvexHull(outline_of(body))
    low, high = np.asarray(body.low_m) - 0.005, np.asarray(body.high_m) + 0.005
    points = np.random.default_rng(3).uniform(low, high, (400_000, 3))
    beyond = (points[:, :2] @ hull.equations[:, :2].T + hull.equations[:, 2]).max(1) > 5e-5
    inside = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int), points[None])[0][0] < 0
    assert inside.any()
    assert not (inside & beyond).any()
