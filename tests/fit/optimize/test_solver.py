"""Descents: jaxopt's steps, and what they are spared."""

import jax
import jax.numpy as jnp
import numpy as np

from fit.optimize.solver import NormalEquations, descend


def _open(theta, lane) -> NormalEquations:
    """Residuals exp(theta_0), which falls with every step, and theta_1 - theta_2: a sum is open."""
    row = jnp.stack([jnp.array([1.0, 0.0, 0.0]) * jnp.exp(theta[0]), jnp.array([0.0, 1.0, -1.0])])
    value = jnp.stack([jnp.exp(theta[0]), theta[1] - theta[2] - lane])
    return NormalEquations(row.T @ row, row.T @ value, 0.5 * value @ value)


def test_a_descent_that_no_touch_stops_stays_finite() -> None:
    """Damping falls by a third a step: without a least one JᵀJ would have no inverse at last."""
    with jax.enable_x64(True):
        found = jax.jit(lambda theta, damping, lanes: descend(_open, theta, damping, 80, lanes))(
            jnp.zeros((1, 3)), jnp.zeros(1), jnp.full(1, 0.5))
    theta = np.asarray(found.theta)[0]
    assert np.isfinite(theta).all()
    assert theta[0] < -5.0
    assert abs(theta[1] - theta[2] - 0.5) < 1e-9
