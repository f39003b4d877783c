"""Least squares by normal equations, as residuals that a solver of residuals can descend.

A problem of many residuals r(θ) whose JᵀJ, Jᵀr and cost are cheap is, for Gauss-Newton and
Levenberg-Marquardt, the same as one of few: with the Cholesky factor JᵀJ = L Lᵀ, the residuals
L⁻¹ Jᵀr with Jacobian Lᵀ have the same equations; one more residual, constant to first order, brings
the cost to its value. So jaxopt descends 14 residuals instead of some hundred.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

_LIFT = 1e-13
"""Added to the diagonal of JᵀJ, as a share of its largest element: the factor must exist."""


class Normal(NamedTuple):
    """A least-squares problem at one point."""

    matrix: Any
    """JᵀJ, shape [parameter, parameter]."""
    gradient: Any
    """Jᵀr, shape [parameter]."""
    cost: Any
    """Half the sum of squared residuals."""


def normal_residuals(normal: Callable[..., Normal]) -> Callable:
    """Residuals [parameter + 1] of `normal(theta, lane)` and their Jacobian, for `solver`."""

    def residuals(theta, lane):
        at = normal(theta, lane)
        lift = _LIFT * jnp.max(jnp.diagonal(at.matrix)) + 1e-300
        lower = jnp.linalg.cholesky(at.matrix + lift * jnp.eye(len(theta), dtype=theta.dtype))
        few = jax.scipy.linalg.solve_triangular(lower, at.gradient, lower=True)
        rest = jnp.sqrt(jnp.maximum(2.0 * at.cost - few @ few, 0.0))
        return jnp.append(few, rest), jnp.append(lower.T, jnp.zeros_like(few)[None], axis=0)

    return residuals
