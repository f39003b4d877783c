"""Support function of a superquadric in JAX: the dual surface, for tangent planes.

Values and derivatives are finite for finite parameters, like those of `field`.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from fit.superquadric.distance import TINY
from fit.superquadric.field import Shape
from fit.superquadric.geometry import MIN_TAPER_FACTOR

NODES = 9
"""Initial heights: a bent body may have several local maxima."""
POLISH = 2
"""Pairs of refinement steps from the best of these."""
LEAP = 4.0
"""Largest extrapolation of a pair of steps, in the logit."""
FAR = 600.0
"""Bound of the profile's logit, near the poles."""


def support(shape: Shape, d: Float[Array, " 3"]) -> Float[Array, ""]:
    """Largest extent of a shape along direction d of its own frame.

    Each section across z is a superellipse with closed-form support, so the support of the body is
    the maximum over height of centre(s) + c width(s), with (s, c) on the profile. For a linear
    centre A s and constant width the best height is closed-form; with A = centre' + c width' this
    gives an iteration whose fixed point is the maximum. By the envelope theorem, derivatives are
    taken with the best height fixed. Without taper and bend the support is
    [(|a1 d1|^p2 + |a2 d2|^p2)^(p1/p2) + |a3 d3|^p1]^(1/p1), p = 2/(2 - e).
    """
    if shape.taper is None and shape.bend is None:
        return _straight_support(shape, d)

    def reach(side, logit):
        s, c = _profile(shape.exponents[0], side, logit)
        centre, width = _section(shape, d, s)
        return centre + c * width

    def step(side, logit):
        s, c = _profile(shape.exponents[0], side, logit)
        (_, width), (rise, widens) = jax.jvp(
            lambda s: _section(shape, d, s), (s,), (jnp.ones_like(s),))
        along = rise + c * widens
        power = 2.0 / (2.0 - jnp.minimum(shape.exponents[0], 2.0 - 1e-3))
        logit = power * (jnp.log(width) - jnp.log(jnp.abs(along) + TINY))
        return jnp.where(along < 0.0, -1.0, 1.0), jnp.clip(logit, -FAR, FAR)

    angles = np.linspace(-np.pi / 2, np.pi / 2, NODES)
    with np.errstate(divide="ignore"):
        logits = np.clip(2.0 * np.log(np.cos(angles) / np.abs(np.sin(angles))), -FAR, FAR)
    tried = jax.vmap(reach)(jnp.sign(angles), jnp.asarray(logits))
    top = jnp.argmax(tried)
    best = jnp.sign(angles)[top], jnp.asarray(logits)[top]
    polished = best
    for _ in range(POLISH):
        one = step(*polished)
        two = step(*one)
        # Extrapolation of geometric convergence (Steffensen).
        first, second = one[1] - polished[1], two[1] - one[1]
        curve = jnp.where(second == first, 1.0, second - first)
        leap = jnp.where(second == first, 0.0, second**2 / curve)
        fair = (polished[0] == two[0]) & (jnp.abs(leap) < LEAP)
        polished = two[0], jnp.where(fair, jnp.clip(two[1] - leap, -FAR, FAR), two[1])
    higher = reach(*polished) >= tried[top]
    return reach(*(jax.lax.stop_gradient(jnp.where(higher, p, b))
                   for p, b in zip(polished, best, strict=True)))


def _profile(e1, side, logit):
    """Height over a3 and scale of the section at this logit of the squared cosine."""
    return (side * jnp.exp(0.5 * e1 * jax.nn.log_sigmoid(-logit)),
            jnp.exp(0.5 * e1 * jax.nn.log_sigmoid(logit)))


def _straight_support(shape: Shape, d: Float[Array, " 3"]) -> Float[Array, ""]:
    e1, e2 = shape.exponents
    p1, p2 = (2.0 / jnp.maximum(2.0 - e, 1e-3) for e in (e1, e2))
    lx, ly, lz = jnp.log((shape.size * d) ** 2 + TINY)
    section = jnp.logaddexp(0.5 * p2 * lx, 0.5 * p2 * ly) / p2
    return jnp.exp(jnp.logaddexp(p1 * section, 0.5 * p1 * lz) / p1)


def _section(shape: Shape, d: Float[Array, " 3"], height: Float[Array, ""]):
    """Extent along d (body frame) of the centre of the section at a3 times `height`, and of the
    section relative to its centre, unscaled by the profile."""
    e2 = shape.exponents[1]
    z = shape.size[2] * height
    across, centre = d[:2], z * d[2]
    if shape.bend is not None:
        # The added curvature bends nothing, but allows a division.
        k = jnp.sqrt(jnp.sum(shape.bend**2) + 1e-18)
        toward = shape.bend / k
        sin, cos = jnp.sin(0.5 * k * z), jnp.cos(0.5 * k * z)
        # The bend tilts the section towards z along the direction of the bend.
        tip = 2.0 * sin * (sin * (toward @ d[:2]) + cos * d[2])
        across = across - tip * toward
        centre = tip / k
    widths = shape.size[:2] * across
    if shape.taper is not None:
        widths = widths * jnp.maximum(1.0 + shape.taper * height, MIN_TAPER_FACTOR)
    power = 2.0 / jnp.maximum(2.0 - e2, 1e-3)
    wide = jnp.exp(jnp.logaddexp(*(0.5 * power * jnp.log(widths**2 + TINY))) / power)
    return centre, wide
