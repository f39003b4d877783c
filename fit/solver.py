"""Levenberg-Marquardt by jaxopt: the one file that knows jaxopt, which is no longer developed.

A descent is cut into calls of so many iterations, each given where the last one stood and its
damping: a batch can then drop the lanes that are done and go on with the rest.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from fit.normal_descent import DAMPING, Descent

with warnings.catch_warnings():
    # It says on import that it is no longer developed, which is why it is pinned and kept here.
    warnings.simplefilter("ignore", DeprecationWarning)
    from jaxopt import LevenbergMarquardt

def descend(residuals: Callable, theta, damping, iterations, *data: Any) -> Descent:
    """`iterations` (a traced number) steps from `theta` for `residuals(theta, *data)`."""
    solver = LevenbergMarquardt(
        residuals,
        damping_parameter=DAMPING,
        solver="cholesky",
        materialize_jac=True,
        implicit_diff=True,
        jit=False,
        unroll=False,
    )
    state = solver.init_state(theta, *data)
    state = state._replace(
        increase_factor=jnp.asarray(2.0, theta.dtype),
        damping_factor=jnp.where(damping > 0, damping, state.damping_factor),
    )

    def step(_, carry):
        theta, state = solver.update(carry[0], carry[1], *data)
        return theta, state._replace(increase_factor=state.increase_factor.astype(theta.dtype))

    before = state.value
    theta, state = jax.lax.fori_loop(0, iterations, step, (theta, state))
    fallen = (before - state.value) / jnp.maximum(before, 1e-30)
    return Descent(theta, state.damping_factor, state.value, fallen)
