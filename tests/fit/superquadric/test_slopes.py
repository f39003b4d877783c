"""Derivatives of the scaled radius, against differences of the inside-outside function."""

import numpy as np
import pytest

from fit.superquadric.geometry import Superquadric, superquadric_inside_outside
from fit.superquadric.slopes import TANGENT, displaced, radius_slopes

STEP = 1e-6


def bodies(bend: list[float]) -> Superquadric:
    rng = np.random.default_rng(2)
    n = len(bend)
    q = rng.normal(size=(n, 4))
    return Superquadric(rng.uniform(0.02, 0.06, (n, 3)), rng.uniform(0.2, 1.5, (n, 2)),
                        rng.normal(0, 0.05, (n, 3)),
                        q / np.linalg.norm(q, axis=1, keepdims=True),
                        rng.uniform(-0.7, 0.7, (n, 2)),
                        np.stack([bend, rng.uniform(-3, 3, n)], 1))


@pytest.mark.parametrize("bend", [[0.0] * 12, [0.0, 4.0] * 6])
def test_slopes_are_differences_along_each_coordinate(bend: list[float]) -> None:
    body = bodies(bend)
    points = body.position_m[:, None] + np.random.default_rng(3).normal(0, 0.05, (12, 40, 3))
    radius, slopes = radius_slopes(body, points)
    assert np.array_equal(radius, superquadric_inside_outside(body, points))
    for k, name in enumerate(TANGENT):
        step = np.zeros((12, 15))
        step[:, k] = STEP * (0.03 if name.startswith("p") else 1.0)
        up, down = (superquadric_inside_outside(displaced(body, sign * step), points)
                    for sign in (1, -1))
        expected = (up - down) / (2 * step[:, None, k])
        # At a bend of none its direction has no derivative: differences across it have.
        scale = np.abs(expected).max() + 1e-3
        assert np.allclose(slopes[..., k], expected, rtol=1e-4, atol=1e-6 * scale), name


def test_rows_do_not_depend_on_those_beside_them() -> None:
    body = bodies([0.0, 4.0, 0.0, 0.0])
    points = np.random.default_rng(3).normal(0, 0.05, (4, 40, 3))
    whole = radius_slopes(body, points)[1]
    alone = radius_slopes(Superquadric(*(field[2:3] for field in body)), points[2:3])[1]
    assert np.array_equal(whole[2:3], alone)
