"""Levenberg-Marquardt for problems that give their normal equations, in JAX, one fit at a time.

The same damping as `solver` (Nielsen 1999: by the gain ratio), but the equations are evaluated
once a step, in one place, and the Jacobian itself is never stored.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

DAMPING = 1e-3
"""First damping, as a share of the largest diagonal element of JᵀJ."""


class Normal(NamedTuple):
    """A least-squares problem at one point."""

    matrix: Any
    """JᵀJ, shape [parameter, parameter]."""
    gradient: Any
    """Jᵀr, shape [parameter]."""
    cost: Any
    """Half the sum of squared residuals."""


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


class _State(NamedTuple):
    theta: Any
    at: Normal
    step: Any
    damping: Any
    growth: Any
    first: Any


def descend(normal: Callable, theta, damping, iterations, *data: Any) -> Descent:
    """`iterations` (a traced number) steps from `theta`; `normal(theta, *data)` is a `Normal`."""
    n = theta.shape[0]
    one = jnp.ones((), theta.dtype)
    nowhere = Normal(jnp.eye(n, dtype=theta.dtype), jnp.zeros_like(theta), jnp.inf * one)

    def round_(index, state: _State) -> _State:
        # The first round is no step: it finds out where the descent begins.
        begins = index == 0
        trial = normal(state.theta + state.step, *data)
        promised = 0.5 * state.step @ (state.damping * state.step - state.at.gradient)
        gain = (state.at.cost - trial.cost) / jnp.where(begins, 1.0, promised)
        better = trial.cost < state.at.cost
        at = jax.tree.map(lambda new, old: jnp.where(better, new, old), trial, state.at)
        theta = jnp.where(better, state.theta + state.step, state.theta)
        lower = jnp.maximum(1.0 / 3.0, 1.0 - (2.0 * jnp.minimum(gain, 10.0) - 1.0) ** 3)
        damping = state.damping * jnp.where(better, lower, state.growth)
        chosen = jnp.where(state.damping > 0.0, state.damping,
                           DAMPING * jnp.max(jnp.diagonal(at.matrix)))
        damping = jnp.where(begins, chosen, jnp.minimum(damping, 1e32))
        growth = jnp.where(better, 2.0, jnp.minimum(2.0 * state.growth, 1e32))
        damped = at.matrix + damping * jnp.eye(n, dtype=theta.dtype)
        step = -jax.scipy.linalg.solve(damped, at.gradient, assume_a="pos")
        return _State(theta, at, step, damping, growth,
                      jnp.where(begins, trial.cost, state.first))

    begin = _State(theta, nowhere, jnp.zeros_like(theta), damping, 2.0 * one, one)
    end = jax.lax.fori_loop(0, iterations + 1, round_, begin)
    fallen = (end.first - end.at.cost) / jnp.maximum(end.first, 1e-30)
    return Descent(end.theta, end.damping, end.at.cost, fallen)
