"""Distances: closed forms, 1-Lipschitz where claimed, gradients against finite differences."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from fit.superquadric.geometry import superquadric, superquadric_surface
from warpgrasp.core.kernel_launch import ShapeError
from warpgrasp.geometry.body import (
    Body,
    distance_to_bodies,
    scene_of,
    signed_distance_to_bodies,
)
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.objects.catalogue_names import BODY_NAMES

EXACT = [body_from_name(name) for name in BODY_NAMES] + [
    body_from_table({"name": n, "compound": [t]}, Path()) for n, t in (
        ("ball", {"shape": "sphere", "radius_mm": 30}),
        ("pill", {"shape": "capsule", "radius_mm": 20, "height_mm": 90}),
        ("lying", {"shape": "cylinder", "radius_mm": 20, "height_mm": 80,
                   "rpy_deg": [90, 0, 30], "at_mm": [5, 0, 20]}))]
JOINED = [body_from_table({"name": join, "compound": [
    {"shape": "cylinder", "radius_mm": 30, "height_mm": 90},
    {"shape": "sphere", "join": join, "radius_mm": 30, "at_mm": [20, 0, 30]}]}, Path())
    for join in ("union", "difference", "intersection")]
coordinate = st.floats(-0.15, 0.15)
point = st.tuples(coordinate, coordinate, st.floats(-0.1, 0.4))


def distance(body: Body, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    d, g = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int), points[None])
    return d[0], g[0]


@pytest.mark.parametrize("body", EXACT, ids=lambda b: b.name)
@settings(max_examples=25)
@given(a=st.lists(point, min_size=1, max_size=20), b=st.lists(point, min_size=1, max_size=20))
def test_exact_distances_are_1_lipschitz(body: Body, a: list, b: list) -> None:
    pa, pb = np.array(a), np.array(b)
    da, db = distance(body, pa)[0], distance(body, pb)[0]
    gap = np.linalg.norm(pa[:, None] - pb[None], axis=-1)
    assert (np.abs(da[:, None] - db[None]) <= gap + 1e-12).all()


@pytest.mark.parametrize("body", EXACT, ids=lambda b: b.name)
def test_gradients_are_unit_and_match_finite_differences(body: Body) -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform((-0.12, -0.12, -0.05), (0.12, 0.12, 0.35), (400, 3))
    _, g = distance(body, points)
    assert np.allclose(np.linalg.norm(g, axis=1), 1.0, atol=1e-9)
    step = 1e-6
    slope = np.stack([(distance(body, points + step * e)[0] - distance(body, points - step * e)[0])
                      / (2 * step) for e in np.eye(3)], axis=1)
    smooth = np.abs(np.linalg.norm(slope, axis=1) - 1.0) < 1e-4  # away from the medial axis
    assert smooth.mean() > 0.95
    assert np.abs(slope - g)[smooth].max() < 1e-4


@pytest.mark.parametrize("body", [*EXACT, *JOINED], ids=lambda b: b.name)
def test_distances_alone_are_those_told_with_their_gradients(body: Body) -> None:
    """By functions of their own, which need fewer roots."""
    points = np.random.default_rng(4).uniform((-0.12, -0.12, -0.05), (0.12, 0.12, 0.35), (2000, 3))
    alone = signed_distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int), points[None])[0]
    np.testing.assert_allclose(alone, distance(body, points)[0], atol=1e-12)


@pytest.mark.parametrize("body", EXACT, ids=lambda b: b.name)
def test_the_gradient_leads_to_the_surface(body: Body) -> None:
    points = np.random.default_rng(1).uniform((-0.12, -0.12, -0.05), (0.12, 0.12, 0.35), (500, 3))
    d, g = distance(body, points)
    assert np.abs(distance(body, points - d[:, None] * g)[0]).max() < 1e-9


def test_closed_forms() -> None:
    block = body_from_name("block")  # 60 x 80 x 120 mm
    points = np.array([[0.040, 0, 0.06], [0, 0, 0.13], [0.033, 0.044, 0.06], [0, 0, 0.06]])
    assert np.allclose(distance(block, points)[0], [0.010, 0.010, 0.005, -0.030])
    cylinder = body_from_name("large_cylinder")  # diameter 70, height 120 mm
    points = np.array([[0.045, 0, 0.06], [0.038, 0, 0.124], [0, 0, 0.115]])
    assert np.allclose(distance(cylinder, points)[0], [0.010, 0.005, -0.005])
    wedge = body_from_name("wedge")  # base 60 x 60, ridge at 100 mm
    assert np.allclose(distance(wedge, np.array([[0, 0, 0.11], [0, 0, -0.01]]))[0], [0.01, 0.01])
    side = np.hypot(0.03, 0.10)
    assert np.allclose(distance(wedge, np.array([[0, 0, 0.02]]))[0], -min(0.02, 0.03 * 0.08 / side))


def test_a_revolution_against_its_densely_sampled_profile() -> None:
    body = body_from_name("wine_bottle")
    profile = body.parts[0].profile_m
    z = np.linspace(profile[0, 0], profile[-1, 0], 200_001)
    outline = np.stack([np.interp(z, profile[:, 0], profile[:, 1]), z], 1)
    ends = [np.stack([np.linspace(0, profile[k, 1], 2001), np.full(2001, profile[k, 0])], 1)
            for k in (0, -1)]
    outline = np.concatenate([outline, *ends])
    rng = np.random.default_rng(2)
    section = rng.uniform((0.0, -0.05), (0.1, 0.37), (60, 2))
    turn = rng.uniform(-np.pi, np.pi, 60)
    rho, height = section.T
    points = np.stack([rho * np.cos(turn), rho * np.sin(turn), height], 1)
    nearest = cKDTree(outline).query(section)[0]
    assert np.abs(np.abs(distance(body, points)[0]) - nearest).max() < 2e-6


def test_a_superquadric_of_exponent_one_is_an_ellipsoid_and_never_overstates_outside() -> None:
    table = {"name": "egg", "superquadric": {"size_mm": [30, 30, 30], "exponents": [1, 1]}}
    sphere = body_from_table(table, Path())
    points = np.random.default_rng(3).uniform(-0.1, 0.1, (500, 3)) + [0, 0, 0.03]
    true = np.linalg.norm(points - [0, 0, 0.03], axis=1) - 0.03
    assert np.abs(distance(sphere, points)[0] - true)[true > -0.02].max() < 1e-6
    table = {"name": "box", "superquadric": {"size_mm": [30, 40, 60], "exponents": [0.3, 0.6]}}
    body = body_from_table(table, Path())
    d, g = distance(body, points)
    outside = d > 0
    for _ in range(50):  # march to the surface by the bound alone: never through it
        points[outside] -= d[outside, None] * g[outside]
        d, g = distance(body, points)
        assert d[outside].min() > -1e-7


@pytest.mark.parametrize(("e1", "e2"), [(1.0, 0.1), (1.9, 0.1), (0.1, 1.0), (0.1, 0.1), (2.0, 2.0)])
def test_a_superquadrics_surface_is_where_its_formula_says(e1: float, e2: float) -> None:
    """Square across and round above, its poles once lay flat: powers too small were left out."""
    body = body_from_table({"name": "dome", "superquadric": {
        "size_mm": [30, 40, 50], "exponents": [e1, e2]}}, Path())
    way = np.random.default_rng(8).normal(size=(400, 3)) * np.repeat([[1, 1, 1], [0.2, 0.2, 1]],
                                                                     200, axis=0)
    log = np.log(np.abs(way / np.array([0.03, 0.04, 0.05])))
    across = 0.5 * e2 * np.logaddexp(2 * log[:, 0] / e2, 2 * log[:, 1] / e2)
    radius = np.exp(0.5 * e1 * np.logaddexp(2 * across / e1, 2 * log[:, 2] / e1))
    points = way / radius[:, None] + [0, 0, 0.05]
    found, slope = distance(body, points)
    assert np.abs(found).max() < 1e-9
    step = 1e-7 * way / np.linalg.norm(way, axis=1, keepdims=True)
    ahead = distance(body, points + step)[0] - distance(body, points - step)[0]
    expected = 2 * (step * slope).sum(1)
    smooth = np.abs(ahead - expected) < 1e-3 * np.abs(expected) + 1e-12
    assert smooth.mean() > 0.97  # but for edges


def test_lumps_of_clay() -> None:
    mug = body_from_table({"name": "mug", "compound": [
        {"shape": "cylinder", "radius_mm": 40, "height_mm": 90},
        {"shape": "cylinder", "join": "difference", "radius_mm": 36, "height_mm": 90,
         "at_mm": [0, 0, 6]}]}, Path())
    d, g = distance(mug, np.array([[0, 0, 0.05], [0.038, 0, 0.05], [0, 0, 0.003]]))
    assert d[0] > 0.03
    assert d[1] == pytest.approx(-0.002, abs=1e-6)
    assert d[2] == pytest.approx(-0.003, abs=1e-6)
    assert g[0][2] == pytest.approx(0.0, abs=1e-9)


def test_a_taper_goes_no_further_than_the_body() -> None:
    """Above a wedge or a ridge is open air, as far as it truly is."""
    wedge = body_from_table({"name": "ridge", "superquadric": {
        "size_mm": [30, 30, 50], "exponents": [0.3, 0.3], "taper": [-0.8, 0.0]}}, Path())
    above = np.array([[[0.0, 0.0, 0.14], [0.002, 0.0, 0.2], [0.0, 0.01, 0.3]]])
    distance, normal = distance_to_bodies(scene_of([wedge], "cpu"), np.zeros(1, int), above)
    assert np.allclose(distance, above[..., 2] - 0.1, atol=1e-3)
    assert np.allclose(normal[..., 2], 1.0, atol=1e-2)


@pytest.mark.parametrize(("taper", "bend"), [
    ((-0.9, -0.9), 0.0), ((-1.0, 0.0), 0.0), ((1.0, -1.0), 0.0), ((0.9, 0.9), 5.0),
    ((-1.0, -1.0), 9.0)])
def test_beside_a_strong_tapers_thin_end_is_open_air(taper, bend: float) -> None:
    """Half the distance and more, where the first order alone leaves a twentieth of it."""
    body = body_from_table({"name": "cone", "superquadric": {
        "size_mm": [25, 30, 60], "exponents": [0.3, 0.5], "taper": list(taper),
        "bend_per_m": bend, "bend_deg": 30}}, Path())
    place = body.parts[0].place
    surface, _, _ = superquadric_surface(superquadric(
        (0.025, 0.03, 0.06), (0.3, 0.5), place[:3], place[3:], taper, (bend, np.radians(30))),
        50_000)
    points = np.random.default_rng(9).uniform(
        np.subtract(body.low_m, 0.1), np.add(body.high_m, 0.1), (5000, 3))
    true = cKDTree(surface[0]).query(points)[0]
    found, slope = distance(body, points)
    outside = (found > 0) & (true > 0.005)
    share = (found / true)[outside]
    assert np.quantile(share, 0.01) > 0.4
    assert np.quantile(share, 0.99) < 1.5
    assert share.max() < 2.0  # half of it is marched
    np.testing.assert_allclose(np.linalg.norm(slope, axis=1), 1.0, atol=1e-12)


def test_bodies_that_a_scene_has_not_and_scenes_elsewhere_are_refused() -> None:
    block = body_from_name("block")
    for number in (1, 50, -1):
        with pytest.raises(ValueError, match=f"body {number}: wants 0 to 0"):
            distance_to_bodies(scene_of([block], "cpu"), np.array([number]), np.zeros((1, 1, 3)))
    there = scene_of([block], "cpu")
    there.__dict__["device"] = "cuda:0"
    with pytest.raises(ShapeError, match="'scene' is on cuda:0, the launch on cpu"):
        distance_to_bodies(there, np.zeros(1, int), np.zeros((1, 1, 3)))
