"""A least-squares problem by its normal equations: all that Levenberg and Marquardt need of it.

Residuals r(theta) with Jacobian J may be many; JᵀJ, Jᵀr and half the sum of squares are few.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax


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
