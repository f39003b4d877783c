"""Where a lane stands in its group changes no bit of its descent.

Compilers may unroll a loop over lanes unevenly and contract sums and products otherwise in its
rest: rounding then depends on the neighbours, and a study on what its workers ran together.
"""

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
import pytest

from fit.optimize.batch import GROUP
from fit.revolution.fit import fit_revolution
from fit.revolution.record import RevolutionOptions
from fit.superquadric.fit import fit_superquadric
from fit.superquadric.record import SuperquadricOptions

SETS = 64


def touches() -> np.ndarray:
    """Rough boxes on a table, [set, 24, 3] in metres."""
    rng = np.random.default_rng(6)
    points = rng.uniform(-1.0, 1.0, (SETS, 24, 3))
    face = rng.integers(3, size=(SETS, 24, 1))
    np.put_along_axis(points, face, np.sign(np.take_along_axis(points, face, 2)), 2)
    size = rng.uniform(0.02, 0.06, (SETS, 1, 3))
    return points * size + size * [0.0, 0.0, 1.0] + 2e-3 * rng.normal(size=points.shape)


def assert_bits_hang_on_no_place(fit: Callable[[np.ndarray], Any]) -> None:
    """`fit` of sets [row] gives each the same bits wherever it stands in its group."""
    first = fit(np.arange(SETS))
    for places in (1, 5, 8, 12):
        rows = np.roll(np.arange(SETS).reshape(-1, GROUP), places, axis=1).ravel()
        other = fit(rows)
        for field in fields(first):
            assert np.array_equal(getattr(other, field.name), getattr(first, field.name)[rows],
                                  equal_nan=field.name != "status"), field.name


@pytest.mark.parametrize("residual", ["solina", "solina_box", "radial", "volume_distance"])
def test_superquadrics(residual) -> None:
    rng = np.random.default_rng(7)
    balls = rng.normal(size=(SETS, 24, 3))
    balls *= 0.09 / np.linalg.norm(balls, axis=2, keepdims=True)
    points = touches()
    options = SuperquadricOptions(taper=True, loss="cauchy", residual=residual,
                                  upright_std_rad=0.02, iterations=0)
    assert_bits_hang_on_no_place(lambda rows: fit_superquadric(
        points[rows], table_z=0.0, free_points=balls[rows], free_radius=0.008, options=options))


def test_surfaces_of_revolution() -> None:
    points = touches()
    options = RevolutionOptions(nodes=10, upright=True)
    assert_bits_hang_on_no_place(
        lambda rows: fit_revolution(points[rows], table_z=0.0, options=options))
