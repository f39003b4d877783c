"""A surface of revolution's normal equations against differences, its distances against NumPy's."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from kept_program import call_kept

from fit.revolution.geometry import RevolutionBody, revolution_distance
from fit.revolution.record import RevolutionOptions
from fit.revolution.residuals import FitData, nearest_of_contour, normal_equations, residuals
from fit.rotation import matrix_of_quaternion

PLAIN = RevolutionOptions(nodes=6, loss="none")
FALLING = RevolutionOptions(nodes=9, monotone="falling")


def equations_and_residuals(at, data: FitData, form: RevolutionOptions):
    """The normal equations of the first row of `at`, and the residuals of all rows."""
    return (normal_equations(at[0], data, form),
            jax.vmap(lambda theta: residuals(theta, data, form))(at))


@pytest.mark.parametrize("options", [PLAIN, FALLING], ids=["plain", "falling"])
def test_normal_equations_are_those_of_the_residuals(options: RevolutionOptions) -> None:
    rng = np.random.default_rng(3)
    q = rng.normal(size=4)
    lane = FitData(rng.normal(size=(3, 40)), rng.random(40),
                matrix_of_quaternion(q / np.linalg.norm(q)), np.asarray(0.3),
                np.array([0.1, 0.2, -0.97, 0.6, 0.5]), np.asarray(0.02),
                np.array([0.1, -0.2, 0.3]))
    radii = 0.4 + 0.3 * rng.random(options.nodes)
    theta = np.concatenate([0.3 * rng.normal(size=4), [-0.8, 0.7], np.log(radii)])
    count, step = len(theta), 1e-6
    steps = step * np.concatenate([0 * theta[None], np.eye(count), -np.eye(count)])
    found, values = call_kept(equations_and_residuals, theta + steps, lane, form=options)
    r, up, down = values[0], values[1 : count + 1], values[count + 1 :]
    j = (up - down).T / (2 * step)
    assert found.cost == pytest.approx(0.5 * r @ r, rel=1e-12)
    assert np.allclose(found.gradient, j.T @ r, rtol=1e-6, atol=1e-8)
    assert np.allclose(found.matrix, j.T @ j, rtol=1e-6, atol=1e-8)


def test_distances_are_those_of_the_numpy_body() -> None:
    rng = np.random.default_rng(5)
    points = rng.uniform((-0.8, -0.8, -0.3), (0.8, 0.8, 1.6), (400, 3))
    radius = 0.2 + 0.5 * rng.random(7)
    body = RevolutionBody(np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]),
                          np.linspace(0.0, 1.3, 7)[None], radius[None])
    s, rho = points[:, 2], np.hypot(points[:, 0], points[:, 1])
    with jax.enable_x64(True):
        found = jax.device_get(jax.jit(nearest_of_contour)(
            np.asarray(1.3), jnp.asarray(radius), s, rho))
    assert np.allclose(np.abs(found.distance), revolution_distance(body, points[None])[0],
                       atol=1e-12)
    inside = (s > 0.0) & (s < 1.3) & (rho < np.interp(s, body.height_m[0], radius))
    assert 20 < inside.sum() < 380
    assert np.array_equal(found.distance < 0.0, inside)
