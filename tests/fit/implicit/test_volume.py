"""Volumes of free forms, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from fit.arrays import rows_of
from fit.implicit import fit_implicit, implicit_meshes, implicit_volume
from fit.implicit.known import KnownProcess, fit_known
from fit.implicit.volume import VolumeEstimate


@pytest.mark.parametrize("count", [120, pytest.param(200, marks=pytest.mark.slow)])
def test_many_touches_do_not_make_a_body_smaller(count: int) -> None:
    """An error of a touch moves its point off the surface, too."""
    draw = np.random.default_rng(3)
    way = draw.normal(size=(4, count, 3))
    way /= np.linalg.norm(way, axis=2, keepdims=True)
    half = np.array([0.03, 0.04, 0.05])
    fits = fit_implicit(way * half + 0.001 * draw.normal(size=way.shape))
    known = implicit_volume(fits, implicit_meshes(fits))
    true = 4.0 / 3.0 * np.pi * half.prod()
    assert np.mean(known.volume_m3) == pytest.approx(true, rel=0.008)
    low, high = known.interval_m3().T
    assert np.mean((low < true) & (true < high)) >= 0.5


@pytest.mark.slow
def test_volumes_are_those_of_zero_sets_however_coarse_the_mesh() -> None:
    """Triangles are chords; what a grid or the table cuts off stays cut off."""
    draw = np.random.default_rng(5)
    way = draw.normal(size=(3, 64, 3))
    way /= np.linalg.norm(way, axis=2, keepdims=True)
    way[2, :, 2] = np.abs(way[2, :, 2])  # half a body, on a table
    fits = fit_implicit(way * [0.03, 0.04, 0.05], table_z=np.array([-1.0, -1.0, 0.0]))
    fine = np.array([mesh.volume_m3 for mesh in implicit_meshes(fits, cells=96)])
    for cells, off in ((32, 0.002), (16, 0.007)):
        meshes = implicit_meshes(fits, cells=cells)
        short = np.array([mesh.volume_m3 for mesh in meshes]) / fine - 1.0
        left = implicit_volume(fits, meshes).volume_m3 / fine - 1.0
        assert (short < -1.4 * off).all()
        assert (np.abs(left) < off).all()
    cut = rows_of(fits, np.arange(1))
    cut = replace(cut, high_m=cut.high_m - [0.0, 0.0, 0.08])
    meshes = implicit_meshes(cut)
    assert implicit_volume(cut, meshes).volume_m3 == pytest.approx(meshes[0].volume_m3, rel=0.02)


def test_an_error_that_touches_share_shifts_the_whole_surface() -> None:
    """Of a ball: by 4 pi r^2 dr of volume."""
    way = np.random.default_rng(2).normal(size=(1, 96, 3))
    way /= np.linalg.norm(way, axis=2, keepdims=True)
    mask, process = np.ones((1, 96), bool), KnownProcess()
    fits = fit_known(0.04 * way, mask, way, np.full(mask.shape, 0.0005), process)
    meshes = implicit_meshes(fits, process.mean)
    alone, shared = (implicit_volume(fits, meshes, process.mean, shared_m=off_m)
                     for off_m in (0.0, 0.001))
    more = np.sqrt(shared.std_m3**2 - alone.std_m3**2)
    assert more == pytest.approx(4.0 * np.pi * 0.04**2 * 0.001, rel=0.05)
    np.testing.assert_allclose(shared.surface_std_m, np.hypot(alone.surface_std_m, 0.001))
    np.testing.assert_array_equal(shared.volume_m3, alone.volume_m3)


@pytest.mark.slow
def test_a_plate_thinner_than_points_lie_deep_keeps_its_volume() -> None:
    """Inside of thin walls there are no points: they would lie beyond the other side."""
    draw = np.random.default_rng(4)
    half = np.array([0.04, 0.05, 0.003])
    points = draw.uniform(-half, half, (2, 240, 3))
    points[..., 2] = np.where(draw.random((2, 240)) < 0.5, -1.0, 1.0) * half[2]
    normals = np.zeros(points.shape)
    normals[..., 2] = np.sign(points[..., 2])
    rim = np.arange(240) % 8 == 0  # on the four narrow sides
    side = draw.integers(0, 2, (2, 240))
    for axis in (0, 1):
        on = rim & (side == axis)
        way = np.where(draw.random((2, 240)) < 0.5, -1.0, 1.0)
        points[..., axis] = np.where(on, way * half[axis], points[..., axis])
        points[..., 2] = np.where(on, draw.uniform(-half[2], half[2], (2, 240)), points[..., 2])
        normals[on] = 0.0
        normals[..., axis] = np.where(on, way, normals[..., axis])
    points += 0.0003 * draw.normal(size=points.shape)
    fits = fit_implicit(points, normals=normals)
    known = implicit_volume(fits, implicit_meshes(fits))
    assert known.volume_m3.mean() == pytest.approx(8.0 * half.prod(), rel=0.12)


def test_an_interval_holds_its_volume_however_small() -> None:
    volume = np.array([1e-4, 1e-13])
    low, high = VolumeEstimate(volume, 0.1 * volume, np.zeros((2, 1, 3)),
                               np.zeros((2, 1))).interval_m3().T
    assert (low < volume).all()
    assert (volume < high).all()
    assert high / low == pytest.approx(np.full(2, high[0] / low[0]))
