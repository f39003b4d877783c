"""Bodies that what was felt, swept space, table or prior contradict are no results."""

from dataclasses import replace

import numpy as np
import pytest

from fit.revolution.geometry import RevolutionBody, revolution_surface
from fit.superquadric.geometry import superquadric
from strategies.poses.waypoints import BoundingCylinder
from strategies.recovery.choose_model import Recovered, Shape
from strategies.recovery.contact_verdict import known_gaps
from strategies.recovery.evidence import Evidence
from strategies.recovery.misfit import FARTHEST_M
from strategies.recovery.plausibility import (
    plausible,
    plausible_contour,
    swept,
    within_reach,
)

PRIOR = BoundingCylinder(np.array([0.45]), np.array([0.0]), np.array([0.05]), np.array([0.12]))
SIZE = (0.04, 0.03, 0.05)


def body(x=0.45, z=0.05, size=SIZE, quaternion=(0, 0, 0, 1)):
    return superquadric(size, (0.3, 1.0), (x, 0.0, z), quaternion)


def evidence(points: np.ndarray, free: np.ndarray) -> Evidence:
    count = len(points)
    return Evidence(points[None], np.ones((1, count), bool), np.tile(np.eye(3), (1, count, 1, 1)),
                    np.full((1, count, 3), np.nan), free[None], 0.006,
                    np.ones((1, len(free)), bool), np.zeros((1, count), bool),
                    np.zeros((1, count)))


@pytest.mark.parametrize(("side_m", "shift_m"), [(0.04, 0.0), (0.02, 0.06), (0.06, -0.03)])
def test_a_body_to_explore_by_stays_within_twice_the_priors_reach(
        side_m: float, shift_m: float) -> None:
    """The prior reaches 50 mm from its middle, and 10 mm is its error: up to 120 mm."""
    prior = BoundingCylinder(np.array([0.45]), np.array([0.0]), np.array([0.03]), np.array([0.08]),
                             margin_m=0.01)
    corner = np.sqrt(0.75) * side_m  # from a cube's middle
    for factor, right in ((1.001, False), (0.999, True)):
        high = factor * np.sqrt((0.12 - corner) ** 2 - shift_m**2)
        cube = body(x=0.45 + shift_m, z=0.04 + high, size=(side_m / 2,) * 3)
        assert within_reach(cube, prior).tolist() == [right]
    assert not within_reach(body(x=np.nan), prior).any()


@pytest.mark.parametrize(("found", "right"), [
    (body(), True),
    (body(z=0.075), True),  # touches low down may have been missed
    (body(z=0.045, size=(0.05, 0.04, 0.045)), True),
    (body(x=0.55), False),  # 90 mm beyond the prior's side
    (body(z=0.11, size=(0.04, 0.03, 0.11)), False),  # 100 mm above it
    (body(z=0.03), False),  # 20 mm in the table
    (body(z=0.09), False),  # 40 mm above the table
    (body(size=(0.16, 0.03, 0.05)), False),
    (body(size=(0.0001, 0.03, 0.05)), False),  # a sheet
    (body(size=(0.001, 0.001, 0.05)), False),  # a needle
    (body(size=(0.004, 0.03, 0.05)), True),  # a plate
])
def test_prior_and_table(found, right: bool) -> None:
    assert plausible(found, PRIOR).tolist() == [right]


def test_a_part_may_be_as_small_as_it_likes() -> None:
    assert plausible(body(size=(0.001, 0.001, 0.05)), PRIOR, whole=False).tolist() == [True]


def test_a_prior_that_is_known_less_well_contradicts_fewer_bodies() -> None:
    assert plausible(body(x=0.55), replace(PRIOR, margin_m=0.12)).tolist() == [True]
    assert plausible(body(x=0.75), replace(PRIOR, margin_m=0.12)).tolist() == [False]


def test_a_robot_that_is_not_told_the_table_does_not_judge_by_it() -> None:
    """A study of what the table is worth failed bodies by the table that it left out."""
    assert plausible(body(z=0.03), PRIOR, table_plane=False).tolist() == [True]
    assert plausible(body(x=0.55), PRIOR, table_plane=False).tolist() == [False]


def contour(radius: float, high: float = 0.12) -> RevolutionBody:
    return RevolutionBody(np.array([[0.45, 0.0, 0.0]]), np.array([[0.0, 0.0, 1.0]]),
                          np.linspace(0.0, high, 6)[None], np.full((1, 6), radius))


def felt(of: RevolutionBody, count: int) -> np.ndarray:
    """Points on the side."""
    points = revolution_surface(of)[0][0]
    points = points[(points[:, 2] > 0.01) & (points[:, 2] < 0.95 * of.height_m.max())]
    return points[np.linspace(0, len(points) - 1, count).astype(int)]


OUTSIDE = np.array([[0.45 + 0.2, 0.0, 0.1]])
ON_THE_AXIS = np.column_stack([np.full(4, 0.45), np.zeros(4), np.linspace(0.03, 0.09, 4)])


@pytest.mark.parametrize(("found", "points", "free", "right"), [
    (contour(0.05), felt(contour(0.05), 20), OUTSIDE, True),
    (contour(0.05), felt(contour(0.05), 7), OUTSIDE, False),  # too few contacts
    (contour(0.05), felt(contour(0.065), 20), OUTSIDE, False),  # they lie 15 mm away
    (contour(0.05), felt(contour(0.05), 20), ON_THE_AXIS, False),  # fingers went through it
    (contour(0.15), felt(contour(0.15), 20), OUTSIDE, False),  # three times as wide as the prior
    (contour(0.05, 0.25), felt(contour(0.05, 0.25), 20), OUTSIDE, False),
    (contour(0.004), felt(contour(0.004), 20), OUTSIDE, False),  # it fills nothing of the prior
])
def test_contours(found, points, free, right: bool) -> None:
    assert plausible_contour(found, evidence(points, free), PRIOR).tolist() == [right]


def test_contours_are_not_judged_by_what_fits_may_not_use() -> None:
    """As superquadrics: without `fit.free_space`, or `fit.table_plane`."""
    found, sunk = contour(0.05), replace(contour(0.05), foot_m=np.array([[0.45, 0.0, -0.03]]))
    through = evidence(felt(found, 20), ON_THE_AXIS)
    assert plausible_contour(found, through, PRIOR, free_space=False).tolist() == [True]
    deep = evidence(felt(found, 20) - [0.0, 0.0, 0.03], OUTSIDE)
    assert plausible_contour(sunk, deep, PRIOR).tolist() == [False]
    assert plausible_contour(sunk, deep, PRIOR, table_plane=False).tolist() == [True]


def test_a_contour_of_fewer_nodes_than_its_neighbours_is_as_large() -> None:
    one = contour(0.05)
    one.radius_m[0] = np.linspace(0.001, 0.05, 6)  # as a funnel's
    padded = RevolutionBody(one.foot_m, one.axis, np.pad(
        one.height_m, ((0, 0), (0, 3)), constant_values=np.nan), np.pad(
        one.radius_m, ((0, 0), (0, 3)), constant_values=np.nan))
    assert plausible_contour(padded, evidence(felt(one, 20), OUTSIDE), PRIOR).tolist() == [True]


def test_a_finger_that_passed_through_contradicts_any_body() -> None:
    assert swept(body(), evidence(np.zeros((1, 3)), ON_THE_AXIS)).tolist() == [True]
    assert swept(body(), evidence(np.zeros((1, 3)), OUTSIDE)).tolist() == [False]


def test_slots_without_a_ball_do_not_hide_that_a_finger_passed_through() -> None:
    few = evidence(np.zeros((1, 3)), np.concatenate([ON_THE_AXIS, np.zeros((60, 3))]))
    assert swept(body(), replace(few, free_mask=np.arange(64)[None] < 4)).tolist() == [True]


@pytest.mark.parametrize(("up_m", "right"), [(0.0, True), (-0.012, False), (0.032, False)])
def test_a_contour_that_leans_stands_on_its_rim(up_m: float, right: bool) -> None:
    """By 20 degrees; its axis ends above the table by the radius times the sine of that."""
    lean = np.radians(20)
    foot = np.array([[0.45, 0.0, 0.03 * np.sin(lean) + up_m]])
    found = RevolutionBody(foot, np.array([[np.sin(lean), 0.0, np.cos(lean)]]),
                           np.linspace(0.0, 0.10, 6)[None], np.full((1, 6), 0.03))
    points = revolution_surface(found)[0][0][::40]
    assert plausible_contour(found, evidence(points, OUTSIDE), PRIOR).tolist() == [right]


def test_contacts_far_from_the_body_are_not_its() -> None:
    recovered = Recovered(np.array([Shape.SUPERQUADRIC]), body())
    points = np.array([[[0.45 + 0.04, 0.0, 0.05], [0.45 + 0.045, 0.0, 0.05],
                        [0.45 + 0.10, 0.0, 0.05], [0.45, 0.0, 0.05]]])
    near = known_gaps(recovered, points, np.ones((1, 4), bool)) <= FARTHEST_M
    assert near.tolist() == [[True, True, False, False]]
    nothing = Recovered(np.array([Shape.PRIOR]), body())
    assert np.isinf(known_gaps(nothing, points, np.ones((1, 4), bool))).all()
