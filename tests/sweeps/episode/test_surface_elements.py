"""Surface elements of kernels against those of `fit.superquadric.superquadric_surface`."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from fit.superquadric.geometry import superquadric, superquadric_surface
from sweeps.episode.surface_elements import surface_elements


@pytest.mark.parametrize("bend", [0.0, 5.0])
def test_elements_are_those_of_the_geometry(bend: float) -> None:
    rng = np.random.default_rng(5)
    n = 30
    turn = rng.normal(size=(n, 4))
    body = superquadric(
        rng.uniform(0.01, 0.08, (n, 3)), rng.uniform(0.1, 1.9, (n, 2)),
        rng.normal(0.0, 0.05, (n, 3)), turn / np.linalg.norm(turn, axis=1, keepdims=True),
        rng.uniform(-0.9, 0.9, (n, 2)), (bend, 0.7))
    point, normal, area = surface_elements(body, 500, device="cpu", graded=False)
    order = np.array([cKDTree(a).query(b)[1] for a, b in zip(
        superquadric_surface(body, 500)[0], point, strict=True)])  # these come tile by tile
    assert (np.sort(order, axis=1) == np.arange(order.shape[1])).all()
    points, normals, areas = (
        np.stack([rows[w][order[w]] for w in range(n)]) for rows in superquadric_surface(body, 500))
    assert np.allclose(point, points, rtol=0, atol=1e-14)
    assert np.allclose(area, areas, rtol=1e-9)
    # Where a taper ends within the step of a difference, the difference is no slope.
    assert np.quantile(np.abs(normal - normals), 0.999) < 1e-7
    assert np.abs(normal - normals).max() < 1e-3
    assert np.allclose(np.linalg.norm(normal, axis=-1), 1.0)
