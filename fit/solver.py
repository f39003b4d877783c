"""Levenberg-Marquardt by jaxopt: the one file that knows jaxopt, which is no longer developed.

A descent is cut into calls of so many iterations, each given where the last one stood and its
damping: a batch can then drop the lanes that are done and go on with the rest.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

with warnings.catch_warnings():
    # It says on import that it is no longer developed, which is why it is pinned and kept here.
    warnings.simplefilter("ignore", DeprecationWarning)
    from jaxopt import LevenbergMarquardt


DAMPING = 1e-3
"""First damping, as a share of the largest diagonal element of JᵀJ."""


class Descent(NamedTuple):
    """Where one descent stands."""

    theta: Any
    """Parameters, shape [parameter]."""
    damping: Any
    """Damping to go on with; 0 to choose one."""
    cost: Any
    """Half the sum of squared residuals."""
    fallen: Any
    """By how much the last call lowered the cost, as a share of the cost before it."""


def descend(residuals: Callable, theta, damping, iterations, lanes: Any) -> Descent:
    """`iterations` (a traced number) steps of every lane from `theta` [lane, parameter].

    `residuals(theta, lane)` are those of one lane.
    """
    solver = LevenbergMarquardt(
        residuals,
        damping_parameter=DAMPING,
        solver="cholesky",
        materialize_jac=True,
        implicit_diff=True,
        jit=False,
        unroll=False,
    )

    def begin(theta, damping, lane):
        state = solver.init_state(theta, lane)
        return state._replace(
            increase_factor=jnp.asarray(2.0, theta.dtype),
            damping_factor=jnp.where(damping > 0, damping, state.damping_factor),
        )

    def step(carry, lane):
        theta, state = solver.update(*carry, lane)
        return theta, state._replace(increase_factor=state.increase_factor.astype(theta.dtype))

    state = jax.vmap(begin)(theta, damping, lanes)
    before = state.value
    theta, state = jax.lax.fori_loop(
        0, iterations, lambda _, carry: jax.vmap(step)(carry, lanes), (theta, state))
    fallen = (before - state.value) / jnp.maximum(before, 1e-30)
    return Descent(theta, state.damping_factor, state.value, fallen)
