"""Both procedures on scanned objects: faces of a box, the contour of a can.

Meshes like scans are made here; scanned objects are taken, too, where they lie beside the
repository.
"""

from pathlib import Path

import numpy as np
import pytest
from places import SHARED
from scipy.spatial.transform import Rotation

from fit.plane import fit_plane
from strategies.procedures.contour_follower import explore_contour
from strategies.procedures.contour_record import Axis
from strategies.procedures.contour_shape import profile_of
from strategies.procedures.planar_explorer import explore_plane
from strategies.procedures.planar_faces import angle_between, planes_of
from strategies.procedures.touches import EndReason, true_touches
from sweeps.validate.bodies.scan_meshes import scan_meshes
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects.mesh_import import body_from_mesh
from warpgrasp.parameters import ArmTable, HandTable, SensorTable
from warpgrasp.robot import Robot, Truth

SCANS = SHARED / "objects" / "ycb"
WORLDS = 20
pytestmark = pytest.mark.slow


def scanned(name: str):
    return pytest.param(name, marks=pytest.mark.skipif(
        not SCANS.is_dir(), reason="no scanned objects beside the repository"))


def set_up(name: str, folder: Path):
    file = SCANS / f"{name}.ply"
    if name in (made := scan_meshes()):
        file = folder / f"{name}.ply"
        made[name].export(file)
    body = body_from_mesh(file, units="m")
    pose = np.tile([0.45, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (WORLDS, 1))
    truth = Truth(pose)
    key = np.arange(WORLDS).astype(np.uint64) + np.uint64(5)
    return body, truth, Robot([body], np.zeros(1, int), truth, key, ArmTable(), HandTable(),
                              SensorTable())


@pytest.mark.parametrize("name", ["carton", scanned("cracker_box")])
def test_faces_of_a_box(name: str, tmp_path: Path) -> None:
    body, truth, robot = set_up(name, tmp_path)
    rng = np.random.default_rng(3)
    faces = []
    for way in (np.array([-1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])):
        middle = np.array([0.45, 0.0, body.high_m[2] / 2]) + way * body.high_m
        prior = middle + rng.normal(0.0, 0.004, (WORLDS, 3))
        normal = Rotation.from_rotvec(rng.normal(0, np.radians(3), (WORLDS, 3))).apply(way)
        e = explore_plane(robot, prior, normal)
        assert (e.reason == EndReason.COMPLETE).mean() >= 0.9
        face = planes_of(e)
        # The scanned face bulges and leans: the plane through the true touches is what can be had.
        point, _ = true_touches(e.touches, truth)
        points, mask = np.zeros((WORLDS, 200, 3)), np.zeros((WORLDS, 200), bool)
        for world in range(WORLDS):
            mine = point[(e.touches.world == world) & np.isfinite(point[:, 0])]
            points[world, :len(mine)], mask[world, :len(mine)] = mine, True
        best = fit_plane(points, mask).normal
        off = np.degrees(np.arccos(np.clip(np.abs((best * face.normal).sum(1)), 0, 1)))
        assert np.median(off) <= 1.0
        faces.append(face)
    angle, _ = angle_between(*faces)
    assert (np.abs(np.degrees(angle) - 90.0) <= 3.0).mean() >= 0.9


@pytest.mark.parametrize("name", ["can", scanned("master_chef_can")])
def test_contour_of_a_can(name: str, tmp_path: Path) -> None:
    body, _, robot = set_up(name, tmp_path)
    error = np.random.default_rng(3).normal(0.0, 0.005, (WORLDS, 4))
    radius, height = body.high_m[0], body.high_m[2]
    e = explore_contour(robot, Axis.upright(0.45 + error[:, 0], error[:, 1],
                                            height + error[:, 2], radius + error[:, 3]))
    ended = e.reason == EndReason.END_OF_OBJECT
    assert ended.mean() >= 0.75  # 102 mm is as wide as the hand opens: some never get around it
    profile = profile_of(e)
    ratio = profile.volume_m3[ended] / sample_body(body).volume_m3
    assert abs(np.median(ratio) - 1.0) < 0.10
    assert abs(np.median(profile.largest_radius_m[ended]) - radius) < 0.0015
    assert (np.abs(ratio - 1.0) < 0.10).mean() >= 0.85
