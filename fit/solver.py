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


class _Solver(LevenbergMarquardt):
    """jaxopt's, which forgets the Jacobian it is given where it is to materialize one."""

    def __post_init__(self):
        super().__post_init__()
        self._jac_fun = self.jac_fun


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

    `residuals(theta, lane)` are those of one lane, and their Jacobian.
    """
    residual_fun, jac_fun = _evaluated_once(residuals)
    solver = _Solver(
        residual_fun,
        jac_fun=jac_fun,
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


def _evaluated_once(residuals: Callable) -> tuple[Callable, Callable]:
    """Residuals and Jacobian apart, of one evaluation a point.

    jaxopt asks three times at every point, and XLA does not see that it is the same: what is asked
    again in one tracing is the same traced value, so the answer is kept by it.
    """
    last: dict[str, Any] = {}

    def at(theta, lane):
        if last.get("theta") is not theta:
            last.update(theta=theta, found=residuals(theta, lane))
        return last["found"]

    return lambda theta, lane: at(theta, lane)[0], lambda theta, lane: at(theta, lane)[1]
