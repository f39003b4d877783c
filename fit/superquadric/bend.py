"""The bend undone, in JAX, elementwise over points, with its derivatives by hand.

A bend lays the body's z axis on a circle of curvature k (Solina and Bajcsy 1990). In polar
coordinates about the circle's centre it is undone by an angle and a radius; written so that
nothing is divided by k, with the curvature a vector b in the body's x, y plane,

    t = b . (x, y),   w = 1 - t,   rho^2 = w^2 + k^2 z^2,   shift = z^2 / (rho + w),

    (x, y) -> (x, y) - b shift,     z -> arctan(k z / w) / k.

Derived by a compiler the same numbers are worked out many times over, one fit's slowest part.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from fit.optimize.xla_flags import storing

Row = Float[Array, " point"]

LEAST_AHEAD = 0.1
"""w stays above it: beyond the circle's centre, where no body reaches, the map would fold."""
SMALL = 1e-4
"""(k z / w)^2 below which the arctangent is a series."""


@jax.custom_vjp
def unbend(bend: Sequence[Row], local: Sequence[Row]) -> tuple[Row, ...]:
    """Points of the bent body's frame, x, y and z, where they were before the bend.

    Both sequences are lists or tuples; the numbers broadcast against the points.
    """
    return _forward(bend, local)[0]


def _forward(bend, local):
    x, y, z = local
    bx, by = bend
    square = bx**2 + by**2
    ahead = 1.0 - (bx * x + by * y)
    w = jnp.maximum(ahead, LEAST_AHEAD)
    slant = z / w
    q = square * slant**2
    root = jnp.sqrt(1.0 + q)
    rho = w * root
    shift = z * slant / (1.0 + root)
    # arctan(u)/u and its derivative by u^2, both smooth through zero.
    small = q < SMALL
    safe = jnp.where(small, 1.0, q)
    u = jnp.sqrt(safe)
    ratio = jnp.where(small, 1.0 - q * (1.0 / 3.0 - q * (0.2 - q / 7.0)), jnp.arctan(u) / u)
    series = -1.0 / 3.0 + q * (0.4 - q * (3.0 / 7.0))
    by_q = jnp.where(small, series, 0.5 * (1.0 / (1.0 + safe) - ratio) / safe)
    rise = slant * ratio
    stored = storing(z)
    shift, rise = stored(shift), stored(rise)
    straight = (x - bx * shift, y - by * shift, rise)
    return straight, (bend, local, ahead > LEAST_AHEAD, 1.0 / rho, w, shift, slant**3 * by_q)


def _backward(kept, cotangent):
    (bx, by), (x, y, z), free, inverse, w, shift, rise_by_square = kept
    stored = storing(z)
    cx, cy, cz = (stored(c) for c in cotangent)
    of_shift = stored(-(cx * bx + cy * by))
    up = cz * inverse
    # By t, by z, and by the square of the curvature.
    of_turn = stored(jnp.where(free, (of_shift * shift + up * z) * inverse, 0.0))
    of_z = (of_shift * z + up * w) * inverse
    of_square = stored(cz * rise_by_square - 0.5 * of_shift * shift**2 * inverse)
    by_bend = (of_turn * x + 2.0 * of_square * bx - cx * shift,
               of_turn * y + 2.0 * of_square * by - cy * shift)
    return by_bend, (cx + of_turn * bx, cy + of_turn * by, of_z)


unbend.defvjp(_forward, _backward)
