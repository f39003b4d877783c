"""A broken contour is completed by what grasps felt; what is round is told from what is not."""

from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest

from fit.arrays import rows_of
from fit.revolution.record import RevolutionFit
from fit.superquadric.fit import fit_superquadric
from strategies.planners.next_procedure import turned
from strategies.poses.waypoints import BoundingCylinder
from strategies.procedures.contour_shape import Profile, with_profiles
from strategies.procedures.options import DecideTable
from strategies.recovery.complete_contour import (
    contour_span,
    revolution_of_all,
    whole_profile,
)
from strategies.recovery.evidence import Evidence

PRIOR = BoundingCylinder(*(np.array([v]) for v in (0.45, 0.0, 0.05, 0.12)))
"""A cone on a thin stem, as told."""


def stem_and_cone(n: int, low: float, high: float, seed: int) -> np.ndarray:
    """Points on a stem of 6 mm that opens above 40 mm into a cone, from `low` to `high`."""
    rng = np.random.default_rng(seed)
    z, angle = rng.uniform(low, high, n), rng.uniform(0, 2 * np.pi, n)
    radius = np.where(z < 0.04, 0.006, 0.006 + 0.55 * (z - 0.04))
    points = np.stack([0.45 + radius * np.cos(angle), radius * np.sin(angle), z], 1)
    return points + rng.normal(0, 0.0005, points.shape)


def evidence_of(points: np.ndarray) -> Evidence:
    n = len(points)
    return Evidence(points[None], np.ones((1, n), bool), np.tile(np.eye(3) * 1e-6, (1, n, 1, 1)),
                    np.full((1, n, 3), np.nan), np.zeros((1, 0, 3)), 0.006, np.zeros((1, 0), bool),
                    np.zeros((1, n), bool), np.zeros((1, n)))


def followed_to(height: float) -> Profile:
    """A contour of the stem alone."""
    one = np.array([0.0])
    return Profile(np.array([[0.45, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]]),
                   np.array([[0.0, height]]), np.array([[0.006, 0.006]]),
                   one + np.pi * 0.006**2 * height, one + 0.006, one + height, one + 0.0005,
                   SimpleNamespace())  # pyright: ignore


def test_a_contour_blocked_below_the_cone_is_completed_by_grasps() -> None:
    points = np.concatenate([stem_and_cone(10, 0.02, 0.036, 1), stem_and_cone(80, 0.01, 0.12, 2)])
    evidence, contour = evidence_of(points), np.arange(10)
    whole = whole_profile(followed_to(0.036), evidence, contour, PRIOR)
    z = np.array([0.03, 0.06, 0.09, 0.115])
    radius = np.interp(z, whole.height_m[0], whole.radius_m[0])
    assert np.allclose(radius, np.where(z < 0.04, 0.006, 0.006 + 0.55 * (z - 0.04)), atol=0.003)
    assert np.isclose(whole.length_m[0], 0.12, atol=0.004)
    # A stem, and a frustum that opens from its radius.
    wide = 0.006 + 0.55 * 0.08
    volume = np.pi * (0.006**2 * 0.04 + 0.08 / 3 * (0.006**2 + 0.006 * wide + wide**2))
    assert whole.volume_m3[0] == pytest.approx(volume, rel=0.1)
    assert whole.largest_radius_m[0] == pytest.approx(wide, abs=0.003)
    assert 0.0003 < whole.rms_m[0] < 0.001  # touches err by 0.5 mm


def test_one_touch_far_above_does_not_make_it_tall() -> None:
    stray = np.array([[0.46, 0.01, 0.17]])
    points = np.concatenate([stem_and_cone(10, 0.02, 0.036, 1), stem_and_cone(80, 0.01, 0.12, 2),
                             stray])
    whole = whole_profile(followed_to(0.036), evidence_of(points), np.arange(10), PRIOR)
    assert whole.length_m[0] < 0.125


def test_touches_beyond_the_prior_and_its_error_take_no_part() -> None:
    """The prior reaches 50 mm out and 120 mm up, and errs by 30 mm."""
    beyond = np.array([[0.45, 0.01, 0.151], [0.45, 0.081, 0.05]])
    within = np.array([[0.45, 0.01, 0.149], [0.45, 0.079, 0.05]])
    felt = np.concatenate([stem_and_cone(60, 0.01, 0.12, 2), beyond, within])
    assert revolution_of_all(evidence_of(felt), PRIOR).n_points.tolist() == [62]


def test_a_contour_followed_to_the_top_is_left_as_it_is() -> None:
    points = np.concatenate([stem_and_cone(20, 0.015, 0.12, 1), stem_and_cone(40, 0.01, 0.12, 2)])
    evidence, profile = evidence_of(points), followed_to(0.12)
    low, high = contour_span(profile, evidence, np.arange(20))
    assert low[0] < 0.3
    assert high[0] > 0.9
    assert whole_profile(profile, evidence, np.arange(20), PRIOR) is profile
    padded = evidence_of(np.concatenate([points, np.zeros((40, 3))]))
    there = contour_span(profile, replace(padded, mask=np.arange(100)[None] < 60), np.arange(20))
    np.testing.assert_array_equal(there, (low, high))


def test_a_funnel_is_round_and_a_block_is_not() -> None:
    rng = np.random.default_rng(5)
    side = rng.uniform(-1, 1, (80, 3)) * [0.03, 0.04, 0.055]
    face = rng.integers(0, 4, 80)
    side[np.arange(80), face // 2] = np.where(face % 2, 1, -1) * np.array([0.03, 0.04])[face // 2]
    block = side + [0.45, 0.0, 0.06]
    for points, expected in ((stem_and_cone(80, 0.01, 0.12, 3), True), (block, False)):
        evidence = evidence_of(points)
        fits = fit_superquadric(evidence.points_m, evidence.mask, table_z=0.0)
        belief = SimpleNamespace(worlds=1, evidence=evidence, fits=fits, prior=PRIOR)
        row, never = np.arange(1), replace(DecideTable(), turned_within=0.0)
        assert turned(belief, DecideTable(), row)[0] == expected  # pyright: ignore
        assert not turned(belief, never, row)[0]  # pyright: ignore


def test_profiles_of_some_worlds_take_their_place_among_all() -> None:
    none = RevolutionFit(**{f.name: np.zeros(3) for f in fields(RevolutionFit)})
    one = followed_to(0.04)
    three = replace(one, **{f.name: np.repeat(getattr(one, f.name), 3, axis=0)
                            for f in fields(Profile) if f.name != "fit"}, fit=none)
    taller = np.array([[0.0, 0.02, 0.06]])
    part = replace(rows_of(three, np.array([1])), height_m=taller, radius_m=taller * 0.0 + 0.007)
    found = with_profiles(three, np.array([1]), part)
    assert np.array_equal(found.height_m[1:2], taller)
    assert np.array_equal(found.height_m[[0, 2], :2], three.height_m[[0, 2]])
    assert np.isnan(found.height_m[[0, 2], 2]).all()
    assert np.array_equal(found.foot_m, three.foot_m)
