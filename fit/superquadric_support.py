"""How far a superquadric reaches in a direction, in JAX: the dual surface, for planes it rests on.

Total, like the field: finite with finite derivatives for finite parameters.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from fit.superquadric_body import Body, Tensor
from fit.superquadric_distance import LEAST_TAPER_FACTOR, TINY


def support(body: Body, direction: Float[Tensor, " 3"], nodes: int = 17) -> Float[Array, ""]:
    """How far the body reaches along a world direction, from its position.

    Every section across z is a superellipse, scaled by the profile and the taper, moved and turned
    by the bend: its own support is closed-form, so the body's is a maximum over the height alone.
    Taken on a grid of the profile's angle and refined by a parabola; by the envelope theorem the
    derivative at the best height held fixed is the derivative of the support. Without taper and
    bend: [(|a1 d1|^p2 + |a2 d2|^p2)^(p1/p2) + |a3 d3|^p1]^(1/p1), p = 2/(2 - e).
    """
    d = body.rotation.T @ direction
    if body.taper is None and body.bend is None:
        return _straight_support(body, d)
    angles = jnp.linspace(-jnp.pi / 2, jnp.pi / 2, nodes)
    at = lambda angle: _section_support(body, d, angle)  # noqa: E731
    reach = jax.vmap(at)(angles)
    top = jnp.argmax(reach)
    best = jnp.clip(top, 1, nodes - 2)
    left, middle, right = reach[best - 1], reach[best], reach[best + 1]
    bow = jnp.minimum(left - 2.0 * middle + right, -1e-12)
    shift = jnp.clip(0.5 * (left - right) / bow, -1.0, 1.0)
    refined = angles[best] + shift * (angles[1] - angles[0])
    chosen = jnp.where(at(refined) >= reach[top], refined, angles[top])
    return at(jax.lax.stop_gradient(chosen))


def _straight_support(body: Body, d: Float[Array, " 3"]) -> Float[Array, ""]:
    e1, e2 = body.exponents
    p1, p2 = (2.0 / jnp.maximum(2.0 - e, 1e-3) for e in (e1, e2))
    lx, ly, lz = jnp.log((body.size * d) ** 2 + TINY)
    section = jnp.logaddexp(0.5 * p2 * lx, 0.5 * p2 * ly) / p2
    return jnp.exp(jnp.logaddexp(p1 * section, 0.5 * p1 * lz) / p1)


def _section_support(body: Body, d: Float[Array, " 3"], angle: Float[Array, ""]):
    """Reach along d (body frame) of the section at height a3 sign(sin) |sin|^e1 of the profile."""
    e1, e2 = body.exponents
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    profile = jnp.exp(0.5 * e1 * jnp.log(cos**2 + TINY))
    height = jnp.sign(sin) * jnp.exp(0.5 * e1 * jnp.log(sin**2 + TINY))
    z = body.size[2] * height
    across, centre = d[:2], z * d[2]
    if body.bend is not None:
        k = jnp.sqrt(jnp.sum(body.bend**2) + 1e-18)
        turn = k * z
        toward = body.bend @ d[:2] / k
        # Along the bend's direction the section's own axis tips out of the plane towards z.
        tip = (1.0 - jnp.cos(turn)) * toward + jnp.sin(turn) * d[2]
        across = across - tip * body.bend / k
        half = 0.5 * turn
        centre = (z * jnp.sinc(turn / jnp.pi) * d[2]
                  + half * z * jnp.sinc(half / jnp.pi) ** 2 * toward)
    widths = body.size[:2] * across
    if body.taper is not None:
        widths = widths * jnp.maximum(1.0 + body.taper * height, LEAST_TAPER_FACTOR)
    power = 2.0 / jnp.maximum(2.0 - e2, 1e-3)
    wide = jnp.exp(jnp.logaddexp(*(0.5 * power * jnp.log(widths**2 + TINY))) / power)
    return centre + profile * wide


