"""The field of a superquadric in its own frame, elementwise over points, in JAX.

Every function takes a shape whose numbers broadcast against the points: shape [n, 1], one body for
all of them, or [n, point], a copy for each. With copies one backward pass gives the derivatives of
every point's residual by its own copy at once, which is how `slopes` is so much cheaper than a
forward pass for each parameter.

All functions are total: finite for finite arguments, with finite derivatives, since one non-finite
trial step would poison a lane for ever.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from fit.fit_status import Kind
from fit.superquadric.bend import unbend
from fit.superquadric.distance import LEAST_TAPER_FACTOR, TINY, soft_maximum, straight_distance

Rows = Any
"""Numbers of a body, or coordinates of points, a row each: an array [row, point], or a sequence."""
_ROUNDED = 0.1
"""Of the corner at no taper [est]; over 4,608 episodes 0.3 and 0.01 did as well, within errors."""


class Shape(NamedTuple):
    """What a superquadric is wherever it lies; every number has a last axis of 1 or of points."""

    size: Rows
    exponents: Rows
    taper: Rows
    bend: Rows
    """Curvature as a vector in the body's x, y plane, per unit length."""


def residual(shape: Shape, local: Rows, kind: Kind) -> Float[Array, " point"]:
    """Unweighted residual of points in the body's frame, in units of length of that frame.

    solina: sqrt(a1 a2 a3) (F^e1 - 1), whose volume factor prefers the least body that explains the
    touches (Solina and Bajcsy 1990); solina_box: the same with the body's box in place of
    a1 a2 a3, see `widening`; radial: distance along the ray from the centre; distance: that along
    the surface normal, to first order; volume_distance: the latter with the box's factor, which
    serves tapered bodies, for near the tip of a taper F^e1 grows so fast that a touch there counts
    for many.
    """
    if kind in ("solina", "solina_box"):
        log_square = jnp.clip(log_square_radius(shape, local), -30.0, 8.0)
        return _box_factor(shape, kind == "solina_box") * jnp.expm1(log_square)
    if kind == "radial":
        straight = straighten(shape, local)
        length = jnp.sqrt(sum(c**2 for c in straight) + TINY)
        return -length * jnp.expm1(-0.5 * _log_square_radius(shape, straight))
    away = distance(shape, local)
    if kind == "distance":
        return away
    return 2.0 * _box_factor(shape, True) * away


def widening(taper: Any) -> Any:
    """How much wider than the middle section a tapered body's widest one is: 1 + |taper|, rounded.

    Solina's a1 and a2 are those of the middle section. A pyramid on its tip has half the a1 and a2
    of the block on whose top all its touches lie, so that it would cost a quarter as much.
    """
    return 1.0 + (taper**2 + _ROUNDED**2) ** 0.5 - _ROUNDED


def _box_factor(shape: Shape, widest: bool):
    """Solina's sqrt(a1 a2 a3), a1 and a2 those of the middle section or of the widest."""
    a1, a2, a3 = shape.size
    volume = a1 * a2 * a3
    if widest and shape.taper is not None:
        for k in shape.taper:
            volume = volume * widening(k)
    return jnp.sqrt(volume)


def slopes(function: Callable, shape: Shape, local: Rows) -> tuple[Any, Shape, tuple]:
    """An elementwise `function(shape, local)`, its derivatives by the shape and by the point.

    The shape's own are given a point each: in its fields, rows [point].
    """
    n = local[0].shape[-1]
    spread = lambda rows: tuple(jnp.broadcast_to(row, (n,)) for row in rows)  # noqa: E731
    # Row by row: a compiler that sees a stack works every row out where it needs one of them.
    copies = Shape(*(None if rows is None else spread(rows) for rows in shape))
    value, back = jax.vjp(function, copies, spread(local))
    return value, *back(jnp.ones_like(value))


def log_square_radius(shape: Shape, local: Rows) -> Float[Array, " point"]:
    """log F^e1: twice the log of the scaled radius, 0 on the surface."""
    return _log_square_radius(shape, straighten(shape, local))


def distance(shape: Shape, local: Rows) -> Float[Array, " point"]:
    """Signed distance of points to the surface, see `superquadric_distance`.

    It is that before the bend, which turns the gradient and hardly stretches it.
    """
    unbent = local if shape.bend is None else unbend(tuple(shape.bend), tuple(local))
    taper = None if shape.taper is None else tuple(shape.taper)
    return straight_distance(tuple(shape.size), tuple(shape.exponents), taper, tuple(unbent))


def straighten(shape: Shape, local: Rows) -> list[Float[Array, " point"]]:
    """x, y, z of points in the body's frame with bend and taper undone."""
    x, y, z = local
    if shape.bend is not None:
        x, y, z = unbend(tuple(shape.bend), (x, y, z))
    if shape.taper is not None:
        along_x, along_y = _taper_factors(shape, z)
        x, y = x / along_x, y / along_y
    return [x, y, z]


def _taper_factors(shape: Shape, z: Float[Array, " point"]) -> list[Float[Array, " point"]]:
    """Width of the section at z by that of the middle one, along x and y.

    Beyond an end it stays that of the end: a section that went on to shrink would make a spike of
    small distances above a body that is too short.
    """
    height = jnp.clip(z / shape.size[2], -1.0, 1.0)
    assert shape.taper is not None
    return [jnp.maximum(1.0 + k * height, LEAST_TAPER_FACTOR) for k in shape.taper]


def _log_square_radius(shape: Shape, straight):
    """A soft maximum of soft maxima of the logs of the squared scaled coordinates."""
    x, y, z = (jnp.log((c / a) ** 2 + TINY) for c, a in zip(straight, shape.size, strict=True))
    e1, e2 = shape.exponents
    return soft_maximum(soft_maximum(x, y, e2), z, e1)
