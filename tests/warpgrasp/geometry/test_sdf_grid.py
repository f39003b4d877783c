"""Grids of distances beside SciPy's B-splines, and beyond their nodes beside a ball's distance."""

import numpy as np
import pytest
from scipy.interpolate import BSpline

from warpgrasp.geometry.body import Body, Part, distances_of
from warpgrasp.geometry.scene import Shape
from warpgrasp.objects.grid_baking import baked_body

CELL_M = 0.004


def basis(count: int, places: np.ndarray, slope: bool = False) -> np.ndarray:
    """What each of `count` nodes' quadratic splines is at places in cells, (place, node)."""
    knots = np.arange(count + 3.0) - 1.5
    spline = BSpline(knots, np.eye(count), 2)
    return (spline.derivative() if slope else spline)(places)


def test_a_grid_is_the_quadratic_spline_of_its_nodes_with_its_gradient() -> None:
    rng = np.random.default_rng(3)
    count, origin = (5, 6, 7), np.array([-0.01, 0.02, 0.005])
    nodes = rng.uniform(0.001, 0.002, count).astype(np.float32)
    high = origin + CELL_M * (np.array(count) - 1)
    part = Part(Shape.GRID, grid_m=nodes, grid_cell_m=CELL_M,
                grid_origin_m=(origin[0], origin[1], origin[2]))
    places = rng.uniform(0.5, np.array(count) - 1.5, (400, 3))
    body = Body("grid", (part,), (origin[0], origin[1], origin[2]), (high[0], high[1], high[2]))
    distance, gradient = distances_of(body)(origin + CELL_M * places)
    plain = [basis(n, places[:, k]) for k, n in enumerate(count)]
    np.testing.assert_allclose(distance, np.einsum("px,py,pz,xyz->p", *plain, nodes), rtol=1e-9)
    for axis in range(3):
        turned = list(plain)
        turned[axis] = basis(count[axis], places[:, axis], slope=True)
        np.testing.assert_allclose(
            gradient[:, axis], np.einsum("px,py,pz,xyz->p", *turned, nodes) / CELL_M, atol=1e-9)


@pytest.mark.parametrize("away_m", [0.03, 0.1, 0.4])
def test_beyond_the_nodes_is_a_lower_bound_with_its_gradient(away_m: float) -> None:
    middle, radius = np.array([0.0, 0.0, 0.03]), 0.03
    body = baked_body(middle - radius, middle + radius,
                      lambda points: np.linalg.norm(points - middle, axis=1) - radius, 40)
    way = np.random.default_rng(5).normal(size=(500, 3))
    points = middle + (radius + away_m) * way / np.linalg.norm(way, axis=1, keepdims=True)
    ask = distances_of(body)
    bound, gradient = ask(points)
    assert (bound <= away_m + body.grid_error_m).all()
    assert (bound > 0.5 * away_m).all()
    step = 1e-6
    for axis in range(3):
        ahead, behind = (ask(points + sign * step * np.eye(3)[axis])[0] for sign in (1, -1))
        np.testing.assert_allclose(gradient[:, axis], (ahead - behind) / (2 * step), atol=1e-5)
