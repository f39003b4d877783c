"""The contour follower: what it must recover from bottles and bulb, and that it always ends."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from strategies.procedures.contour_follower import explore_contour, section_circle
from strategies.procedures.contour_record import Axis, ContourOptions
from strategies.procedures.contour_shape import match_profiles, profile_of, radius_at
from strategies.procedures.planar_record import PlanarOptions
from strategies.procedures.touches import REASON_TEXT, EndReason, true_touches
from warpgrasp.geometry.body import Body
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.parameters import ArmTable, ErrorTable, HandTable, PadTable, SensorTable
from warpgrasp.robot import Robot, Truth

WORLDS = 20
BOTTLES = ("wine_bottle", "beer_bottle", "coke_bottle", "orangina_bottle")
CONTOURS = {name: body_from_name(name).parts[0].profile_m for name in (*BOTTLES, "lightbulb")}

CALIBRATED = replace(ErrorTable.none(), mount_m=5e-4, mount_rad=float(np.radians(0.2)))

def set_up(name: str, worlds: int = WORLDS, pads: PadTable | None = None,
           errors: ErrorTable = CALIBRATED):
    """Robots calibrated but for their mounts, unless `errors` are given."""
    return before(body_from_name(name), worlds, pads, errors)


def before(body: Body, worlds: int, pads: PadTable | None = None, errors: ErrorTable = CALIBRATED):
    """Robots before a body."""
    pose = np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (worlds, 1))
    truth = Truth(pose)
    key = np.arange(worlds).astype(np.uint64) + np.uint64(17)
    return Robot([body], np.zeros(1, int), truth, key, ArmTable(), HandTable(),
                 SensorTable(), pads=pads, errors=errors), truth


def told_axis(name: str, worlds: int = WORLDS, sigma: float = 0.008, seed: int = 2) -> Axis:
    """What a fitted body or a person would say: place and size with an error."""
    error = np.random.default_rng(seed).normal(0.0, sigma, (worlds, 4))
    contour = CONTOURS[name]
    return Axis.upright(0.45 + error[:, 0], error[:, 1], contour[-1, 0] + error[:, 2],
                        contour[:, 1].max() + error[:, 3])


def true_volume(contour: np.ndarray) -> float:
    z, r = contour.T
    return float(np.pi / 3 * (np.diff(z) * (r[:-1]**2 + r[:-1] * r[1:] + r[1:]**2)).sum())


@pytest.fixture(scope="module")
def followed():
    found = {}
    for name in (*BOTTLES, "lightbulb"):
        robot, truth = set_up(name)
        exploration = explore_contour(robot, told_axis(name))
        found[name] = (truth, exploration, profile_of(exploration))
    return found


def test_every_episode_ends_with_a_named_reason(followed) -> None:
    for _, exploration, _ in followed.values():
        assert not (exploration.reason == EndReason.GOING_ON).any()
        assert (exploration.reason == EndReason.END_OF_OBJECT).mean() >= 0.85


@pytest.mark.parametrize("name", [*BOTTLES, "lightbulb"])
def test_radius_and_volume(followed, name: str) -> None:
    _, exploration, profile = followed[name]
    ended = exploration.reason == EndReason.END_OF_OBJECT
    contour = CONTOURS[name]
    grid = np.arange(0.004, contour[-1, 0] - 0.004, 0.002)
    error = np.abs(radius_at(profile, grid)[ended] - np.interp(grid, *contour.T))
    assert np.median(error) <= 0.0015
    ratio = profile.volume_m3[ended] / true_volume(contour)
    assert abs(np.median(ratio) - 1.0) <= 0.05
    assert (np.abs(ratio - 1.0) <= 0.10).mean() >= 0.9
    assert np.abs(np.median(profile.length_m[ended]) - contour[-1, 0]) < 0.004


def test_errors_of_calibration_cost_a_millimetre() -> None:
    """With all of them at their defaults: estimates of robots that nobody has calibrated anew."""
    robot, _ = set_up("wine_bottle", errors=ErrorTable())
    exploration = explore_contour(robot, told_axis("wine_bottle"))
    ended = exploration.reason == EndReason.END_OF_OBJECT
    contour = CONTOURS["wine_bottle"]
    grid = np.arange(0.004, contour[-1, 0] - 0.004, 0.002)
    error = np.abs(radius_at(profile_of(exploration), grid)[ended] - np.interp(grid, *contour.T))
    assert ended.mean() >= 0.8
    assert 0.0003 < np.median(error) <= 0.0025


@pytest.mark.parametrize("height_m", [0.035, 0.055, 0.090])
def test_a_short_cylinder_keeps_its_axis_and_its_radius(height_m: float) -> None:
    """Nine to nineteen touches alone tell neither how the axis leans nor where it goes."""
    body = body_from_table({"name": "short", "compound": [
        {"shape": "cylinder", "radius_mm": 30, "height_mm": 1e3 * height_m}]}, Path())
    robot, _ = before(body, WORLDS)
    one = np.ones(WORLDS)
    profile = profile_of(explore_contour(
        robot, Axis.upright(0.45 * one, 0.0 * one, height_m * one, 0.03 * one)))
    volume = np.pi * 0.03**2 * height_m
    assert np.abs(profile.volume_m3 / volume - 1.0).max() < 0.10
    assert np.degrees(np.arccos(profile.axis[:, 2])).max() < 10


def test_a_leaning_cylinder_ends_where_its_rim_stands_on_the_table() -> None:
    """Not where its axis would meet the table, which is farther down by r tan(lean)."""
    radius, height, lean = 0.025, 0.12, np.radians(15)
    body = body_from_table({"name": "leaning", "compound": [
        {"shape": "cylinder", "radius_mm": 25, "height_mm": 120, "rpy_deg": [0, 15, 0]}]}, Path())
    robot, truth = before(body, 4)
    way = np.array([np.sin(lean), 0.0, np.cos(lean)])
    foot = truth.body_pose[:, :3] + np.array(body.parts[0].place[:3])
    ones = np.ones(len(foot))
    profile = profile_of(explore_contour(
        robot, Axis(foot, np.tile(way, (4, 1)), height * ones, radius * ones)))
    volume = np.pi * radius**2 * height
    assert np.abs(profile.volume_m3 / volume - 1.0).max() < 0.03
    assert np.abs(profile.length_m - height).max() < 0.003
    assert np.abs(profile.foot_m - foot).max() < 0.003


@pytest.mark.parametrize("lean_deg", [-20, 20])
def test_a_body_that_leans_sideways_is_followed_to_its_end(lean_deg: float) -> None:
    """The hand leans with it, and one of its open fingers comes nearer to the table."""
    body = body_from_table({"name": "leaning", "compound": [{
        "shape": "cylinder", "radius_mm": 25, "height_mm": 120, "rpy_deg": [lean_deg, 0, 0]}]},
        Path())
    robot, truth = before(body, 2)
    way = np.tile(Rotation.from_rotvec([np.radians(lean_deg), 0, 0]).apply([0, 0, 1]), (2, 1))
    foot, ones = truth.body_pose[:, :3] + np.array(body.parts[0].place[:3]), np.ones(2)
    found = explore_contour(robot, Axis(foot, way, 0.12 * ones, 0.025 * ones))
    assert list(found.reason) == [EndReason.END_OF_OBJECT] * 2


def test_touches_of_the_table_are_none_of_the_body() -> None:
    """A hand that is to go lower than it can comes down to the table."""
    robot, _ = set_up("lightbulb")
    azimuth = np.linspace(0, 2 * np.pi, WORLDS, endpoint=False)
    leaning = told_axis("lightbulb", sigma=0.004).turned(np.full(WORLDS, np.radians(8)), azimuth)
    found = explore_contour(robot, leaning, options=ContourOptions(table_clear_m=-0.01))
    low = np.nan_to_num(found.touches.point_m[:, 2], nan=1.0) < 0.003
    assert low.any()
    radius = CONTOURS["lightbulb"][:, 1].max()
    assert np.nanmax(profile_of(found).largest_radius_m) < 1.15 * radius


def test_fine_steps_go_as_far_as_coarse_ones() -> None:
    robot, _ = set_up("lightbulb", 2)
    axis = told_axis("lightbulb", 2, sigma=0.0)
    found = explore_contour(robot, axis, options=ContourOptions(step_m=0.001))
    assert not (found.reason == EndReason.SPENT).any()
    assert (found.found_m > 0.9 * axis.length_m).all()


def test_bottles_are_told_apart_from_their_profiles_alone(followed) -> None:
    right = [np.asarray(match_profiles(followed[name][2], {n: CONTOURS[n] for n in BOTTLES}))[
        followed[name][1].reason == EndReason.END_OF_OBJECT] == name for name in BOTTLES]
    assert np.concatenate(right).mean() >= 0.95


def test_believed_and_true_touches_are_apart_but_near(followed) -> None:
    truth, exploration, _ = followed["wine_bottle"]
    point, normal = true_touches(exploration.touches, truth)
    error = np.linalg.norm(exploration.touches.point_m - point, axis=1)
    assert 1e-5 < np.nanmedian(error) < 0.002
    radius = np.hypot(point[:, 0] - 0.45, point[:, 1])
    seen = np.isfinite(radius)
    # The centre of force is brought to the surface along the gradient at it: to 0.1 mm.
    expected = np.interp(point[seen, 2], *CONTOURS["wine_bottle"].T)
    assert np.quantile(np.abs(radius[seen] - expected), 0.98) < 2e-4
    np.testing.assert_allclose(np.linalg.norm(normal[seen], axis=1), 1.0, atol=1e-6)


def test_a_wrong_axis_costs_accuracy_unless_it_is_refined() -> None:
    name = "coke_bottle"
    robot, _ = set_up(name)
    azimuth = np.linspace(0, 2 * np.pi, WORLDS, endpoint=False)
    wrong = told_axis(name, sigma=0.004).turned(np.full(WORLDS, np.radians(5)), azimuth)
    exploration = explore_contour(robot, wrong)
    ended = exploration.reason == EndReason.END_OF_OBJECT
    assert ended.mean() > 0.8
    contour = CONTOURS[name]
    grid = np.arange(0.004, contour[-1, 0] - 0.004, 0.002)
    truth = np.interp(grid, *contour.T)
    refined, kept = profile_of(exploration), profile_of(exploration, refine=False)
    errors = [np.median(np.abs(radius_at(p, grid)[ended] - truth)) for p in (refined, kept)]
    assert errors[0] <= 0.0015
    assert errors[1] > 1.3 * errors[0]
    assert np.median(kept.rms_m[ended]) > 2.0 * np.median(refined.rms_m[ended])


@pytest.mark.parametrize("wrong", [1e300, np.inf, 1e-12])
def test_an_axis_of_no_length_is_a_bad_start(wrong: float) -> None:
    robot, _ = set_up("beer_bottle", 2)
    a = told_axis("beer_bottle", 2, sigma=0.0)
    e = explore_contour(robot, Axis(a.foot_m, np.full((2, 3), wrong), a.length_m, a.radius_m))
    assert list(e.reason) == [EndReason.BAD_START] * 2
    with pytest.raises(ValueError, match=r"wanted: .* \(world 2,\)"):
        explore_contour(robot, a, wanted=np.ones(3, bool))


@pytest.mark.parametrize(("kind", "wrong"), [
    (PlanarOptions, {"most_steps": "a"}), (PlanarOptions, {"most_steps": 1.5}),
    (PlanarOptions, {"most_blocked": 0}), (PlanarOptions, {"clear_m": np.nan}),
    (PlanarOptions, {"step_m": "6 mm"}), (ContourOptions, {"table_clear_m": np.inf}),
    (ContourOptions, {"swing_rad": np.nan}), (ContourOptions, {"most_sections": 0}),
    (ContourOptions, {"most_blocked": None}), (ContourOptions, {"beyond_m": (0.005,)}),
    (ContourOptions, {"sidesteps_m": ()}), (ContourOptions, {"sidesteps_m": (0.0, np.nan)}),
])
def test_options_of_procedures_are_numbers_that_can_be_gone_by(kind: type, wrong: dict) -> None:
    """A planner's ended all episodes that ran with it, instead of being its fault."""
    with pytest.raises(ValueError, match=rf"{next(iter(wrong))}\b.*, should be|; should be from"):
        kind(**wrong)


def test_an_axis_that_misses_and_other_bad_input() -> None:
    name = "beer_bottle"
    robot, _ = set_up(name, 6)
    a = told_axis(name, 6, sigma=0.0)
    foot, way, radius = a.foot_m.copy(), a.direction.copy(), a.radius_m.copy()
    foot[1] += [0.0, 0.20, 0.0]  # misses
    foot[2] = np.nan
    way[3] = 0.0
    way[4] = [1.0, 0.0, 0.0]  # lying
    foot[5] += [2.0, 0.0, 0.0]
    e = explore_contour(robot, Axis(foot, way, a.length_m, radius))
    assert list(e.reason) == [EndReason.END_OF_OBJECT, EndReason.NO_CONTACT, EndReason.BAD_START,
                              EndReason.BAD_START, EndReason.UNREACHABLE, EndReason.UNREACHABLE]
    assert all(REASON_TEXT[EndReason(r)] for r in e.reason)
    profile = profile_of(e)
    assert np.isfinite(profile.volume_m3[0])
    assert np.isnan(profile.volume_m3[1:]).all()
    assert np.isfinite(profile.axis).all()
    names = match_profiles(profile, CONTOURS)
    assert names[0] == name
    assert set(names[1:]) == {""}


def test_a_contour_hangs_on_no_other_world_and_is_nan_where_nothing_was_felt(followed) -> None:
    _, exploration, profile = followed["wine_bottle"]
    kept = exploration.touches.world != 0
    table = type(exploration.touches)(*(
        getattr(exploration.touches, f.name)[kept] for f in fields(exploration.touches)))
    part = profile_of(replace(exploration, touches=table))
    assert np.isfinite(profile.volume_m3[0])
    assert np.isnan(part.volume_m3[0])
    np.testing.assert_allclose(part.foot_m[0], exploration.axis.foot_m[0], atol=1e-12)
    for name in ("foot_m", "axis", "height_m", "radius_m", "volume_m3"):
        np.testing.assert_array_equal(getattr(part, name)[1:], getattr(profile, name)[1:])
    assert np.isnan(part.height_m[0]).all()
    assert np.isnan(part.radius_m[0]).all()


def test_dead_pads_block_and_say_so() -> None:
    robot, _ = set_up("beer_bottle", 3, pads=replace(PadTable(), dead_fraction=1.0))
    e = explore_contour(robot, told_axis("beer_bottle", 3, sigma=0.0))
    assert (e.reason == EndReason.BLOCKED).all()
    assert (e.rejected > 0).all()


def test_dead_pads_are_told_where_the_start_is_off_the_object_too() -> None:
    """Fingers strike it in some sections and pass it in others."""
    robot, _ = set_up("small_cylinder", 4, pads=replace(PadTable(), dead_fraction=1.0))
    turn, one = np.arange(4), np.ones(4)
    e = explore_contour(robot, Axis.upright(
        0.45 + 0.02 * np.cos(turn), 0.03 * np.sin(1 + turn), 0.1 * one, 0.04 * one))
    assert (e.rejected > 0).all()
    assert (e.reason == EndReason.BLOCKED).all()


def test_an_eccentric_start_is_steered_back() -> None:
    robot, _ = set_up("beer_bottle", 8)
    azimuth = np.arange(8) * np.pi / 4
    a = told_axis("beer_bottle", 8, sigma=0.0)
    foot = a.foot_m + 0.010 * np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], 1)
    e = explore_contour(robot, Axis(foot, a.direction, a.length_m, a.radius_m))
    assert (e.reason == EndReason.END_OF_OBJECT).all()
    profile = profile_of(e)
    assert np.abs(profile.largest_radius_m - 0.0305).max() < 0.0015


def test_sections_are_bounded() -> None:
    robot, _ = set_up("wine_bottle", 2)
    e = explore_contour(robot, told_axis("wine_bottle", 2, sigma=0.0),
                        options=ContourOptions(most_sections=3))
    assert (e.reason == EndReason.SPENT).all()
    assert e.touches.part.max() == 2


@settings(max_examples=50)
@given(st.floats(0.005, 0.08), st.floats(-3, 3), st.floats(0.6, 3.0), st.integers(0, 10**6))
def test_section_circle_of_exact_touches(radius, first, apart, seed) -> None:
    turn = Rotation.random(rng=seed)
    angles = np.array([first, first + apart])
    level = np.stack([np.cos(angles), np.sin(angles), [0.0, 0.0]], 1)
    normals = turn.apply(level + np.array([0.0, 0.0, 0.3]))  # a cone's
    centre = np.array([0.3, -0.2, 0.1])
    points = centre + radius * turn.apply(level)
    along = turn.apply([0.0, 0.0, 1.0])[None]
    found, size = section_circle(points[:1], normals[:1], points[1:], normals[1:], along)
    np.testing.assert_allclose(found[0], centre, atol=1e-9)
    assert size[0] == pytest.approx(radius, rel=1e-6)
