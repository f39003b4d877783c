"""Where procedures go, worked out for the upright cylinders of `beliefs`."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from beliefs import BODY, belief

from fit.fit_status import FitStatus
from fit.superquadric.geometry import superquadric_points
from strategies.planners.next_procedure import (
    Next,
    contour_to_follow,
    decide,
    faces_to_cross,
    top_to_cross,
)
from strategies.procedures.options import ContourTable, DecideTable, PlanarTable
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Shape

BOTH = np.ones(2, bool)
BY_EXPONENT = DecideTable(turned_within=0.0)
BLOCKY, ROUND = 0.1, 1.0


def with_section(exponent: float, **more: Any) -> Belief:
    """Bodies whose level section has this exponent."""
    here = belief()
    exponents = np.array([[0.1, exponent]] * 2)
    return replace(here, body=BODY._replace(exponents=exponents), **more)


def side(flat: bool) -> SimpleNamespace:
    """A side that was crossed in both worlds, which proved flat or not."""
    normal = np.array([[1.0, 0.0, 0.0]] * 2)
    return SimpleNamespace(fit=SimpleNamespace(status=np.full(2, FitStatus.converged)),
                           normal=normal, felt_normal=normal, flat=np.full(2, flat))


def chosen(here: Belief, last: Next | None = None) -> tuple[list[bool], list[bool]]:
    faces, contour = decide(here, BY_EXPONENT, last)
    return faces.tolist(), contour.tolist()


@pytest.mark.parametrize(("exponent", "faces"), [(BLOCKY, True), (ROUND, False)])
def test_a_level_section_with_corners_has_faces_and_a_round_one_a_contour(
        exponent: float, faces: bool) -> None:
    assert chosen(with_section(exponent)) == ([faces] * 2, [not faces] * 2)


def test_without_a_body_faces_of_the_prior_are_crossed() -> None:
    here = with_section(ROUND, fitted=np.array([True, False]))
    assert chosen(here) == ([False, True], [True, False])


@pytest.mark.parametrize("exponent", [BLOCKY, ROUND])
def test_what_found_nothing_gives_way_to_the_other(exponent: float) -> None:
    """A contour that was broken off leaves no profile, a face that was missed no plane."""
    neither, both = np.zeros(2, bool), np.ones(2, bool)
    here = with_section(exponent, fitted=np.array([True, False]))
    assert chosen(here, Next(neither, both)) == ([True] * 2, [False] * 2)
    assert chosen(here, Next(both, neither)) == ([False] * 2, [True] * 2)
    assert chosen(here, Next(neither, neither)) == chosen(here)
    one = np.array([True, False])
    assert chosen(here, Next(one, ~one)) == ([False, True], [True, False])


@pytest.mark.parametrize("exponent", [BLOCKY, ROUND])
def test_what_bore_out_the_choice_is_left_at_that_and_else_the_other_is_next(
        exponent: float) -> None:
    neither, both = [False] * 2, [True] * 2
    assert chosen(with_section(exponent, faces=(side(True),))) == (neither, neither)
    assert chosen(with_section(exponent, faces=(side(False),))) == (neither, both)
    followed: Any = SimpleNamespace(volume_m3=np.ones(2))
    stands, not_so = np.full(2, Shape.REVOLUTION), np.full(2, Shape.SUPERQUADRIC)
    assert chosen(with_section(exponent, profile=followed, shape=stands)) == (neither, neither)
    assert chosen(with_section(exponent, profile=followed, shape=not_so)) == (both, neither)
    tried = with_section(exponent, profile=followed, shape=not_so, faces=(side(False),))
    assert chosen(tried) == (neither, neither)


def test_a_contour_is_about_the_line_on_which_the_body_stands() -> None:
    axis = contour_to_follow(belief(), ContourTable(), BOTH).axis
    np.testing.assert_array_equal(axis.direction, [[0.0, 0.0, 1.0]] * 2)
    np.testing.assert_allclose(axis.foot_m[:, :2], BODY.position_m[:, :2])
    np.testing.assert_allclose(axis.foot_m[:, 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(axis.length_m, 0.14, rtol=1e-6)


def turned(about: list[float], angle_rad: float) -> Belief:
    """A block of 60 x 80 x 120 mm, turned about an axis through its middle."""
    q = np.array([*(np.sin(angle_rad / 2) * np.array(about)), np.cos(angle_rad / 2)])
    return replace(with_section(BLOCKY), body=BODY._replace(
        size_m=np.array([[0.03, 0.04, 0.06]] * 2), exponents=np.full((2, 2), BLOCKY),
        quaternion_xyzw=np.tile(q, (2, 1))))


@pytest.mark.parametrize("yaw", [0.0, 0.4, -1.3, 2.5])
def test_the_top_is_crossed_first_and_then_sides_as_they_face_the_arm(yaw: float) -> None:
    found = faces_to_cross(turned([0.0, 0.0, 1.0], yaw), PlanarTable(), BOTH)
    assert found.wanted is not None
    assert found.wanted.tolist() == [[True] * 5] * 2
    np.testing.assert_allclose(found.normal[:, 0], [[0.0, 0.0, 1.0]] * 2, atol=1e-6)
    sides, places = found.normal[:, 1:5, :2], found.point_m[:, 1:5, :2]
    np.testing.assert_allclose(found.normal[:, 1:5, 2], 0.0, atol=1e-6)
    facing = (sides * -places).sum(2) / np.linalg.norm(places, axis=2)  # the arm is at the origin
    assert (np.diff(facing, axis=1) < 1e-9).all()
    few = faces_to_cross(turned([0.0, 0.0, 1.0], yaw), PlanarTable(faces=2), ~BOTH)
    np.testing.assert_array_equal(few.point_m, found.point_m[:, :2])
    assert few.wanted is not None
    assert not few.wanted.any()


@pytest.mark.parametrize(("lean_deg", "wanted"), [
    (0, True), (25, True), (34, True), (-34, True), (40, False), (-40, False)])
def test_a_top_that_leans_is_not_crossed(lean_deg: float, wanted: bool) -> None:
    """From 30 degrees on a side that points up as well was taken for it, if it faced the arm."""
    found = top_to_cross(turned([0.0, 1.0, 0.0], np.radians(lean_deg)), PlanarTable(), BOTH)
    assert found.wanted is not None
    assert found.wanted.tolist() == [[wanted]] * 2


def test_what_leans_over_the_table_is_out_of_reach() -> None:
    """By 40 degrees, one side looks down by as much, and there is no foot to cross."""
    found = faces_to_cross(turned([0.0, 1.0, 0.0], np.radians(40)), PlanarTable(), BOTH)
    assert found.wanted is not None
    assert found.wanted.sum(1).tolist() == [4, 4]
    assert found.normal[found.wanted][:, 2].min() > -1e-6


def test_a_contour_along_an_axis_that_leans_goes_from_the_table_to_the_top() -> None:
    here = turned([0.0, 1.0, 0.0], 0.3)
    axis = contour_to_follow(here, ContourTable(axis="fit"), BOTH).axis
    np.testing.assert_allclose(axis.direction, [[np.sin(0.3), 0.0, np.cos(0.3)]] * 2, atol=1e-9)
    np.testing.assert_allclose(axis.foot_m[:, 2], 0.0, atol=1e-12)
    off = np.cross(here.body.position_m - axis.foot_m, axis.direction)
    np.testing.assert_allclose(off, 0.0, atol=1e-9)  # it passes through the middle
    end = axis.foot_m + axis.length_m[:, None] * axis.direction
    top = superquadric_points(here.body, 600)[..., 2].max(1)
    np.testing.assert_allclose(end[:, 2], top, rtol=1e-3)


def test_a_wrong_axis_is_off_by_its_error_towards_an_azimuth_of_its_own() -> None:
    seeds = np.array([3, 4], np.uint64)
    wrong = contour_to_follow(replace(belief(), seed=seeds), ContourTable(axis_error_rad=0.2), BOTH)
    way = wrong.axis.direction
    np.testing.assert_allclose(np.arccos(way[:, 2]), 0.2)
    azimuth = np.arctan2(way[:, 1], way[:, 0])
    assert abs(azimuth[0] - azimuth[1]) > 0.01
    again = contour_to_follow(replace(belief(), seed=seeds[::-1]), ContourTable(axis_error_rad=0.2),
                              BOTH)
    np.testing.assert_array_equal(again.axis.direction, way[::-1])
