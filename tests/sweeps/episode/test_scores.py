"""Scores against meshes and nearest neighbours that nobody here wrote."""

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from fit.revolution.geometry import RevolutionBody, revolution_distance
from fit.superquadric.geometry import Superquadric, superquadric, superquadric_surface
from strategies.recovery.choose_model import Recovered, Shape
from sweeps.episode.scores import (
    DENSE,
    FINE,
    ROUGH,
    Samples,
    _distance_to_contours,
    distance_to_surface,
    score_recovered,
    score_superquadrics,
    scores_again,
    weighted_quantile,
)
from sweeps.validate.bodies.dense_scores import Triangles, elements_of, split, superquadric_corners
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects.catalogue import body_from_name, body_from_table

AT = np.array([[0.45, 0.1, 0, 0, 0, np.sin(0.4), np.cos(0.4)]])


def standing(size, exponents, taper=(0, 0)) -> Superquadric:
    """A superquadric that stands where `AT` says."""
    return superquadric(size, exponents, [0.45, 0.1, size[2]], AT[0, 3:], taper)


def test_a_perfect_fit_scores_perfectly() -> None:
    scores = score_superquadrics(standing([0.03, 0.04, 0.06], [0.01, 0.01]),
                                 body_from_name("block"), AT)
    assert scores.iou[0] == pytest.approx(1.0, abs=0.01)
    assert scores.chamfer_m[0] < 2e-4
    assert scores.coverage[0] == 1.0
    assert scores.volume_ratio[0] == pytest.approx(1.0, abs=0.01)


def test_an_inscribed_block_has_the_ratio_of_volumes() -> None:
    scores = score_superquadrics(standing([0.024, 0.032, 0.048], [0.01, 0.01]),
                                 body_from_name("block"), AT)
    assert scores.iou[0] == pytest.approx(0.8**3, abs=0.01)
    assert scores.iou[0] <= scores.volume_ratio[0]  # though its points are samples


@pytest.mark.parametrize(("name", "size", "exponents", "taper"), [
    ("large_cylinder", [0.037, 0.033, 0.063], [0.3, 0.9], (0, 0)),
    ("wedge", [0.03, 0.03, 0.05], [0.1, 0.1], (-0.8, 0.1)),
    ("lightbulb", [0.03, 0.03, 0.055], [0.9, 1.0], (0.4, 0.4)),
])
def test_distances_against_a_kd_tree(name: str, size, exponents, taper) -> None:
    body, fits = body_from_name(name), standing(size, exponents, taper)
    scores = score_superquadrics(fits, body, AT)
    turn = np.array([[np.cos(0.8), -np.sin(0.8), 0], [np.sin(0.8), np.cos(0.8), 0], [0, 0, 1]])
    true = sample_body(body, surface=16384).surface_m @ turn.T + AT[0, :3]
    found, _, area = superquadric_surface(fits, 24_000)
    share = area[0] / area[0].sum()
    there, back = cKDTree(found[0]).query(true)[0], cKDTree(true).query(found[0])[0]
    chamfer = 0.5 * (there.mean() + (back * share).sum())
    assert scores.chamfer_m[0] == pytest.approx(chamfer, abs=4e-4)
    order = np.argsort(back)
    tail = back[order][np.searchsorted(np.cumsum(share[order]), 0.95)]
    assert scores.hausdorff95_m[0] == pytest.approx(max(np.quantile(there, 0.95), tail), abs=1e-3)


@pytest.mark.parametrize("exponent", [0.1, 0.2])
def test_rounded_edges_of_a_block_count_below_a_millimetre(exponent: float) -> None:
    body, fits = body_from_name("block"), standing([0.03, 0.04, 0.06], [exponent, exponent])
    scores = score_superquadrics(fits, body, AT)
    here = superquadric([0.03, 0.04, 0.06], [exponent, exponent], [0, 0, 0.06], [0, 0, 0, 1])
    corner = split(superquadric_corners(here, 64))
    half, middle = np.array([0.03, 0.04, 0.06]), np.array([0, 0, 0.06])
    line = (np.arange(60) + 0.5) / 30 - 1.0
    u, v = (grid.ravel() for grid in np.meshgrid(line, line))
    face = np.stack([np.ones_like(u), u, v], -1)
    sides = [(side * face[:, [(k - a) % 3 for k in range(3)]] * half + middle,
              4 * np.prod(np.delete(half, a))) for a in range(3) for side in (1.0, -1.0)]
    there = sum(Triangles(corner).distance(points).mean() * area for points, area in sides)
    there /= sum(area for _, area in sides)
    found = elements_of(corner)
    back = np.abs(np.abs(found.middle - middle) - half).min(1) @ found.share
    assert scores.chamfer_m[0] == pytest.approx(0.5 * (there + back), rel=0.015, abs=1.5e-5)


def test_distances_to_contours_are_those_of_the_geometry() -> None:
    rng = np.random.default_rng(8)
    axis = rng.normal(size=(5, 3))
    height = np.cumsum(rng.uniform(0.0, 0.03, (5, 6)), axis=1)
    height[3:, 4:] = np.nan
    body = RevolutionBody(rng.normal(0.0, 0.1, (5, 3)),
                          axis / np.linalg.norm(axis, axis=1, keepdims=True), height,
                          np.where(np.isnan(height), np.nan, rng.uniform(0.0, 0.05, (5, 6))))
    points = rng.normal(0.0, 0.1, (200, 3))
    assert np.allclose(_distance_to_contours(body, points, "cpu"),
                       revolution_distance(body, np.tile(points, (5, 1, 1))), atol=1e-12)


def mug_surface(count: int) -> np.ndarray:
    """Points even over the surface of a mug, 80 mm wide and 90 mm high, of walls of 4 mm and a
    floor of 6 mm: walls of radius r between two heights, rings between two radii."""
    rng = np.random.default_rng(1)
    pieces = []
    for r, low, high in ((0.040, 0.0, 0.090), (0.036, 0.006, 0.090)):
        share = rng.uniform(size=int(count * 2 * np.pi * r * (high - low) / 0.0516))
        pieces.append((np.full(len(share), r), low + share * (high - low)))
    for inner, outer, z in ((0.0, 0.040, 0.0), (0.0, 0.036, 0.006), (0.036, 0.040, 0.090)):
        share = rng.uniform(size=int(count * np.pi * (outer**2 - inner**2) / 0.0516))
        pieces.append((np.sqrt(inner**2 + share * (outer**2 - inner**2)),
                       np.full(len(share), z)))
    radius, z = (np.concatenate(column) for column in zip(*pieces, strict=True))
    angle = rng.uniform(0.0, 2 * np.pi, len(z))
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


@pytest.mark.parametrize(("size", "exponents"), [
    ([0.040, 0.040, 0.045], [0.1, 1.0]),  # a lid over the opening, 36 mm from the wall
    pytest.param([0.038, 0.038, 0.043], [0.5, 1.0], marks=pytest.mark.slow),
])
def test_a_hollow_body_against_a_kd_tree(size, exponents) -> None:
    outer = {"shape": "cylinder", "radius_mm": 40, "height_mm": 90}
    inner = {"shape": "cylinder", "radius_mm": 36, "height_mm": 90, "at_mm": [0, 0, 6]}
    mug = body_from_table(
        {"name": "mug", "compound": [outer, inner | {"join": "difference"}]}, Path())
    at = np.array([[0.0, 0, 0, 0, 0, 0, 1]])
    fits = superquadric(size, exponents, [0, 0, size[2]], at[0, 3:])
    scores = score_superquadrics(fits, mug, at)
    true = mug_surface(400_000)
    found, _, area = superquadric_surface(fits, 24_000)
    share = area[0] / area[0].sum()
    there, back = cKDTree(found[0]).query(true[::10])[0], cKDTree(true).query(found[0])[0]
    chamfer = 0.5 * (there.mean() + (back * share).sum())
    assert scores.chamfer_m[0] == pytest.approx(chamfer, abs=3e-4)
    order = np.argsort(back)
    tail = back[order][np.searchsorted(np.cumsum(share[order]), 0.95)]
    assert scores.hausdorff95_m[0] == pytest.approx(max(np.quantile(there, 0.95), tail), abs=1e-3)


def test_only_bodies_that_changed_are_scored_again() -> None:
    body, pose = body_from_name("block"), np.repeat(AT, 4, axis=0)
    one = standing([0.03, 0.04, 0.06], [0.1, 0.1])
    fits = Superquadric(*(np.repeat(field, 4, axis=0) for field in one))
    height = np.tile([0.0, 0.06, 0.12, np.nan], (4, 1))
    turned = RevolutionBody(np.tile([0.45, 0.1, 0.0], (4, 1)), np.tile([0.0, 0.0, 1.0], (4, 1)),
                            height, np.where(np.isnan(height), np.nan, 0.03))
    first = Recovered(np.repeat([Shape.SUPERQUADRIC, Shape.REVOLUTION], 2), fits, turned)
    scores = score_recovered(first, body, pose)
    assert scores_again(first, first, scores, body, pose) is scores
    # One larger, one another model; a contour with more room for nodes is the same contour.
    size = fits.size_m * np.array([1.0, 1.1, 1.0, 1.0])[:, None]
    wide = replace(turned, height_m=np.pad(height, ((0, 0), (0, 2)), constant_values=np.nan),
                   radius_m=np.pad(turned.radius_m, ((0, 0), (0, 2)), constant_values=np.nan))
    then = Recovered(np.array([1, 1, 2, Shape.SUPERQUADRIC]), fits._replace(size_m=size), wide)
    again, whole = scores_again(then, first, scores, body, pose), score_recovered(then, body, pose)
    for name, values in asdict(again).items():
        assert np.array_equal(values, getattr(whole, name)), name
    assert (again.iou != scores.iou).tolist() == [False, True, False, True]


def test_worlds_are_scored_some_at_a_time_with_the_same_bits(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(3)
    body, pose = body_from_name("wedge"), np.repeat(AT, 8, axis=0)
    fits = superquadric(rng.uniform(0.02, 0.06, (8, 3)), rng.uniform(0.1, 1.0, (8, 2)),
                        pose[:, :3] + rng.normal(0, 0.01, (8, 3)), pose[:, 3:], np.zeros((8, 2)),
                        np.zeros((8, 2)))
    turned = RevolutionBody(pose[:, :3], np.tile([0.0, 0.0, 1.0], (8, 1)),
                            np.tile([0.0, 0.06, 0.12], (8, 1)), rng.uniform(0.02, 0.05, (8, 3)))
    given = Recovered(np.tile([Shape.SUPERQUADRIC, Shape.REVOLUTION], 4), fits, turned)
    whole = [score_recovered(given, body, pose), score_superquadrics(fits, body, pose)]
    monkeypatch.setattr("sweeps.episode.scores.WORLDS_AT_ONCE", 3)
    parts = [score_recovered(given, body, pose), score_superquadrics(fits, body, pose)]
    for one, other in zip(whole, parts, strict=True):
        for name, values in asdict(one).items():
            assert np.array_equal(values, getattr(other, name)), name


@pytest.mark.parametrize("name", ["block", "lightbulb", "wine_bottle"])
def test_rough_scores_are_near_the_fine_ones(name: str) -> None:
    body, size = body_from_name(name), np.random.default_rng(3).uniform(0.8, 1.2, (8, 3))
    half = 0.5 * (np.array(body.high_m) - body.low_m)
    fits = Superquadric(half * size, np.full((8, 2), 0.4),
                        np.tile(AT[0, :3] + [0.0, 0.0, half[2]], (8, 1)),
                        np.tile([0.0, 0.0, 0.0, 1.0], (8, 1)), np.zeros((8, 2)), np.zeros((8, 2)))
    given, at = Recovered(np.full(8, Shape.SUPERQUADRIC), fits), np.repeat(AT, 8, axis=0)
    fine, rough = (score_recovered(given, body, at, samples=samples) for samples in (FINE, ROUGH))
    np.testing.assert_allclose(rough.chamfer_m, fine.chamfer_m, rtol=0.03)
    np.testing.assert_allclose(rough.iou, fine.iou, atol=0.015)
    assert (rough.chamfer_m != fine.chamfer_m).all()


@pytest.mark.parametrize(("samples", "within"), [(FINE, 0.006), (DENSE, 0.001)])
def test_quantiles_of_two_spheres_against_the_integral(samples: Samples, within: float) -> None:
    """On a sphere heights are uniform: distances to another, aside by c, follow from them."""
    radius, other, aside = 0.04, 0.038, 0.005
    body = body_from_table({"name": "ball", "compound": [
        {"shape": "sphere", "radius_mm": 1e3 * radius}]}, Path())
    middle = body.low_m[2] + radius
    fits = superquadric([other] * 3, [1.0, 1.0], [aside, 0.0, middle], [0.0, 0.0, 0.0, 1.0])
    pose = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    found = score_recovered(Recovered(np.array([Shape.SUPERQUADRIC]), fits), body, pose,
                            samples=samples)
    height = (np.arange(200_000) + 0.5) / 100_000 - 1.0
    sides = [np.abs(np.sqrt(a**2 + aside**2 - 2 * a * aside * height) - b)
             for a, b in ((radius, other), (other, radius))]
    assert found.hausdorff95_m[0] == pytest.approx(
        max(np.quantile(side, 0.95) for side in sides), rel=within)
    assert found.chamfer_m[0] == pytest.approx(np.mean(sides), rel=within)
    assert found.square_m2[0] == pytest.approx(2.0 * np.mean(np.square(sides)), rel=2 * within)


@pytest.mark.slow
def test_bodies_of_both_kinds_have_dense_scores() -> None:
    body, pose = body_from_name("wine_bottle"), np.repeat(AT, 2, axis=0)
    fits = superquadric(np.full((2, 3), 0.04), np.ones((2, 2)), pose[:, :3] + [0, 0, 0.04],
                        pose[:, 3:], np.zeros((2, 2)), np.zeros((2, 2)))
    turned = RevolutionBody(pose[:, :3], np.tile([0.0, 0.0, 1.0], (2, 1)),
                            np.tile([0.0, 0.1, 0.2], (2, 1)), np.full((2, 3), 0.03))
    given = Recovered(np.array([Shape.SUPERQUADRIC, Shape.REVOLUTION]), fits, turned)
    fine, dense = (score_recovered(given, body, pose, samples=samples) for samples in (FINE, DENSE))
    np.testing.assert_allclose(dense.hausdorff95_m, fine.hausdorff95_m, rtol=0.05)
    np.testing.assert_allclose(dense.iou, fine.iou, atol=0.01)
    assert (dense.hausdorff95_m != fine.hausdorff95_m).all()


def test_distances_to_a_compound_against_a_formula() -> None:
    """Two blocks that stand on each other are one, whose distance is known."""
    half = {"shape": "block", "size_mm": [60, 60, 60]}
    body = body_from_table({"name": "stack", "compound": [half, half | {"at_mm": [0, 0, 60]}]},
                           Path())
    on = sample_body(body, surface=2048).surface_m
    points = on + np.random.default_rng(4).uniform(-0.002, 0.002, on.shape)
    out = np.abs(points - [0.0, 0.0, 0.060]) - [0.030, 0.030, 0.060]
    true = np.abs(np.linalg.norm(np.maximum(out, 0.0), axis=1) + np.minimum(out.max(1), 0.0))
    found = distance_to_surface(body, points[None])[0]
    assert found.mean() == pytest.approx(true.mean(), rel=0.003)
    assert np.quantile(found - true, 0.99) < 5e-5


@given(seed=st.integers(0, 2**32 - 1), count=st.sampled_from([2, 3, 50, 400]),
       power=st.sampled_from([0.0, 1.0, 30.0]), q=st.sampled_from([0.5, 0.9, 0.95]))
def test_weighted_quantiles_against_all_values_sorted(
    seed: int, count: int, power: float, q: float
) -> None:
    """Also where a few values hold nearly all, and in rows beside such."""
    rng = np.random.default_rng(seed)
    values, share = rng.exponential(size=(4, count)), rng.uniform(size=(4, count))
    share[::2] **= power
    share /= share.sum(1, keepdims=True)
    found = weighted_quantile(values, share, q)
    for row in range(4):
        order = np.argsort(values[row])
        middle = np.cumsum(share[row][order]) - 0.5 * share[row][order]
        rising = values[row][order]
        assert found[row] == pytest.approx(np.interp(q, middle, rising), rel=1e-6, abs=1e-9)
        assert found[row] == weighted_quantile(values[row:row + 1], share[row:row + 1], q)[0]
