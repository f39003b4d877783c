"""Small pieces of a free form far from the prior are left out, the others stay."""

import numpy as np
import pytest
import trimesh

from fit.implicit.record import TriangleMesh
from strategies.poses.waypoints import BoundingCylinder
from strategies.reconstruct.believed_pieces import believed_pieces

PRIOR = BoundingCylinder(*(np.array([value]) for value in (0.45, 0.0, 0.05, 0.08)))


def balls(*at_m: tuple[float, float, float, float]) -> TriangleMesh:
    """One mesh of balls (x, y, z, radius), their triangles in a random order."""
    mesh = trimesh.util.concatenate([
        trimesh.creation.icosphere(3 if radius > 0.01 else 1, radius).apply_translation([x, y, z])
        for x, y, z, radius in at_m])
    order = np.random.default_rng(5).permutation(len(mesh.faces))
    return TriangleMesh(np.asarray(mesh.vertices), np.asarray(mesh.faces)[order])


BODY, ASIDE, ABOVE, BESIDE = ((0.45, 0.0, 0.04, 0.04), (0.45, 0.06, 0.03, 0.008),
                              (0.45, 0.0, 0.20, 0.009), (0.60, 0.0, 0.05, 0.009))


@pytest.mark.parametrize(("pieces", "kept"), [
    ((BODY,), 1), ((BODY, ASIDE), 2), ((ABOVE, BODY), 1), ((BODY, BESIDE, ASIDE, ABOVE), 2)])
def test_only_pieces_within_the_prior_stay(pieces, kept: int) -> None:  # type: ignore[no-untyped-def]
    mesh = believed_pieces(balls(*pieces), PRIOR)
    parts = trimesh.Trimesh(mesh.vertices_m, mesh.faces, process=False).split()
    expected = [p for p in pieces if p in (BODY, ASIDE)]
    assert len(parts) == kept == len(expected)
    assert mesh.volume_m3 == pytest.approx(balls(*expected).volume_m3)


def test_the_largest_piece_stays_where_the_prior_contradicts_it() -> None:
    whole = balls((0.45, 0.0, 0.25, 0.04), ASIDE)
    assert len(believed_pieces(whole, PRIOR).faces) == len(whole.faces)


def test_no_piece_is_none() -> None:
    empty = TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), int))
    assert len(believed_pieces(empty, PRIOR).faces) == 0
