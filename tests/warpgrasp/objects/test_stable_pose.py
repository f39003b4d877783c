"""Stable poses: each is at rest by statics, recomputed from the body that was set down."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay
from scipy.spatial.transform import Rotation

from warpgrasp.geometry.body import Body, BodyError, distance_to_bodies, scene_of
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.objects.families import family_table
from warpgrasp.objects.stable_pose import _turned_up, body_in_stable_pose, stable_poses


def body_of(name: str) -> Body:
    table = family_table(name)
    return body_from_table(table, Path()) if table else body_from_name(name)


@pytest.mark.parametrize("name", [
    "wedge", *(pytest.param(name, marks=pytest.mark.slow) for name in ("wine_bottle", "hammer-1"))])
def test_every_pose_is_at_rest(name: str) -> None:
    """The centre of mass lies over the places that touch the table, or over the line or the two
    ends by which something round does."""
    body = body_of(name)
    poses = stable_poses(body)
    chance = np.array([pose.probability for pose in poses])
    assert (np.diff(chance) <= 1e-5).all()
    assert 0.9 < chance.sum() <= 1.0 + 1e-9
    volume = sample_body(body).volume_m3
    for number in (1, len(poses)):
        lying = body_in_stable_pose(body, number)
        sample = sample_body(lying, surface=None)
        assert sample.volume_m3 == pytest.approx(volume, rel=0.01)
        assert np.abs(sample.surface_m[:, 2].min()) < 1e-3
        assert np.abs(np.add(lying.low_m, lying.high_m))[:2].max() < 1e-9
        on = sample.surface_m[sample.surface_m[:, 2] < 2.5e-3, :2]
        middle = sample.inside_m.mean(0)[:2]
        assert Delaunay(on[ConvexHull(on).vertices]).find_simplex(middle) >= 0, (name, number)


def test_a_turn_sets_its_direction_upright_the_shortest_way() -> None:
    ups = np.random.default_rng(5).normal(size=(40, 3))
    ups /= np.linalg.norm(ups, axis=1, keepdims=True)
    for up in (*ups, *np.eye(3), *-np.eye(3)):
        turn = Rotation.from_quat(_turned_up(up))
        assert turn.apply(up) == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
        assert turn.magnitude() == pytest.approx(np.arccos(np.clip(up[2], -1.0, 1.0)), abs=1e-6)


def test_boxes_lie_on_their_larger_faces_more_often() -> None:
    ups = [Rotation.from_quat(pose.quaternion_xyzw).inv().apply([0, 0, 1])
           for pose in stable_poses(body_from_name("block"))]
    assert np.abs(ups).argmax(1).tolist() == [0, 0, 1, 1, 2, 2]  # 60 x 80 x 120 mm
    assert np.allclose(np.abs(ups).max(1), 1.0, atol=2e-3)


def test_what_is_round_lies_on_its_side_in_one_way() -> None:
    poses = stable_poses(body_from_name("large_cylinder"))
    lying, *standing = (Rotation.from_quat(p.quaternion_xyzw).apply([0, 0, 1])[2] for p in poses)
    assert lying == pytest.approx(0.0, abs=0.01)
    assert np.abs(standing) == pytest.approx([1.0, 1.0], abs=1e-3)


def test_an_ellipsoid_lies_on_its_broadest_sides_alone() -> None:
    """On its middle axis it is level too, and would roll off."""
    body = body_from_table({"name": "egg", "superquadric": {
        "size_mm": [30, 40, 70], "exponents": [1, 1]}}, Path())
    poses = stable_poses(body)
    ups = np.array([Rotation.from_quat(pose.quaternion_xyzw).inv().apply([0, 0, 1])
                    for pose in poses])
    assert len(poses) == 2
    assert np.sort(ups[:, 0]) == pytest.approx([-1.0, 1.0], abs=3e-3)  # four degrees
    assert [pose.probability for pose in poses] == pytest.approx([0.5, 0.5], abs=0.03)


def test_turning_moves_nothing_within_the_body() -> None:
    body = body_of("hammer-1")
    lying = body_in_stable_pose(body, 1)
    turn = Rotation.from_quat(stable_poses(body)[0].quaternion_xyzw)
    points = np.random.default_rng(0).uniform(-0.06, 0.06, (1, 200, 3)) + [0, 0, 0.05]
    shift = np.subtract(lying.parts[0].place[:3], turn.apply(body.parts[0].place[:3]))
    there, _ = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int), points)
    here, _ = distance_to_bodies(scene_of([lying], "cpu"), np.zeros(1, int),
                                 turn.apply(points[0])[None] + shift)
    assert np.abs(there - here).max() < 1e-9


def test_a_pose_that_there_is_not_is_refused() -> None:
    for number in (0, 7):
        with pytest.raises(BodyError, match=f"stable_pose = {number}: there are 6"):
            body_in_stable_pose(body_from_name("block"), number)
    with pytest.raises(BodyError, match="whole number"):
        body_from_table({"object": "block", "stable_pose": "on its side"}, Path())
