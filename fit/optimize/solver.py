"""Levenberg-Marquardt by jaxopt, the only file that imports it, and robust losses.

A descent is divided into calls of a few iterations; each starts from the parameters and damping of
the last, so that a batch can drop the lanes that are done.
"""

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from fit.fit_status import Loss

DAMPING = 1e-3
"""Initial damping, as a fraction of the largest diagonal element of JᵀJ."""

LEAST_DAMPING = 1e-12
"""The least damping, as such a fraction: where touches leave a parameter open JᵀJ has no inverse,
and jaxopt multiplies a step that it rejects by zero, which leaves NaN."""


class Descent(NamedTuple):
    """State of one descent between calls."""

    theta: Any
    """Parameters, shape [parameter]."""
    damping: Any
    """Damping to resume with."""
    cost: Any
    """Half the sum of squared residuals."""
    decrease: Any
    """Relative decrease of the cost in the last call."""


def descend(equations: Callable, theta, damping, iterations, lanes: Any) -> Descent:
    """Descend `iterations` (a traced number) steps in every lane from `theta` [lane, parameter].

    `equations(theta, lane)` returns the `NormalEquations` of one lane. Damping 0 chooses one. The
    equations are most of the program, so it contains them once: an extra first step evaluates the
    initial point, from a state for which that step has zero length and is accepted.
    """
    solver = _solver(*_evaluated_once(equations))
    none = _Jacobian(jnp.zeros(theta.shape[1:] * 2), jnp.zeros(theta.shape[1:]))

    def step(first, begin, carry, lane):
        theta, state = carry
        # Only products of the Jacobian are used, and the state holds them.
        theta, state = solver.update(theta, state._replace(jac=none, jt=none), lane)
        largest = jnp.max(jnp.diagonal(state.jtj))
        damping = jnp.where(first, jnp.where(begin > 0, begin, DAMPING * largest),
                            state.damping_factor)
        damping = jnp.maximum(damping, LEAST_DAMPING * largest)
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
    decrease = (before - state.value) / jnp.maximum(before, 1e-30)
    return Descent(theta, state.damping_factor, state.value, decrease)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _Jacobian:
    """Stands for the Jacobian J and its transpose in jaxopt; knows only their products."""

    matrix: Any
    gradient: Any

    @property
    def T(self) -> "_Jacobian":
        return self

    def __matmul__(self, other: Any) -> Any:
        """JᵀJ for J, Jᵀr for the residual."""
        return self.matrix if isinstance(other, _Jacobian) else self.gradient


def _evaluated_once(equations: Callable) -> tuple[Callable, Callable]:
    """A scalar residual of the same cost, and the Jacobian, from one evaluation per point.

    jaxopt evaluates three times at every point, which XLA does not merge. Within one tracing the
    point is the same traced value, so the last evaluation is kept with it.
    """
    last: dict[str, Any] = {}

    def at(theta, lane):
        if last.get("theta") is not theta:
            last.update(theta=theta, found=equations(theta, lane))
        return last["found"]

    return (lambda theta, lane: jnp.sqrt(2.0 * at(theta, lane).cost)[None],
            lambda theta, lane: _Jacobian(*at(theta, lane)[:2]))


def _solver(residual_fun: Callable, jac_fun: Callable) -> Any:
    """jaxopt's solver, imported here because a process with cached programs does not need it."""
    with warnings.catch_warnings():
        # jaxopt warns that it is no longer developed; its version is pinned.
        warnings.simplefilter("ignore", DeprecationWarning)
        from jaxopt import LevenbergMarquardt

    solver: Any = LevenbergMarquardt(
        residual_fun,
        jac_fun=jac_fun,
        damping_parameter=DAMPING,
        solver="cholesky",
        materialize_jac=True,
        implicit_diff=True,
        jit=False,
        unroll=False,
    )
    solver._jac_fun = jac_fun  # jaxopt ignores it where it is to materialize the Jacobian
    return solver


def _blank(solver: Any, theta, lane) -> Any:
    """A state whose next step d is zero and is accepted: the cost decreases from infinity, and the
    predicted decrease, half d.(damping d - gradient), is +0 for any signs of the zeros."""
    form = jax.eval_shape(solver.init_state, theta, lane)
    zeros = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), form)
    return zeros._replace(
        jtj=jnp.eye(len(theta), dtype=theta.dtype),
        increase_factor=jnp.asarray(2.0, theta.dtype),
        value=jnp.asarray(jnp.inf, theta.dtype),
        jac=None,
        jt=None,
    )


class NormalEquations(NamedTuple):
    """The normal equations of a least-squares problem at one point."""

    matrix: Any
    """JᵀJ, shape [parameter, parameter]."""
    gradient: Any
    """Jᵀr, shape [parameter]."""
    cost: Any
    """Half the sum of squared residuals."""


def normal_equations_of(residuals: Callable) -> Callable:
    """The normal equations of `residuals(theta, lane)`, by forward differentiation."""
    twice = lambda theta, lane: (residuals(theta, lane),) * 2  # noqa: E731

    def equations(theta, lane) -> NormalEquations:
        jacobian, value = jax.jacfwd(twice, has_aux=True)(theta, lane)
        return NormalEquations(jacobian.T @ jacobian, value @ jacobian, 0.5 * value @ value)

    return equations


def robust(r, scale, loss: Loss):
    """r transformed so that half its square is the robust loss of r, elementwise.

    `scale`, in the units of r, is where the loss departs from the square.
    """
    if loss == "none":
        return r
    z = (r / scale) ** 2
    if loss == "geman_mcclure":
        return r / jnp.sqrt(1.0 + z)
    small = z < 1e-6
    safe = jnp.where(small, 1.0, z)
    if loss == "cauchy":
        ratio = jnp.log1p(safe) / safe
        return r * jnp.sqrt(jnp.where(small, 1.0 - 0.5 * z, ratio))
    ratio = 2.0 * (jnp.sqrt(1.0 + safe) - 1.0) / safe
    return r * jnp.sqrt(jnp.where(small, 1.0 - 0.25 * z, ratio))
