"""The normal equations of a surface of revolution against differences of its residuals."""

import jax
import numpy as np
import pytest

from fit.revolution_model import Lane, normal_equations, residuals
from fit.revolution_record import RevolutionOptions
from fit.rotation import matrix_of_quaternion

PLAIN = RevolutionOptions(nodes=6, loss="none")
FALLING = RevolutionOptions(nodes=9, monotone="falling")


@pytest.mark.parametrize("options", [PLAIN, FALLING], ids=["plain", "falling"])
def test_normal_equations_are_those_of_the_residuals(options: RevolutionOptions) -> None:
    rng = np.random.default_rng(3)
    q = rng.normal(size=4)
    lane = Lane(rng.normal(size=(3, 40)), rng.random(40),
                matrix_of_quaternion(q / np.linalg.norm(q)), np.float64(0.3),
                np.array([0.1, 0.2, -0.97, 0.6, 0.5]))
    radii = 0.4 + 0.3 * rng.random(options.nodes)
    theta = np.concatenate([0.3 * rng.normal(size=4), [-0.8, 0.7], np.log(radii)])
    count, step = len(theta), 1e-6
    with jax.enable_x64(True):
        steps = step * np.concatenate([0 * theta[None], np.eye(count), -np.eye(count)])
        found, values = jax.device_get(jax.jit(lambda at: (
            normal_equations(at[0], lane, options),
            jax.vmap(lambda t: residuals(t, lane, options))(at)))(theta + steps))
    r, up, down = values[0], values[1 : count + 1], values[count + 1 :]
    j = (up - down).T / (2 * step)
    assert found.cost == pytest.approx(0.5 * r @ r, rel=1e-12)
    assert np.allclose(found.gradient, j.T @ r, rtol=1e-6, atol=1e-8)
    assert np.allclose(found.matrix, j.T @ j, rtol=1e-6, atol=1e-8)
