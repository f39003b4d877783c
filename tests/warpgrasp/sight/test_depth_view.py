"""Depth images: against lines cut with solids by hand, and their errors as asked for."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from warpgrasp.core.kernel_launch import ShapeError
from warpgrasp.core.random import counter_key
from warpgrasp.geometry.body import distance_to_bodies, scene_of
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.parameters import StereoTable
from warpgrasp.sight.depth_view import MATCHED, PATCH, DepthView, seen_depths
from warpgrasp.sight.silhouette import depths, silhouettes, stereo_cameras

WORLDS = 6
POSE = np.tile([0.45, 0.0, 0, 0, 0, 0, 1.0], (WORLDS, 1))
EXACT = StereoTable(pixel_noise=0.0, missing_depth=0.0)


def seen(name: str, table: StereoTable) -> DepthView:
    cameras = stereo_cameras(table, np.tile([0.45, 0.0, 0.06], (WORLDS, 1)))
    return seen_depths(scene_of([body_from_name(name)], "cpu"), np.zeros(1, int), POSE, cameras,
                       table, counter_key(4, np.arange(WORLDS)))


@pytest.mark.parametrize("name", ["block", "wine_bottle"])
def test_points_lie_on_the_side_that_faces_the_camera(name: str) -> None:
    view = seen(name, EXACT)
    points = view.points()[0]
    found = np.isfinite(points).all(1)
    assert found.sum() > 200
    scene = scene_of([body_from_name(name)], "cpu")
    distance, slope = distance_to_bodies(scene, np.zeros(1, int),
                                         (points[found] - POSE[0, :3])[None])
    assert np.abs(distance).max() < 3e-4
    towards = view.centre_m[0] - points[found]
    facing = (towards / np.linalg.norm(towards, axis=1, keepdims=True) * slope[0]).sum(1)
    assert facing.min() > -0.05


def test_points_of_a_pointed_body_lie_on_it() -> None:
    """Its distance to first order is too long far away: rays step into the body and back."""
    body = body_from_table({"name": "cone", "superquadric": {
        "size_mm": [40, 40, 60], "exponents": [1.0, 1.0], "taper": [-0.9, -0.9]}}, Path())
    scene = scene_of([body], "cpu")
    cameras = stereo_cameras(EXACT, np.array([[0.45, 0.0, 0.06]]))
    points = seen_depths(scene, np.zeros(1, int), POSE[:1], cameras, EXACT,
                         counter_key(4, np.arange(1))).points()[0]
    own = (points[np.isfinite(points).all(1)] - POSE[0, :3] - [0.0, 0.0, 0.06]) / [
        0.04, 0.04, 0.06]
    assert len(own) > 150
    radius = np.hypot(own[:, 0], own[:, 1]) / (1.0 - 0.9 * own[:, 2])
    assert np.abs(np.hypot(radius, own[:, 2]) - 1.0).max() < 0.02


def test_the_front_of_a_block_is_where_the_ray_meets_its_plane() -> None:
    table = replace(EXACT, elevation_rad=0.0)
    view = seen("block", table)
    depth = view.depth_m[0]
    # From -y, but for the turn of the cameras towards each other: the plane y = -40 mm.
    middle = depth.shape[0] // 2
    ray = view.axes[0] @ [0.5 / view.focal_pixels[0], 0.5 / view.focal_pixels[0], 1.0]
    assert depth[middle, middle] == pytest.approx(
        (-0.04 - view.centre_m[0, 1]) / ray[1], abs=3e-4)


def test_errors_grow_with_the_square_of_the_depth() -> None:
    for far in (0.8, 1.6):
        table = StereoTable(distance_m=far, missing_depth=0.0, pixel_noise=0.5)
        true, view = seen("block", replace(table, pixel_noise=0.0)), seen("block", table)
        on = np.isfinite(true.depth_m)
        wrong = (view.depth_m[on] - true.depth_m[on]) / true.depth_m[on] ** 2
        focal = view.focal_pixels[0] * MATCHED
        assert wrong.std() == pytest.approx(0.5 / (focal * table.baseline_m), rel=0.1)
        assert np.isinf(view.depth_m[~on]).all()


def test_as_much_is_missing_as_asked_for() -> None:
    view = seen("block", StereoTable(missing_depth=0.3))
    assert np.isnan(view.depth_m).mean() == pytest.approx(0.3, abs=0.07)  # of 384 patches
    assert not np.array_equal(np.isnan(view.depth_m[0]), np.isnan(view.depth_m[1]))
    missing = np.isnan(view.depth_m)
    worlds, side, _ = missing.shape
    patches = missing.reshape(worlds, side // PATCH, PATCH, side // PATCH, PATCH)
    share = patches.mean((2, 4))
    assert set(np.unique(share)) == {0.0, 1.0}  # together
    assert np.corrcoef(share[..., 1:].ravel(), share[..., :-1].ravel())[0, 1] < 0.25
    assert np.corrcoef(share[:, 1:].ravel(), share[:, :-1].ravel())[0, 1] < 0.25


def test_a_batch_may_be_empty_and_poses_are_checked() -> None:
    cameras = stereo_cameras(EXACT, np.zeros((0, 3)))
    scene, none = scene_of([body_from_name("block")], "cpu"), np.zeros(0, int)
    view = seen_depths(scene, none, POSE[:0], cameras, EXACT, counter_key(4, none))
    side = EXACT.pixels // MATCHED
    assert view.depth_m.shape == (0, side, side)
    for wrong in (POSE[:2], POSE[:0, :6]):
        with pytest.raises(ShapeError, match=r"body_pose: .*should be \(world 0, 7\)"):
            seen_depths(scene, none, wrong, cameras, EXACT, counter_key(4, none))


@pytest.mark.parametrize(("name", "wrong", "told"), [
    ("centre_m", np.full((6, 2, 3), np.nan), r"centre_m: is nan at \(0, 0, 0\); should be finite"),
    ("axes", np.full((6, 2, 3, 3), np.inf), r"axes: is inf at .*; should be finite"),
    ("axes", np.zeros((6, 1, 3, 3)), r"axes: of shape .*; should be \(world 6, camera 2, 3, 3\)"),
    ("pixels", 0, "pixels 0: wants 1 to"), ("pixels", 2.5, "pixels 2.5: wants 1 to"),
    ("focal_pixels", 0.0, "focal_pixels 0.0: should be above 0")])
def test_cameras_have_places_and_pixels(name: str, wrong: Any, told: str) -> None:
    """A camera that is nowhere saw nothing."""
    with pytest.raises(ValueError, match=told):
        replace(stereo_cameras(EXACT, POSE[:, :3]), **{name: wrong})


@pytest.mark.parametrize("look", [silhouettes, depths])
def test_objects_have_places_and_unit_quaternions(look) -> None:
    cameras = stereo_cameras(EXACT, POSE[:, :3])
    for wrong in (np.nan, 0.0):
        pose = POSE.copy()
        pose[1, 6] = wrong
        with pytest.raises(ValueError, match=r"body_pose: that of world 1 is .* of length 1"):
            look(scene_of([body_from_name("block")], "cpu"), np.zeros(1, int), pose, cameras)
