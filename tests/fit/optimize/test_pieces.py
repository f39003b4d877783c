"""Points in pieces: sums over them, and programs that do for any number of points."""

import jax
import numpy as np
import pytest

from fit.optimize import batch
from fit.optimize.batch import GROUP, map_lanes
from fit.optimize.pieces import PIECE, SLOTS, divided, sum_of_pieces, undivided
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.record import SuperquadricOptions


def second_moments(offset, slots, span):
    """Sum of products of the coordinates of points about `offset`."""
    return sum_of_pieces(
        lambda at: ((at["x"] - offset[:, None]) * at["w"]) @ (at["x"] - offset[:, None]).T,
        slots, span)


_MOMENTS = jax.vmap(second_moments, in_axes=(0, 0, None))


@pytest.mark.parametrize("points", [1, PIECE, PIECE + 1, 5 * PIECE - 3, (SLOTS + 2) * PIECE])
@pytest.mark.parametrize("lanes", [1, GROUP + 3, 3 * GROUP])
def test_sums_over_pieces_are_those_over_all_points(points: int, lanes: int) -> None:
    rng = np.random.default_rng(points)
    x, offset, w = (rng.normal(size=shape) for shape in (
        (lanes, 3, points), (lanes, 3), (lanes, points)))
    found = map_lanes(_MOMENTS, offset, by_point={"x": x, "w": w})
    away = x - offset[..., None]
    assert np.allclose(found, np.einsum("lip,lp,ljp->lij", away, w, away), rtol=1e-12, atol=1e-11)


def test_division_is_undone() -> None:
    values = np.arange(2 * 3 * 70.0).reshape(2, 3, 70)
    parts = divided(values)
    assert parts.shape == (2, 3, 3, PIECE)  # lane, piece, coordinate, point
    assert np.array_equal(parts[1, 2, 0, :6], values[1, 0, 64:])
    assert np.array_equal(undivided(parts, 70), values)


def test_one_program_fits_any_number_of_points_by_any_residual() -> None:
    rng = np.random.default_rng(3)
    sphere = rng.normal(size=(1, 200, 3))
    sphere *= 0.04 / np.linalg.norm(sphere, axis=2, keepdims=True)
    before = set(batch._programs)
    for residual in ("solina", "radial", "distance"):
        for points in (20, 50, 200):
            fit = fit_superquadric(sphere[:, :points], options=SuperquadricOptions(
                residual=residual, loss="none"))  # pyright: ignore
            assert np.allclose(fit.size_m, 0.04, atol=2e-3)
    assert len(set(batch._programs) - before) <= 2
