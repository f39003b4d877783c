"""Levenberg-Marquardt by jaxopt: the one file that knows jaxopt, which is no longer developed.

A descent is cut into calls of so many iterations, each given where the last one stood and its
damping: a batch can then drop the lanes that are done and go on with the rest.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

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


def descend(equations: Callable, theta, damping, iterations, lanes: Any) -> Descent:
    """`iterations` (a traced number) steps of every lane from `theta` [lane, parameter].

    `equations(theta, lane)` are the `Normal` equations of one lane. They are in the program only
    once, for they are most of what is compiled and loaded: where a descent begins is evaluated by a
    step of its own, from a state that has it stay where it is and take whatever it finds.
    """
    solver = _solver(*_evaluated_once(equations))
    none = _Jacobian(jnp.zeros(theta.shape[1:] * 2), jnp.zeros(theta.shape[1:]))

    def step(first, begin, carry, lane):
        theta, state = carry
        # The Jacobian is only ever asked for its products, which the state has.
        theta, state = solver.update(theta, state._replace(jac=none, jt=none), lane)
        chosen = DAMPING * jnp.max(jnp.diagonal(state.jtj))
        damping = jnp.where(first, jnp.where(begin > 0, begin, chosen), state.damping_factor)
        return theta, state._replace(
            damping_factor=damping, jac=None, jt=None,
            increase_factor=jnp.asarray(state.increase_factor, theta.dtype))

    def turn(index, carry):
        at, before = carry
        moved = jax.vmap(step, (None, 0, 0, 0))(index == 0, damping, at, lanes)
        return moved, jnp.where(index == 0, moved[1].value, before)

    blank = jax.vmap(lambda theta, lane: _blank(solver, theta, lane))(theta, lanes)
    (theta, state), before = jax.lax.fori_loop(
        0, iterations + 1, turn, ((theta, blank), blank.value))
    fallen = (before - state.value) / jnp.maximum(before, 1e-30)
    return Descent(theta, state.damping_factor, state.value, fallen)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Jacobian:
    """What jaxopt takes for a Jacobian J, and for its transpose: known by its products alone."""

    matrix: Any
    gradient: Any

    @property
    def T(self) -> _Jacobian:
        return self

    def __matmul__(self, other: Any) -> Any:
        """JᵀJ with itself, Jᵀr with the residual."""
        return self.matrix if isinstance(other, _Jacobian) else self.gradient


def _evaluated_once(equations: Callable) -> tuple[Callable, Callable]:
    """One residual of the same cost, and the Jacobian, of one evaluation a point.

    jaxopt asks three times at every point, and XLA does not see that it is the same: what is asked
    again in one tracing is the same traced value, so the answer is kept by it.
    """
    last: dict[str, Any] = {}

    def at(theta, lane):
        if last.get("theta") is not theta:
            last.update(theta=theta, found=equations(theta, lane))
        return last["found"]

    return (lambda theta, lane: jnp.sqrt(2.0 * at(theta, lane).cost)[None],
            lambda theta, lane: _Jacobian(*at(theta, lane)[:2]))


def _solver(residual_fun: Callable, jac_fun: Callable) -> Any:
    """jaxopt's; imported here, for a process whose programs are kept never comes by."""
    with warnings.catch_warnings():
        # It says on import that it is no longer developed, which is why it is pinned and kept here.
        warnings.simplefilter("ignore", DeprecationWarning)
        from jaxopt import LevenbergMarquardt

    class Solver(LevenbergMarquardt):
        """Forgets no Jacobian that it is given where it is to materialize one."""

        def __post_init__(self):
            super().__post_init__()
            self._jac_fun = self.jac_fun

    return Solver(
        residual_fun,
        jac_fun=jac_fun,
        damping_parameter=DAMPING,
        solver="cholesky",
        materialize_jac=True,
        implicit_diff=True,
        jit=False,
        unroll=False,
    )


def _blank(solver: Any, theta, lane) -> Any:
    """A state whose next step d is zero and is taken: the cost falls from infinity, by a predicted
    fall of half d.(damping d - gradient), which is +0 whatever the signs of the zeros."""
    form = jax.eval_shape(solver.init_state, theta, lane)
    zeros = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), form)
    return zeros._replace(
        jtj=jnp.eye(len(theta), dtype=theta.dtype),
        increase_factor=jnp.asarray(2.0, theta.dtype),
        value=jnp.asarray(jnp.inf, theta.dtype),
        jac=None,
        jt=None,
    )


class Normal(NamedTuple):
    """A least-squares problem at one point."""

    matrix: Any
    """JᵀJ, shape [parameter, parameter]."""
    gradient: Any
    """Jᵀr, shape [parameter]."""
    cost: Any
    """Half the sum of squared residuals."""


def normal_of(residuals: Callable) -> Callable:
    """The normal equations of `residuals(theta, lane)`, differentiated forwards."""
    twice = lambda theta, lane: (residuals(theta, lane),) * 2  # noqa: E731

    def equations(theta, lane) -> Normal:
        jacobian, value = jax.jacfwd(twice, has_aux=True)(theta, lane)
        return Normal(jacobian.T @ jacobian, value @ jacobian, 0.5 * value @ value)

    return equations
