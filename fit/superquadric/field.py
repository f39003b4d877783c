"""Implicit function of a superquadric in its own frame, elementwise over points, in JAX.

The fields of a shape broadcast against the points: [n, 1] for one body, or [n, point] for a copy
per point. With copies, one backward pass gives the derivatives of each point's residual by its own
copy (`slopes`), which is much cheaper than a forward pass per parameter.

Values and derivatives are finite for finite arguments, because one non-finite trial step would
make the rest of a descent NaN.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from fit.fit_status import Kind
from fit.superquadric.distance import TINY, soft_maximum, straight_distance, unbend
from fit.superquadric.geometry import MIN_TAPER_FACTOR

Rows = Any
"""Rows of numbers: an array [row, point], or a sequence of arrays."""
_ROUNDED = 0.1
"""Rounding of the absolute value in `widening`; 0.3 and 0.01 give the same accuracy."""


class Shape(NamedTuple):
    """A superquadric without its pose; the last axis of each field is 1 or the point."""

    size: Rows
    exponents: Rows
    taper: Rows
    bend: Rows
    """Curvature vector in the body's x, y plane, per unit length."""


def residual(shape: Shape, local: Rows, kind: Kind) -> Float[Array, " point"]:
    """Unweighted residual of points in the body's frame, in units of length of that frame.

    - solina: sqrt(a1 a2 a3) (F^e1 - 1); the volume factor prefers small bodies (Solina and Bajcsy
      1990).
    - solina_box: the same with the volume of the bounding box, see `widening`.
    - radial: distance along the ray from the centre.
    - distance: distance along the surface normal, to first order.
    - volume_distance: the last with the factor of the box, for tapered bodies, since F^e1 would
      give touches near the tip of a taper too much weight.
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


KINDS: tuple[Kind, ...] = ("solina", "solina_box", "radial", "distance", "volume_distance")
"""Residuals in the order of their numbers."""


def chosen_slopes(kind, shape: Shape, local: Rows) -> tuple[Any, Shape, tuple]:
    """`slopes` of the residual with the number `kind`, which is a run-time argument.

    A program computes only the one chosen, so that one program does for all.
    """
    def of(name: Kind) -> Callable:
        return lambda shape, local: slopes(partial(residual, kind=name), shape, local)

    return jax.lax.switch(kind, [of(name) for name in KINDS], shape, local)


def chosen_residual(kind, shape: Shape, local: Rows) -> Float[Array, " point"]:
    """The residual with the number `kind`, which is a run-time argument."""
    return jax.lax.switch(kind, [partial(residual, kind=name) for name in KINDS], shape, local)


def widening(taper: Any) -> Any:
    """Width of a tapered body's widest section over that of its middle one: 1 + |taper|, rounded.

    Solina's a1 and a2 are those of the middle section. With them, an inverted pyramid through the
    touched top of a block has a quarter of the block's volume, so it would be preferred.
    """
    return 1.0 + (taper**2 + _ROUNDED**2) ** 0.5 - _ROUNDED


def _box_factor(shape: Shape, widest: bool):
    """sqrt(a1 a2 a3), with a1 and a2 of the middle or of the widest section."""
    a1, a2, a3 = shape.size
    volume = a1 * a2 * a3
    if widest and shape.taper is not None:
        for k in shape.taper:
            volume = volume * widening(k)
    return jnp.sqrt(volume)


def slopes(function: Callable, shape: Shape, local: Rows) -> tuple[Any, Shape, tuple]:
    """Value of an elementwise `function(shape, local)`, and its derivatives by shape and point.

    Derivatives by the shape are given for each point, as rows [point] of its fields.
    """
    n = local[0].shape[-1]
    spread = lambda rows: tuple(jnp.broadcast_to(row, (n,)) for row in rows)  # noqa: E731
    # Row by row: of a stack, XLA computes every row where it needs one.
    copies = Shape(*(None if rows is None else spread(rows) for rows in shape))
    value, back = jax.vjp(function, copies, spread(local))
    return value, *back(jnp.ones_like(value))


def log_square_radius(shape: Shape, local: Rows) -> Float[Array, " point"]:
    """log F^e1: twice the logarithm of the scaled radius, 0 on the surface."""
    return _log_square_radius(shape, straighten(shape, local))


def distance(shape: Shape, local: Rows) -> Float[Array, " point"]:
    """Signed distance of points to the unbent surface, see `straight_distance`.

    The bend rotates the gradient and hardly changes its length.
    """
    unbent = local if shape.bend is None else unbend(tuple(shape.bend), tuple(local))
    taper = None if shape.taper is None else tuple(shape.taper)
    return straight_distance(tuple(shape.size), tuple(shape.exponents), taper, tuple(unbent))


def straighten(shape: Shape, local: Rows) -> list[Float[Array, " point"]]:
    """x, y, z of points in the body's frame, with bend and taper inverted."""
    x, y, z = local
    if shape.bend is not None:
        x, y, z = unbend(tuple(shape.bend), (x, y, z))
    if shape.taper is not None:
        along_x, along_y = _taper_factors(shape, z)
        x, y = x / along_x, y / along_y
    return [x, y, z]


def _taper_factors(shape: Shape, z: Float[Array, " point"]) -> list[Float[Array, " point"]]:
    """Width of the section at z over that of the middle one, along x and y.

    Constant beyond the ends: an extrapolated taper would give small distances to points far above
    a body that is too short.
    """
    height = jnp.clip(z / shape.size[2], -1.0, 1.0)
    assert shape.taper is not None
    return [jnp.maximum(1.0 + k * height, MIN_TAPER_FACTOR) for k in shape.taper]


def _log_square_radius(shape: Shape, straight):
    """Nested soft maximum of the logarithms of the squared scaled coordinates."""
    x, y, z = (jnp.log((c / a) ** 2 + TINY) for c, a in zip(straight, shape.size, strict=True))
    e1, e2 = shape.exponents
    return soft_maximum(soft_maximum(x, y, e2), z, e1)
