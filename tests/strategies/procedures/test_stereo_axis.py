"""The axis seen by two cameras: exact for cylinders, within some degrees for tapering bodies."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from strategies.procedures.stereo_axis import longest_lines, see_axis
from warpgrasp.objects.catalogue import body_from_name
from warpgrasp.parameters import ArmTable, HandTable, SensorTable, StereoTable
from warpgrasp.robot import Robot, Truth
from warpgrasp.sight.silhouette import stereo_cameras


def look(name: str, tilt_deg: float, table: StereoTable, worlds: int = 6, aim_m: float = 0.0):
    azimuth = np.linspace(0, 2 * np.pi, worlds, endpoint=False)
    half = np.radians(tilt_deg) / 2
    pose = np.zeros((worlds, 7))
    pose[:, 0], pose[:, 6] = 0.45, np.cos(half)
    pose[:, 3], pose[:, 4] = np.sin(half) * np.cos(azimuth), np.sin(half) * np.sin(azimuth)
    body = body_from_name(name)
    robot = Robot([body], np.zeros(1, int), Truth(pose), np.arange(worlds).astype(np.uint64),
                  ArmTable(), HandTable(), SensorTable())
    aim = np.random.default_rng(15).normal(0.0, aim_m, (worlds, 3))
    axis = see_axis(robot, [0.45, 0.0, body.high_m[2] / 2] + aim, table)
    true = Rotation.from_quat(pose[:, 3:]).apply([0.0, 0.0, 1.0])
    return axis, np.degrees(np.arccos(np.clip((axis.direction * true).sum(1), -1, 1)))


@pytest.mark.parametrize(("name", "tilt_deg", "limit_deg"), [
    ("large_cylinder", 0.0, 0.6), ("large_cylinder", 8.0, 1.0), ("wine_bottle", 8.0, 0.6),
    ("lightbulb", 0.0, 4.0)])
def test_axis_is_seen(name: str, tilt_deg: float, limit_deg: float) -> None:
    axis, off = look(name, tilt_deg, StereoTable())
    assert axis.found.all()
    assert np.median(off) < limit_deg


def test_pixel_noise_costs_accuracy() -> None:
    clean = look("large_cylinder", 0.0, StereoTable(pixel_noise=0.0))[1]
    noisy = look("large_cylinder", 0.0, StereoTable(pixel_noise=4.0))[1]
    assert noisy.mean() > 2 * clean.mean()


def test_nothing_in_view_and_no_baseline_are_not_found() -> None:
    table = StereoTable(pixels=64)
    body = body_from_name("large_cylinder")
    robot = Robot([body], np.zeros(1, int), Truth(np.array([[0.45, 0, 0, 0, 0, 0, 1.0]])),
                  np.zeros(1, np.uint64), ArmTable(), HandTable(), SensorTable())
    away = see_axis(robot, np.array([[0.45, 3.0, 0.0]]), table)
    assert not away.found[0]
    np.testing.assert_array_equal(away.direction, [[0, 0, 1]])
    same = see_axis(robot, np.array([[0.45, 0.0, 0.06]]), replace(table, baseline_m=1e-3))
    assert not same.found[0]


def test_cameras_look_at_their_target() -> None:
    target = np.array([[0.4, 0.1, 0.2]])
    cameras = stereo_cameras(StereoTable(), target)
    for k in range(2):
        ray = target[0] - cameras.centre_m[0, k]
        np.testing.assert_allclose(cameras.axes[0, k].T @ ray, [0, 0, np.linalg.norm(ray)],
                                   atol=1e-12)
        assert np.linalg.det(cameras.axes[0, k]) == pytest.approx(1.0)
        assert cameras.axes[0, k][2, 1] < 0  # rows run downwards
    gap = np.linalg.norm(cameras.centre_m[0, 1] - cameras.centre_m[0, 0])
    assert gap == pytest.approx(0.3)


def test_shoulders_and_rims_are_no_sides() -> None:
    # An Orangina bottle has no long straight side: once a shoulder in one image was matched with
    # the body in the other, and one axis in ten lay 40 degrees off.
    off = look("orangina_bottle", 0.0, StereoTable(), aim_m=0.010)[1]
    assert off.max() < 25.0
    assert np.median(off) < 15.0


def test_edges_that_are_missing_cost_accuracy_and_no_axis() -> None:
    axis, off = look("wine_bottle", 0.0, StereoTable(missing_edges=0.2, flipped_pixels=0.05))
    assert axis.found.all()
    assert np.median(off) < 3.0


def test_both_sides_of_an_object_are_read_by_themselves() -> None:
    """They had the same noise, so that their mean was no surer than each."""
    seen = np.zeros((1, 256, 256), bool)
    seen[0, 60:200, 100:150] = True
    cameras = stereo_cameras(StereoTable(), np.zeros((1, 3)))
    slopes = []
    for seed in range(60):
        noise = np.random.default_rng(seed).normal(size=(1, 1024))
        lines = longest_lines(seen, noise, cameras)
        longest = np.argsort(-lines.votes[0])[:2]
        assert sorted(lines.side[0, longest]) == [0, 1]
        normal = lines.normal[0, longest[np.argsort(lines.side[0, longest])]]
        slopes.append(normal[:, 1] * np.sign(normal[:, 0]))
    assert abs(np.corrcoef(np.array(slopes).T)[0, 1]) < 0.4
