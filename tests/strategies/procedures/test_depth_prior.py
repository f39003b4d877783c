"""Boxes by what is seen from one side, and what a view says of a grid's cells."""

import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fit.arrays import rows_of
from strategies.foresight.occupancy import begin_occupancy
from strategies.poses.waypoints import BoundingBox
from strategies.procedures.depth_prior import (
    CLEARED,
    ON_SURFACE,
    SeenBox,
    _unseen_top,
    believed_after,
    or_drawn,
    see_box,
)
from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.objects.families import family_table
from warpgrasp.parameters import ArmTable, HandTable, SensorTable, StereoTable
from warpgrasp.robot import Robot, Truth
from warpgrasp.sight.depth_view import DepthView

WORLDS = 5
YAW = np.linspace(0.0, 2.5, WORLDS)
EXACT = StereoTable(pixel_noise=0.0, missing_depth=0.0)
RADIUS_M = 0.008


def body_of(name: str) -> Body:
    table = family_table(name)
    return body_from_table(table, Path()) if table else body_from_name(name)


def seen(name: str, table: StereoTable) -> tuple[SeenBox, np.ndarray, np.ndarray]:
    """The boxes, which are whole, and the true poses."""
    pose = np.zeros((WORLDS, 7))
    pose[:, 0], pose[:, 5], pose[:, 6] = 0.45, np.sin(YAW / 2), np.cos(YAW / 2)
    body = body_of(name)
    robot = Robot([body], np.zeros(1, int), Truth(pose), np.arange(WORLDS).astype(
        np.uint64), ArmTable(), HandTable(), SensorTable())
    return *see_box(robot, np.tile([0.45, 0.0, body.high_m[2] / 2], (WORLDS, 1)), table), pose


def test_what_is_round_has_its_own_box() -> None:
    box, whole, _ = seen("large_cylinder", EXACT)
    assert whole.all()
    assert np.abs(box.half_m - 0.035).max() < 0.004  # a matched pixel is 7 mm
    assert np.abs(np.stack([box.x_m - 0.45, box.y_m])).max() < 0.006
    assert np.abs(box.height_m - 0.120).max() < 0.004


OBJECTS = ("block", "large_cylinder", "small_cylinder", "funnel", "wine_bottle", "coke_bottle")


def heights_off(elevation_rad: float) -> np.ndarray:
    """By how much boxes about each of `OBJECTS` are too high [m]."""
    boxes = [seen(name, replace(EXACT, elevation_rad=elevation_rad))[0] for name in OBJECTS]
    return np.array([box.height_m.mean() - body_of(name).high_m[2]
                     for box, name in zip(boxes, OBJECTS, strict=True)])


@pytest.mark.parametrize("elevation_rad", [0.26, 0.6])
def test_of_an_object_whose_top_is_seen_nothing_is_added_to_its_height(
        elevation_rad: float) -> None:
    """A matched pixel is 7 mm: half of one more would be 3.5 mm too high."""
    off = heights_off(elevation_rad)
    assert np.abs(off).max() < 0.002
    assert abs(off.mean()) < 0.0015


def test_from_beside_half_a_pixel_is_added() -> None:
    """There the upper edge lies between two rows: boxes without would be 2.5 mm too low in the
    mean. Edges that slant in the image cross rows, and the highest pixel lies nearer to them."""
    off = [heights_off(elevation) for elevation in np.linspace(-0.15, -0.03, 8)]
    assert -0.001 < np.mean(off) < 0.002


@pytest.mark.parametrize("words", [{"missing_depth": 0.95}, {"pixels": 16}])
def test_of_what_is_hardly_seen_nothing_is_said(words: dict) -> None:
    """Not on stderr either: a median of no depth at all warns."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        box, whole, _ = seen("small_cylinder", replace(EXACT, **words))
    assert not whole.any()
    assert np.isfinite(box.half_m).all()
    assert np.isfinite(box.height_m).all()


@pytest.mark.parametrize(("name", "table", "share"), [
    ("mug-1", EXACT, 0.05), ("hammer-1", EXACT, 0.2), ("mug-1", StereoTable(), 0.0),
    ("wine_bottle", StereoTable(), 0.0)])
def test_no_cell_within_the_object_is_cleared(name: str, table: StereoTable, share: float) -> None:
    """Against the true distances: balls that reach into the object, however deep, keep their
    probability; of those that were likely without the view a share loses it, the less the more of
    the image is missing."""
    box, whole, pose = seen(name, table)
    assert whole.all()
    grid = begin_occupancy(replace(box, view=replace(
        box.view, depth_m=np.full_like(box.view.depth_m, np.nan))), RADIUS_M)
    cells = np.indices((40, 40, 28)).reshape(3, -1).T + 0.5
    middle = grid.corner_m[:, None] + cells * grid.cell_m[:, None, None]
    before = grid.hit.astype(float)
    after = believed_after(box.view, before, middle, RADIUS_M)
    scene = scene_of([body_of(name)], "cpu")
    for w in range(WORLDS):
        cos, sin = np.cos(YAW[w]), np.sin(YAW[w])
        own = (middle[w] - pose[w, :3]) @ np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
        distance = distance_to_bodies(scene, np.zeros(1, int), own[None])[0][0]
        within = distance < RADIUS_M - 0.004  # depths are wrong by 1.3 mm, pixels 7 mm wide
        assert (after[w] >= before[w])[within].all()
        cleared = (after[w] <= CLEARED) & (before[w] > CLEARED)
        assert cleared.sum() >= share * (before[w] > CLEARED).sum()
        near = after[w] >= ON_SURFACE
        assert near.sum() > 30
        assert np.quantile(np.abs(distance[near]), 0.9) < 0.016


def test_a_view_of_nothing_changes_nothing() -> None:
    box, _, _ = seen("block", replace(EXACT, missing_depth=0.0))
    blind = replace(box.view, depth_m=np.full_like(box.view.depth_m, np.nan))
    middle = np.random.default_rng(0).uniform(0.3, 0.6, (WORLDS, 50, 3))
    believed = np.full((WORLDS, 50), 0.4)
    assert (believed_after(blind, believed, middle, RADIUS_M) == believed).all()


def test_beside_a_ball_at_the_camera_nothing_is_cleared() -> None:
    """It may hide all of the image, however many pixels it is wide."""
    box, _, _ = seen("block", EXACT)
    view = replace(box.view, depth_m=np.full_like(box.view.depth_m, 10.0))
    ahead = (view.centre_m + 0.5 * view.axes[:, :, 2])[:, None]
    both = np.concatenate([ahead, view.centre_m[:, None]], 1)
    believed = np.full((WORLDS, 2), 0.4)
    assert (believed_after(view, believed[:, :1], ahead, RADIUS_M) <= CLEARED).all()
    for factor in (1.0, 1e8):
        near = replace(view, focal_pixels=factor * view.focal_pixels)
        assert (believed_after(near, believed, both, RADIUS_M) == believed).all()


def test_where_nothing_is_seen_the_drawn_box_stands() -> None:
    box, whole, _ = seen("wine_bottle", StereoTable(field_of_view_rad=0.1))
    assert not whole.any()
    drawn = BoundingBox(*(np.full(WORLDS, v) for v in (0.4, 0.1, 0.05, 0.2)),
                        np.full((WORLDS, 2), 0.03), np.zeros(WORLDS))
    given = rows_of(or_drawn(box, whole, drawn), np.arange(2))
    assert (given.x_m == 0.4).all()
    assert (given.half_m == 0.03).all()
    assert np.isnan(given.view.depth_m).all()
    assert np.isfinite(begin_occupancy(given, RADIUS_M).hit).all()


@pytest.mark.parametrize("share", [0.0, 0.25, 0.5, 0.8, 1.0, 1.7])
def test_what_is_added_to_a_height_is_what_rows_miss_in_the_mean(share: float) -> None:
    """A top as high in the image as a `share` of a row, and rows anywhere: where none meets it,
    the highest row on the face below it is so far from the edge."""
    pixel, wide, focal = 0.007, 0.063, 100.0
    row = np.random.default_rng(3).uniform(0.0, 1.0, 200_000)  # the lowest above the face's edge
    missed = np.where(row < share, 0.0, 1.0 - row).mean()
    above = share * pixel / (wide + pixel) * pixel * focal
    view = DepthView(np.array([[-0.5, 0.0, 0.1 + above]]), np.eye(3)[None], np.array([focal]),
                     np.zeros((1, 2, 2)))
    points = np.array([[[-wide / 2, 0.0, 0.1], [wide / 2, 0.0, 0.1], [0.2, 0.0, 0.05]]])
    added = _unseen_top(view, points, np.array([0.1]), np.array([pixel]))
    assert added[0] == pytest.approx(missed * pixel, abs=2e-5)
