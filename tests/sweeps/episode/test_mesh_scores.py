"""Scores of meshes against trimesh, nearest neighbours and closed forms."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from fit.implicit.record import TriangleMesh
from fit.revolution.geometry import RevolutionBody
from fit.superquadric.geometry import Superquadric, superquadric, superquadric_volume
from strategies.recovery.choose_model import Recovered, Shape
from sweeps.episode.mesh_scores import score_meshes, scores_with_meshes
from sweeps.episode.scores import DENSE, FINE, Scorer, score_recovered, score_superquadrics
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects.catalogue import body_from_name, body_from_table

AT = np.array([[0.45, 0.1, 0, 0, 0, np.sin(0.4), np.cos(0.4)]])
TURN = np.array([[np.cos(0.8), -np.sin(0.8), 0], [np.sin(0.8), np.cos(0.8), 0], [0, 0, 1]])


def standing(size, exponents) -> Superquadric:
    """Superquadrics that stand where `AT` says, a row each."""
    size = np.atleast_2d(size)
    middle = np.array([[0.45, 0.1, 0.0]]) + size * [0, 0, 1]
    return Superquadric(size, np.broadcast_to(exponents, (len(size), 2)), middle,
                        np.repeat(AT[:, 3:], len(size), 0), *np.zeros((2, len(size), 2)))


def placed(mesh: trimesh.Trimesh) -> TriangleMesh:
    """A mesh in the body's frame as it stands in the base frame."""
    return TriangleMesh(np.asarray(mesh.vertices) @ TURN.T + AT[0, :3], np.asarray(mesh.faces))


def block(share: float = 1.0) -> trimesh.Trimesh:
    """The catalogue's block, or one of that share of its size about its centre."""
    made = trimesh.creation.box(share * np.array([0.06, 0.08, 0.12]))
    made.apply_translation([0, 0, 0.06])
    return made.subdivide().subdivide()


def test_the_true_mesh_scores_perfectly() -> None:
    scores = score_meshes([placed(block())], body_from_name("block"), AT)
    assert scores.chamfer_m[0] < 2e-4
    assert scores.iou[0] == pytest.approx(1.0, abs=1e-3)
    assert scores.volume_ratio[0] == pytest.approx(1.0, abs=1e-2)
    assert scores.coverage[0] == 1.0


def test_an_inner_block_has_the_ratio_of_volumes() -> None:
    scores = score_meshes([placed(block(0.8))], body_from_name("block"), AT)
    assert scores.iou[0] == pytest.approx(0.8**3, abs=0.01)
    assert scores.volume_ratio[0] == pytest.approx(0.8**3, abs=0.01)


def lens(one: float, other: float, apart: float) -> float:
    """The area that two circles share whose middles are `apart`."""
    if apart <= abs(one - other):
        return np.pi * min(one, other) ** 2
    along = (apart**2 + one**2 - other**2) / (2 * apart)
    rest = apart - along
    return (one**2 * np.arccos(along / one) + other**2 * np.arccos(rest / other)
            - apart * np.sqrt(one**2 - along**2))


@pytest.mark.parametrize("apart", [0.001, 0.002, 0.004])
def test_thin_walls_beside_thin_walls_share_what_circles_say(apart: float) -> None:
    """A cup 90 mm high with a wall of 3 mm and a foot of 5 mm, and the same moved aside."""
    outer, inner = 0.040, 0.037
    cup = body_from_table({"name": "cup", "compound": [
        {"shape": "cylinder", "radius_mm": 40, "height_mm": 90},
        {"shape": "cylinder", "radius_mm": 37, "height_mm": 90, "at_mm": [0, 0, 5],
         "join": "difference"}]}, Path())
    moved = trimesh.creation.revolve(np.array([
        [0, 0], [outer, 0], [outer, 0.09], [inner, 0.09], [inner, 0.005], [0, 0.005]]),
        sections=128)
    moved.apply_translation([apart, 0, 0])
    walls = lens(outer, outer, apart) - 2 * lens(outer, inner, apart) + lens(inner, inner, apart)
    both = 0.005 * lens(outer, outer, apart) + 0.085 * walls
    each = np.pi * (0.09 * outer**2 - 0.085 * inner**2)
    assert score_meshes([placed(moved)], cup, AT).iou[0] == pytest.approx(
        both / (2 * each - both), abs=0.01)


@pytest.mark.parametrize("thick", [0.001, 0.002, 0.004])
@pytest.mark.parametrize("way", ["mesh", "superquadric", "contour"])
def test_a_thin_plate_shares_what_of_it_lies_within(thick: float, way: str) -> None:
    """Half of a recovered plate lies within a true block or disc, half above: by lengths."""
    part = {"shape": "block", "size_mm": [80, 100, 12]}
    true, area = 0.08 * 0.1 * 0.012, 0.08 * 0.1
    if way == "contour":
        part = {"shape": "cylinder", "radius_mm": 40, "height_mm": 12}
        true, area = np.pi * 0.04**2 * 0.012, np.pi * 0.04**2
    body, at = body_from_table({"name": "block", "compound": [part]}, Path()), np.eye(7)[6:]
    if way == "mesh":
        plate = trimesh.creation.box((0.08, 0.1, thick))
        iou = score_meshes([TriangleMesh(plate.vertices + [0.0, 0.0, 0.012], plate.faces)], body,
                           at).iou[0]
    elif way == "superquadric":
        plate = superquadric((0.04, 0.05, thick / 2), (0.1, 0.1), (0.0, 0.0, 0.012))
        area = superquadric_volume(plate)[0] / thick
        iou = score_superquadrics(plate, body, at).iou[0]
    else:
        disc = RevolutionBody(np.array([[0.0, 0.0, 0.012 - thick / 2]]), np.eye(3)[2:],
                              np.array([[0.0, thick]]), np.array([[0.04, 0.04]]))
        iou = score_recovered(Recovered(np.array([Shape.REVOLUTION]), superquadric(
            (0.04, 0.04, thick / 2), (0.1, 1.0), (0.0, 0.0, 0.012)), disc), body, at).iou[0]
    shared = area * thick / 2
    assert iou == pytest.approx(shared / (true + shared), abs=0.004)


def test_bodies_that_overlap_are_inside_where_both_are() -> None:
    """A user's mesh, one block within another. Rays would say that the inner one is outside."""
    cut = [block(), block(0.9)]
    cut[1].apply_translation([0, 0, 0.003])
    mesh = placed(trimesh.util.concatenate(cut))
    scores = score_meshes([mesh], body_from_name("block"), AT)
    common = scores.iou * (1.0 + scores.volume_ratio) / (1.0 + scores.iou)  # of the true volume
    assert scores.volume_ratio[0] == pytest.approx(1.0 + 0.9**3, abs=0.01)
    assert common[0] > 0.9


def test_zero_sets_are_scored_as_meshes_of_any_kind() -> None:
    ring = TriangleMesh(*_ring())
    scores = [score_meshes([mesh], body_from_name("block"), AT)
              for mesh in (ring, replace(ring, simple=True))]
    for name in ("chamfer_m", "iou", "volume_ratio", "coverage"):
        assert getattr(scores[0], name) == getattr(scores[1], name)


def _ring() -> tuple[np.ndarray, np.ndarray]:
    made = trimesh.creation.torus(0.03, 0.01)
    made.apply_translation([0.45, 0.1, 0.05])
    return np.asarray(made.vertices), np.asarray(made.faces)


def test_distances_and_shares_against_trimesh() -> None:
    body = body_from_name("large_cylinder")
    other = trimesh.creation.cylinder(0.031, 0.13, sections=64).subdivide()
    other.apply_transform(trimesh.transformations.rotation_matrix(0.1, [1, 0, 0]))
    other.apply_translation([0.004, 0.0, 0.061])
    scores = score_meshes([placed(other)], body, AT)
    sample = sample_body(body, surface=4096, inside=4096)
    there = np.abs(trimesh.proximity.signed_distance(other, sample.surface_m[::7]))
    on, _ = trimesh.sample.sample_surface(other, 6000, seed=1)
    back = cKDTree(sample_body(body, surface=16384).surface_m).query(on)[0]
    assert scores.chamfer_m[0] == pytest.approx(0.5 * (there.mean() + back.mean()), abs=4e-4)
    assert scores.square_m2[0] == pytest.approx((there**2).mean() + (back**2).mean(), rel=0.05)
    assert scores.hausdorff95_m[0] == pytest.approx(
        max(np.quantile(there, 0.95), np.quantile(back, 0.95)), abs=1e-3)
    assert scores.coverage[0] == pytest.approx((there <= 0.005).mean(), abs=0.05)
    common = sample.volume_m3 * other.contains(sample.inside_m).mean()
    union = sample.volume_m3 + other.volume - common
    assert scores.iou[0] == pytest.approx(common / union, abs=0.01)


def test_meshes_and_superquadrics_are_scored_alike() -> None:
    body = body_from_name("large_cylinder")
    ball = trimesh.creation.icosphere(4, 0.045)
    ball.apply_translation([0, 0, 0.045])
    mesh = score_meshes([placed(ball)], body, AT)
    fits = score_superquadrics(standing([0.045, 0.045, 0.045], [1.0, 1.0]), body, AT)
    for name in ("chamfer_m", "hausdorff95_m"):
        assert getattr(mesh, name)[0] == pytest.approx(getattr(fits, name)[0], abs=3e-4)
    assert mesh.iou[0] == pytest.approx(fits.iou[0], abs=0.005)
    assert mesh.coverage[0] == pytest.approx(fits.coverage[0], abs=0.02)


@pytest.mark.slow
def test_dense_samples_of_a_mesh() -> None:
    body = body_from_name("large_cylinder")
    fine, dense = (score_meshes([placed(block())], body, AT, samples=samples)
                   for samples in (FINE, DENSE))
    assert dense.hausdorff95_m[0] == pytest.approx(fine.hausdorff95_m[0], rel=0.02)
    assert dense.iou[0] == pytest.approx(fine.iou[0], abs=0.003)
    assert dense.chamfer_m[0] != fine.chamfer_m[0]


def test_only_worlds_with_a_mesh_are_scored_by_it() -> None:
    bodies = [body_from_name("block"), body_from_name("large_cylinder")]
    pose = np.repeat(AT, 3, 0)
    scorer = Scorer(bodies, np.array([0, 0, 1]), pose)
    before = score_superquadrics(standing(np.full((3, 3), 0.04), np.ones((3, 2))), bodies[0], pose)
    none = TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    after = scores_with_meshes(scorer, [none, placed(block()), none], before)
    assert after.iou[[0, 2]].tolist() == before.iou[[0, 2]].tolist()
    assert after.iou[1] == pytest.approx(1.0, abs=1e-3)
    with pytest.raises(ValueError, match="no faces"):
        score_meshes([none], bodies[0], AT)
    with pytest.raises(ValueError, match="for 1 worlds"):
        score_meshes([], bodies[0], AT)
