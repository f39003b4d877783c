"""Densities of felt faces, and what is learned of them, against counts by hand."""

import numpy as np
import pytest

from strategies.recognition.answers import _log_rate
from strategies.recognition.descriptions import FACES, FeltFaces
from strategies.recognition.known_models import KnownObject
from strategies.recognition.lessons import _averaged
from strategies.recognition.match_faces import (
    BROAD,
    SPURIOUS,
    closed_model,
    log_density_of_any,
    log_density_of_faces,
)

SIZE_M, STD_M = np.array([0.06, 0.08, 0.12]), 0.002
SIDES = np.array([[0, 0, 1], [1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], float)
BLOCK = closed_model("block", np.concatenate([SIDES, [[0, 0, -1]]]), np.array(
    [SIZE_M[2], *np.repeat(SIZE_M[:2] / 2, 2), 0.0]))


def felt(sides: list[int], off_m: float = 0.0, strange: bool = False) -> FeltFaces:
    """Faces of a block that stands elsewhere, the last one off; maybe one that is none of its."""
    normals = SIDES[sides]
    middles = [0.4, 0.1, 0.06] + 0.5 * normals * SIZE_M
    middles[-1] += off_m * normals[-1]
    if strange:
        way = np.array([[0.6, 0.8, 0.0]])
        normals = np.concatenate([way, normals])
        middles = np.concatenate([[[0.42, 0.13, 0.06]], middles])
    return FeltFaces(middles, normals)


@pytest.mark.parametrize(("sides", "distances"), [
    ([0, 1], 1), ([1, 2], 1), ([0, 1, 3], 1), ([1, 2, 3], 1), ([0, 1, 2, 3], 2),
    ([0, 1, 2, 3, 4], 3)])
def test_a_face_counts_unless_it_only_fixes_the_place(sides: list[int], distances: int) -> None:
    """The table tells the height of the top; sides must tell two places on the table first."""
    assert BLOCK is not None
    each = -np.log(STD_M * np.sqrt(2 * np.pi))
    assert log_density_of_faces([felt(sides)], BLOCK, STD_M) == pytest.approx(
        [distances * each], abs=1e-4)
    assert log_density_of_any([felt(sides)]) == pytest.approx([distances * BROAD])


def test_a_face_off_its_plane_is_less_likely_and_one_too_many_as_spurious() -> None:
    assert BLOCK is not None
    exact, off, more, neither = log_density_of_faces([
        felt([1, 3, 0]), felt([1, 3, 0], 0.004), felt([1, 3, 0], strange=True),
        felt([1, 0], 0.03)], BLOCK, STD_M)
    # Between top and table the error is shared: each lies off by half of it.
    assert exact - off == pytest.approx(0.5 * 2 * 0.002**2 / STD_M**2, rel=0.01)
    assert more - exact == pytest.approx(np.log(SPURIOUS) + BROAD, abs=1e-3)
    assert neither == -np.inf  # of two faces none may be left over


def test_a_face_too_many_that_alone_fixes_a_place_tells_no_distance() -> None:
    """Neither of this body nor of any, so that both densities are of as many distances."""
    assert BLOCK is not None
    exact, more = log_density_of_faces([felt([1, 2]), felt([1, 2], strange=True)], BLOCK, STD_M)
    assert more - exact == pytest.approx(np.log(SPURIOUS), abs=1e-3)
    few, all_ = log_density_of_any([felt([1, 2]), felt([1, 2], strange=True)])
    assert few == all_


def test_planes_are_averaged_and_their_spread_is_that_of_their_errors() -> None:
    assert BLOCK is not None
    rng = np.random.default_rng(4)
    episodes = []
    for _ in range(60):
        exact = felt([0, 1, 2, 3, 4])
        off = STD_M * rng.normal(size=(5, 1)) * exact.normals
        episodes.append(FeltFaces(exact.points_m + off, exact.normals))
    found = _averaged(BLOCK, episodes)
    assert found is not None
    normals, offset_m, std_m = found
    widths = sorted(offset_m[i] + offset_m[j] for i in range(6) for j in range(i)
                    if normals[i] @ normals[j] < -0.99)
    np.testing.assert_allclose(widths, SIZE_M, atol=0.001)
    assert std_m == pytest.approx(STD_M, rel=0.2)


@pytest.mark.parametrize(("tried", "found"), [(10, 3), (10, 10), (5, 0), (0, 0)])
def test_evidence_is_found_or_not_found(tried: int, found: int) -> None:
    share, rest = (np.exp(_log_rate(KnownObject("", {FACES: tried}, {FACES: count}, {}), FACES))
                   for count in (found, tried - found))
    assert share + rest == pytest.approx(1.0)
    assert 0.0 < share < 1.0
