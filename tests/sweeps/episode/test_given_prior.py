"""The prior that a strategy is given, against what the bodies measure."""

from pathlib import Path

import numpy as np
import pytest

from fit.superquadric.geometry import superquadric
from strategies.poses.hand_poses import waypoint_poses
from strategies.poses.waypoints import BoundingBox, BoundingCylinder, Ring
from strategies.ready_made import STRATEGIES
from strategies.recovery.plausibility import plausible
from strategies.strategy import Strategy
from sweeps.episode.episodes import place_objects, run_episodes
from sweeps.episode.given_prior import draw_prior, seen_prior
from sweeps.spec.cell import Cell
from warpgrasp.core.random import counter_key
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.parameters import ArmTable, HandTable, ObjectTable, SensorTable, StereoTable
from warpgrasp.robot import Robot, Truth

KEY = counter_key(3, np.arange(5))


def placed(body: object, **words: object) -> tuple[np.ndarray, ObjectTable]:
    table = ObjectTable(**words)  # type: ignore[arg-type]
    return place_objects(table, KEY), table


def reaches(points_m: np.ndarray, pose: np.ndarray, box: BoundingBox) -> np.ndarray:
    """How far points of a body, (point, 2), reach to the four sides of each world's box, and where
    these are, (world, side, 2) [m]."""
    found = []
    for world in range(len(pose)):
        yaw = 2 * np.arctan2(pose[world, 5], pose[world, 6])
        turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        seen = points_m @ turn.T + pose[world, :2] - [box.x_m[world], box.y_m[world]]
        for angle, half in zip(box.yaw_rad[world] + np.array([0.0, np.pi / 2]),
                               box.half_m[world], strict=True):
            along = seen @ [np.cos(angle), np.sin(angle)]
            found += [(along.max(), half), (-along.min(), half)]
    return np.array(found).reshape(len(pose), 4, 2)


@pytest.mark.parametrize("name", ["block", "wedge", "wine_bottle", "funnel"])
def test_a_box_without_errors_holds_the_body_and_touches_its_sides(name: str) -> None:
    body = body_from_name(name)
    pose, table = placed(body, prior="box", prior_sigma_m=0.0)
    box = draw_prior(body, pose, table, KEY)
    assert isinstance(box, BoundingBox)
    points = sample_body(body, surface=None).surface_m[:, :2]
    # Of all of these the narrowest rectangle is that of their box.
    true = np.sort(0.5 * np.subtract(body.high_m, body.low_m)[:2])
    assert np.abs(np.sort(box.half_m) - true).max() < 6e-6
    far, half = np.moveaxis(reaches(points, pose, box), -1, 0)
    assert (half - 2e-4 < far).all()
    assert (far < half + 6e-6).all()
    assert np.allclose(box.half_width(box.yaw_rad[:, None])[:, 0], box.half_m[:, 0])


def test_a_box_about_what_stands_askew_in_its_frame_touches_its_corners() -> None:
    """Three posts, whose narrowest rectangle has its middle beside that of their frame."""
    middles = np.array([[0, 0], [60, 50], [25, 45]])
    body = body_from_table({"name": "posts", "compound": [
        {"shape": "block", "size_mm": [20, 20, 80], "at_mm": [int(x), int(y), 0]}
        for x, y in middles]}, Path())
    pose, table = placed(body, prior="box", prior_sigma_m=0.0)
    box = draw_prior(body, pose, table, KEY)
    assert isinstance(box, BoundingBox)
    corners = (middles[:, None] + 10 * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])) / 1e3
    own = corners.reshape(-1, 2) - (corners.max((0, 1)) + corners.min((0, 1))) / 2
    far, half = np.moveaxis(reaches(own, pose, box), -1, 0)
    assert far == pytest.approx(half, abs=6e-6)
    assert np.abs([box.x_m - pose[:, 0], box.y_m - pose[:, 1]]).max() > 0.001


@pytest.mark.parametrize("prior", ["cylinder", "box"])
def test_each_number_of_a_prior_has_a_normal_error_of_its_own(prior: str) -> None:
    """A box is turned by as much as moves the middle of its shorter sides by that."""
    key = counter_key(6, np.arange(4000))
    body, pose = body_from_name("block"), place_objects(ObjectTable(), key)
    given, true = (draw_prior(body, pose, ObjectTable(prior=prior, prior_sigma_m=sigma_m), key)
                   for sigma_m in (0.002, 0.0))
    errors = [given.x_m - true.x_m, given.y_m - true.y_m, given.height_m - true.height_m]
    if isinstance(given, BoundingBox) and isinstance(true, BoundingBox):
        turned = given.yaw_rad - true.yaw_rad
        errors += [*(given.half_m - true.half_m).T, turned * given.half_m.max(axis=1)]
    else:
        errors.append(given.radius_m - true.radius_m)
    assert np.cov(errors) / 0.002**2 == pytest.approx(np.eye(len(errors)), abs=0.08)
    assert given.margin_m >= 3.0 * 0.002


def test_the_cylinder_about_a_wedge_reaches_to_its_corners() -> None:
    """A wedge is 60 mm long and wide: its corners lie 42.4 mm from its axis. No sample lies there.
    """
    body = body_from_name("wedge")
    pose, table = placed(body, prior_sigma_m=0.0)
    assert draw_prior(body, pose, table, KEY).radius_m == pytest.approx(0.03 * 2**0.5, abs=5e-6)


def test_a_ring_of_four_about_a_box_faces_its_four_sides() -> None:
    body = body_from_name("block")
    pose, table = placed(body, prior="box", prior_sigma_m=0.0)
    box = draw_prior(body, pose, table, KEY)
    assert isinstance(box, BoundingBox)
    hands = waypoint_poses([Ring(count=4)], box, HandTable(), KEY)
    away = hands[..., :2] - np.stack([box.x_m, box.y_m], 1)[:, None]
    turned = np.arctan2(away[..., 1], away[..., 0]) - box.yaw_rad[:, None]
    assert np.abs(np.sin(2 * turned)).max() < 1e-6
    near = np.hypot(*np.moveaxis(hands[..., :2], -1, 0))  # the first is the one at the base
    assert (near.argmin(1) == 0).all()


def seen_of(name: str, **words: float) -> tuple[BoundingCylinder, np.ndarray, np.ndarray]:
    body = body_from_name(name)
    pose, table = placed(body)
    robot = Robot([body], np.zeros(len(KEY), int), Truth(pose), KEY, ArmTable(), HandTable(),
                  SensorTable())
    drawn = draw_prior(body, pose, table, KEY)
    prior, why = seen_prior(robot, drawn, StereoTable(**words), "silhouettes")  # type: ignore
    return prior, why, pose


@pytest.mark.parametrize("prior", ["cylinder", "box"])
@pytest.mark.parametrize("sigma_mm", [10.0, 40.0, 80.0])
def test_the_true_body_agrees_with_its_prior_however_rough(prior: str, sigma_mm: float) -> None:
    key = counter_key(4, np.arange(400))
    table = ObjectTable(prior=prior, prior_sigma_m=1e-3 * sigma_mm)
    body, pose = body_from_name("block"), place_objects(table, key)
    half = 0.5 * np.asarray(body.parts[0].size_m)
    true = superquadric(half, (0.1, 0.1), pose[:, :3] + [0.0, 0.0, half[2]], pose[:, 3:])
    # Four standard deviations for centre and radius together; a radius has a least one, too.
    assert plausible(true, draw_prior(body, pose, table, key)).mean() > 0.995


@pytest.mark.parametrize("name", ["large_cylinder", "wine_bottle"])
def test_cameras_see_the_cylinder_that_is_there(name: str) -> None:
    body = body_from_name(name)
    surface = sample_body(body).surface_m
    radius = float(np.hypot(surface[:, 0], surface[:, 1]).max())
    prior, why, pose = seen_of(name, pixel_noise=0.0)
    assert not why.any()
    # A pixel is 1.7 mm: half of one more on either side would be too wide by 0.8 mm.
    assert np.abs(prior.radius_m - radius).max() < 0.0006
    assert np.abs(prior.height_m - body.high_m[2]).max() < 0.012
    assert np.hypot(prior.x_m - pose[:, 0], prior.y_m - pose[:, 1]).max() < 0.005


def test_an_object_that_is_not_whole_in_the_images_is_told() -> None:
    prior, why, _ = seen_of("wine_bottle", field_of_view_rad=0.1)
    assert all("not seen whole in both images" in text for text in why)
    assert np.isfinite(prior.radius_m).all()


NOTHING = Strategy("nothing", (Ring(  # beyond the object, out of the arm's reach
    count=1, palm_clearance_m=0.3, clearance_per_radius=5.0, azimuth_rad=np.pi,
    tilt_rad=np.pi / 2),))


@pytest.mark.parametrize("words", [
    pytest.param({}, marks=pytest.mark.slow), {"prior": "box", "prior_sigma_m": 0.0}])
def test_rows_hold_what_an_episode_without_a_touch_scores(words: dict) -> None:
    """The same for every strategy, to the last digit."""
    cells = [Cell(strategy, {"name": "block"}, "block", seed=5, placement=ObjectTable(**words))
             for strategy in (NOTHING, STRATEGIES["ring6"])]
    idle, active = (run_episodes(cell, np.arange(4), "cpu") for cell in cells)
    assert (idle["touches"] == 0).all()
    ok = active["status"] == "ok"
    assert ok.any()
    assert (active["chamfer_mm"] != active["prior_chamfer_mm"])[ok].all()
    for name in ("chamfer_mm", "normalized_chamfer", "hausdorff95_mm", "iou", "volume_ratio",
                 "coverage5mm"):
        assert np.array_equal(idle[name], idle[f"prior_{name}"])
        assert np.array_equal(idle[f"prior_{name}"], active[f"prior_{name}"])
        assert np.array_equal(active[name][~ok], active[f"prior_{name}"][~ok])
    assert (idle["worse_than_prior"] == "").all()
    assert (idle["normalized_chamfer"] == 1.0).all()
    for row, words_of_row in enumerate(active["worse_than_prior"]):
        assert set(words_of_row.split()) == {
            name for name, sign in (("chamfer_mm", 1), ("iou", -1))
            if sign * active[name][row] > sign * active[f"prior_{name}"][row]}
    if words:  # the narrowest box about a block is the block, but for the edges that are round
        assert (idle["iou"] > 0.97).all()
        assert (idle["chamfer_mm"] < 0.6).all()
        assert (active["worse_than_prior"][ok] == "chamfer_mm iou").all()
