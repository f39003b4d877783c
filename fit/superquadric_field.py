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
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

TINY = 1e-12
"""Added to squared scaled coordinates: moves a surface by less than a micrometre."""
LEAST_TAPER_FACTOR = 0.02

Kind = Literal["solina", "radial", "distance", "volume_distance"]


class Shape(NamedTuple):
    """What a superquadric is wherever it lies; every number has a last axis of 1 or of points."""

    size: Float[Array, "3 point"]
    exponents: Float[Array, "2 point"]
    taper: Float[Array, "2 point"] | None
    bend: Float[Array, "2 point"] | None
    """Curvature as a vector in the body's x, y plane, per unit length."""


def residual(shape: Shape, local: Float[Array, "3 point"], kind: Kind) -> Float[Array, " point"]:
    """Unweighted residual of points in the body's frame, in units of length of that frame.

    solina: sqrt(a1 a2 a3) (F^e1 - 1), whose volume factor prefers the least body that explains the
    touches (Solina and Bajcsy 1990); radial: distance along the ray from the centre;
    distance: that along the surface normal, to first order; volume_distance: the latter with
    Solina's volume factor, which serves tapered bodies, for near the tip of a taper F^e1 grows so
    fast that a touch there counts for many.
    """
    if kind == "solina":
        log_square = jnp.clip(log_square_radius(shape, local), -30.0, 8.0)
        return jnp.sqrt(jnp.prod(shape.size, axis=0)) * jnp.expm1(log_square)
    if kind == "radial":
        straight = straighten(shape, local)
        length = jnp.sqrt(jnp.sum(straight**2, axis=0) + TINY)
        return -length * jnp.expm1(-0.5 * _log_square_radius(shape, straight))
    away = distance(shape, local)
    if kind == "distance":
        return away
    return 2.0 * jnp.sqrt(jnp.prod(shape.size, axis=0)) * away


def slopes(
    function: Callable, shape: Shape, local: Float[Array, "3 point"]
) -> tuple[Float[Array, " point"], Shape, Float[Array, "3 point"]]:
    """An elementwise `function(shape, local)`, its derivatives by the shape and by the point.

    The shape's own are given a point each: fields [n, point].
    """
    copies = jax.tree.map(lambda v: jnp.broadcast_to(v, (len(v), local.shape[1])), shape)
    value, back = jax.vjp(function, copies, local)
    return (value, *back(jnp.ones_like(value)))


def log_square_radius(shape: Shape, local: Float[Array, "3 point"]) -> Float[Array, " point"]:
    """log F^e1: twice the log of the scaled radius, 0 on the surface."""
    return _log_square_radius(shape, straighten(shape, local))


def distance(shape: Shape, local: Float[Array, "3 point"]) -> Float[Array, " point"]:
    """Signed distance of points to the surface: the larger of two bounds from below.

    One is (beta - 1)/|grad beta|, beta the scaled radius, which without taper is convex for
    exponents up to 2. It is exact to first order at the surface, but deep in a thin body it looks
    to the end and not to the nearer side. The other is the distance to the box around the body
    (with taper a frustum's): the larger of the signed distances to its faces. The gradient is that
    before the bend, which turns it and hardly stretches it.
    """
    straight = straighten(shape, local)
    log_square, shares = _log_f_e1(_logs(shape, straight), shape.exponents)
    x, y, z = straight
    a1, a2, a3 = shape.size
    gx, gy, gz = (share * c / (c**2 + TINY * a**2)
                  for share, c, a in zip(shares, straight, shape.size, strict=True))
    past_x, past_y, past_z = jnp.abs(x) - a1, jnp.abs(y) - a2, jnp.abs(z) - a3
    if shape.taper is not None:
        factors = _taper_factors(shape, z)
        tapers = (factors > LEAST_TAPER_FACTOR) & (past_z < 0.0)
        kx, ky = jnp.where(tapers, shape.taper, 0.0)
        fx, fy = factors
        gx, gy = gx / fx, gy / fy
        gz = gz - (gx * x * kx + gy * y * ky) / a3
        past_x = past_x * fx / jnp.sqrt(1.0 + (kx * a1 / a3) ** 2)
        past_y = past_y * fy / jnp.sqrt(1.0 + (ky * a2 / a3) ** 2)
    slope = jnp.sqrt(gx**2 + gy**2 + gz**2 + TINY)
    first_order = -jnp.expm1(-0.5 * jnp.clip(log_square, -8.0, 30.0)) / slope
    return jnp.maximum(first_order, jnp.maximum(jnp.maximum(past_x, past_y), past_z))


def straighten(shape: Shape, local: Float[Array, "3 point"]) -> Float[Array, "3 point"]:
    """x, y, z of points in the body's frame with bend and taper undone."""
    x, y, z = local
    if shape.bend is not None:
        x, y, z = _unbend(x, y, z, shape.bend)
    if shape.taper is not None:
        factors = _taper_factors(shape, z)
        x, y = x / factors[0], y / factors[1]
    return jnp.stack([x, y, z])


def _taper_factors(shape: Shape, z: Float[Array, " point"]) -> Float[Array, "2 point"]:
    """Width of the section at z by that of the middle one, along x and y.

    Beyond an end it stays that of the end: a section that went on to shrink would make a spike of
    small distances above a body that is too short.
    """
    height = jnp.clip(z / shape.size[2], -1.0, 1.0)
    assert shape.taper is not None
    return jnp.maximum(1.0 + shape.taper * height, LEAST_TAPER_FACTOR)


def _unbend(x, y, z, bend):
    """The inverse of the bend (Solina and Bajcsy 1990) in a form that has a limit at k = 0."""
    k = jnp.sqrt(jnp.sum(bend**2, axis=0) + 1e-18)
    turn = bend[0] * x + bend[1] * y
    outer = turn / k
    across = (k * z) ** 2
    radius = jnp.sqrt(jnp.maximum((1.0 - turn) ** 2 + across, 1e-6))
    longer = (turn * (turn - 2.0) + across) / (1.0 + radius)
    shift = (outer * longer / k + outer**2 + z**2) / (1.0 + radius)
    ahead = jnp.maximum(1.0 - turn, 0.1)
    return x - bend[0] * shift, y - bend[1] * shift, z / ahead * _arctan_ratio(k * z / ahead)


def _arctan_ratio(u):
    """arctan(u)/u, smooth through zero."""
    small = jnp.abs(u) < 1e-3
    safe = jnp.where(small, 1.0, u)
    return jnp.where(small, 1.0 - u**2 / 3.0, jnp.arctan(safe) / safe)


def _logs(shape: Shape, straight):
    """Logs of squared scaled coordinates."""
    return jnp.log((straight / shape.size) ** 2 + TINY)


def _log_square_radius(shape: Shape, straight):
    return _log_f_e1(_logs(shape, straight), shape.exponents)[0]


def _log_f_e1(logs: Float[Array, "3 point"], exponents: Float[Array, "2 point"]):
    """log F^e1, and its slopes along the three logs.

    log F^e1 is a soft maximum of soft maxima: its slopes along the logs are the weights of the
    soft maxima, which sum to one.
    """
    (lx, ly, lz), (e1, e2) = logs, exponents
    section, x_share = _soft_maximum(lx, ly, e2)
    value, section_share = _soft_maximum(section, lz, e1)
    return value, (section_share * x_share, section_share * (1.0 - x_share), 1.0 - section_share)


@jax.custom_vjp
def _soft_maximum(a, b, heat):
    """heat log(exp(a/heat) + exp(b/heat)), and the weight of a, elementwise."""
    return _soft_maximum_parts(a, b, heat)[:2]


def _soft_maximum_parts(a, b, heat):
    gap = (a - b) / heat
    decay = jnp.exp(-jnp.abs(gap))
    spill = jnp.log1p(decay)
    larger = 1.0 / (1.0 + decay)
    weight = jnp.where(gap > 0.0, larger, 1.0 - larger)
    # The slope along the heat is the entropy of the two weights.
    entropy = spill + jnp.abs(gap) * (1.0 - larger)
    return jnp.maximum(a, b) + heat * spill, weight, gap, decay * larger**2, entropy


def _soft_maximum_forward(a, b, heat):
    value, weight, gap, spread, entropy = _soft_maximum_parts(a, b, heat)
    return (value, weight), (weight, gap, spread / heat, entropy)


def _soft_maximum_backward(kept, cotangents):
    weight, gap, spread, entropy = kept
    of_value, of_weight = cotangents
    steep = of_weight * spread
    return (of_value * weight + steep, of_value * (1.0 - weight) - steep,
            of_value * entropy - steep * gap)


_soft_maximum.defvjp(_soft_maximum_forward, _soft_maximum_backward)
