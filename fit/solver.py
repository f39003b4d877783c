"""Levenberg-Marquardt by jaxopt: the one file that knows jaxopt, which is no longer developed.

The solver is advanced by a given number of iterations and hands back its whole state, so that a
batch can stop, drop the lanes that are done, and go on with the rest where it left off.
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
    """Where one descent stands; a tree of arrays, so that lanes can be gathered and scattered."""

    theta: Any
    """Parameters, shape [parameter]."""
    state: Any
    """jaxopt's own state."""
    fallen: Any
    """By how much the last call lowered the cost, as a share of the cost before it."""


def _solver(residual: Callable) -> LevenbergMarquardt:
    return LevenbergMarquardt(
        residual,
        damping_parameter=DAMPING,
        solver="cholesky",
        materialize_jac=True,
        implicit_diff=True,
        jit=False,
        unroll=False,
    )


def begin(residual: Callable, theta: jax.Array, *data: Any) -> Descent:
    """A descent at its start: residual and Jacobian of `residual(theta, *data)` evaluated once."""
    state = _solver(residual).init_state(theta, *data)
    state = state._replace(increase_factor=jnp.asarray(2.0, theta.dtype))
    return Descent(theta, state, jnp.asarray(1.0, theta.dtype))


def advance(residual: Callable, descent: Descent, iterations: int, *data: Any) -> Descent:
    """The descent `iterations` steps further on."""
    solver = _solver(residual)

    def step(_, carry):
        theta, state = solver.update(carry[0], carry[1], *data)
        return theta, state._replace(increase_factor=state.increase_factor.astype(theta.dtype))

    before = descent.state.value
    theta, state = jax.lax.fori_loop(0, iterations, step, (descent.theta, descent.state))
    fallen = (before - state.value) / jnp.maximum(before, 1e-30)
    return Descent(theta, state, fallen)
