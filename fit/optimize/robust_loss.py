"""Robust losses as residuals: reshaped so that half the square is the loss."""

from __future__ import annotations

import jax.numpy as jnp

from fit.fit_status import Loss


def robust(r, scale, loss: Loss):
    """r reshaped so that half its square is the robust loss of r: still plain least squares.

    Elementwise; `scale` is where the loss begins to bend, in the units of r.
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
