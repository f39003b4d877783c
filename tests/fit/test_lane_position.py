"""Where a lane stands in its group changes no bit of its descent.

Compilers may unroll a loop over lanes unevenly and contract sums and products otherwise in its
rest: rounding then hangs on the neighbours, and a study on what its workers ran together.
"""

import numpy as np
import pytest

from fit.batch import GROUP, take
from fit.descent import advance
from fit.prepare import prepare
from fit.revolution import RevolutionOptions
from fit.revolution import _problem as revolution_problem
from fit.revolution_model import Lane
from fit.superquadric_body import Form
from fit.superquadric_descent import _problem, begin_starts
from fit.superquadric_record import SuperquadricOptions

SETS = 64


def touches() -> np.ndarray:
    """Rough boxes on a table, [set, 24, 3] in metres."""
    rng = np.random.default_rng(6)
    points = rng.uniform(-1.0, 1.0, (SETS, 24, 3))
    face = rng.integers(3, size=(SETS, 24, 1))
    np.put_along_axis(points, face, np.sign(np.take_along_axis(points, face, 2)), 2)
    size = rng.uniform(0.02, 0.06, (SETS, 1, 3))
    return points * size + size * [0.0, 0.0, 1.0] + 2e-3 * rng.normal(size=points.shape)


def descents_of_rolled_groups(problem, theta, lanes, iterations: int):
    yield advance(problem, theta, lanes, iterations)
    order = np.arange(len(theta)).reshape(-1, GROUP)
    for places in (1, 5, 8, 12):
        rows = np.roll(order, places, axis=1).ravel()
        found = advance(problem, theta[rows], take(lanes, rows), iterations)
        yield take(found, np.argsort(rows))


@pytest.mark.parametrize("residual", ["solina", "radial", "volume_distance"])
def test_superquadrics(residual) -> None:
    form = Form(True, False, residual, "cauchy")
    rng = np.random.default_rng(7)
    balls = rng.normal(size=(SETS, 24, 3))
    balls *= 0.09 / np.linalg.norm(balls, axis=2, keepdims=True)
    points = touches()
    _, sets = next(prepare(points, None, table_z=0.0, free_points=balls,
                           free_radius=0.008).buckets())
    lanes, theta = begin_starts(sets, form, SuperquadricOptions(
        taper=True, loss="cauchy", upright_std_rad=0.02))
    for iterations in (0, 3):
        first, *others = descents_of_rolled_groups(
            _problem(form), theta.reshape(-1, theta.shape[-1]), lanes, iterations)
        for other in others:
            assert np.array_equal(other.theta, first.theta)
            assert np.array_equal(other.cost, first.cost)


def test_surfaces_of_revolution() -> None:
    options = RevolutionOptions(nodes=10, upright=True)
    _, sets = next(prepare(touches(), None, table_z=0.0).buckets())
    theta = np.zeros((SETS, 16))
    theta[:, 4:6] = [-1.0, 1.0]
    weight = sets.mask / np.sqrt(sets.count)[:, None]
    plane = np.concatenate([sets.plane, np.ones((SETS, 1))], axis=1)
    lanes = Lane(np.moveaxis(sets.points, 2, 1).copy(), weight, np.tile(np.eye(3), (SETS, 1, 1)),
                 0.1 / np.sqrt(sets.count), plane)
    first, *others = descents_of_rolled_groups(revolution_problem(options), theta, lanes, 8)
    for other in others:
        assert np.array_equal(other.theta, first.theta)
