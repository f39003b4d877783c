"""Signed distance of points to a superquadric before its bend, in JAX, derivatives by hand.

The larger of two bounds from below. One is (beta - 1)/|grad beta|, beta the scaled radius, which
without taper is convex for exponents up to 2. It is exact to first order at the surface, but deep
in a thin body it looks to the end and not to the nearer side. The other is the distance to the box
around the body (with taper a frustum's): the larger of the signed distances to its faces.

The gradient of beta is in it, so that its derivatives are second ones; a compiler's own repeat
the same work five times over, and most of a fit's time is spent here.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from fit.optimize.xla_flags import storing

Row = Float[Array, " point"]

TINY = 1e-12
"""Added to squared scaled coordinates: moves a surface by less than a micrometre."""
LEAST_TAPER_FACTOR = 0.02


@jax.custom_vjp
def straight_distance(
    size: tuple[Row, Row, Row],
    exponents: tuple[Row, Row],
    taper: tuple[Row, Row] | None,
    local: tuple[Row, Row, Row],
) -> Row:
    """Distance of points of the unbent body's frame, a body a point."""
    return _forward(size, exponents, taper, local)[0]


def _forward(size, exponents, taper, local):
    a1, a2, a3 = size
    e1, e2 = exponents
    wide_x, wide_y, z = local
    stored = storing(z)
    i1, i2, i3 = 1.0 / a1, 1.0 / a2, 1.0 / a3
    height = jnp.clip(z * i3, -1.0, 1.0)
    within = jnp.abs(z) < a3

    # x = X / fx, and the face at x = a1 leans by the angle whose cosine is nx.
    def section(wide, k, a):
        if k is None:
            return wide, 1.0, 1.0, 0.0, 0.0, False
        wanted = 1.0 + k * height
        tapers = wanted > LEAST_TAPER_FACTOR
        factor = jnp.where(tapers, wanted, LEAST_TAPER_FACTOR)
        leans = jnp.where(tapers & within, k, 0.0)
        lean = leans * a * i3
        return wide / factor, factor, 1.0 / jnp.sqrt(1.0 + lean**2), leans, lean, tapers

    kx, ky = (None, None) if taper is None else taper
    x, fx, nx, lx_taper, lean_x, tapers_x = section(wide_x, kx, a1)
    y, fy, ny, ly_taper, lean_y, tapers_y = section(wide_y, ky, a2)

    def logarithm(c, inverse_size):
        """log(u^2 + TINY) of u = c/a, u/(u^2 + TINY)/a, and 1/(u^2 + TINY)/a."""
        u = c * inverse_size
        square = u * u + TINY
        steep = inverse_size / square
        return jnp.log(square), u * steep, steep, u

    log_x, ix, jx, ux = logarithm(x, i1)
    log_y, iy, jy, uy = logarithm(y, i2)
    log_z, iz, jz, uz = logarithm(z, i3)
    across, w2, gap2, spread2, entropy2 = soft_maximum_parts(log_x, log_y, e2)
    log_square, w1, gap1, spread1, entropy1 = soft_maximum_parts(across, log_z, e1)
    ie1, ie2 = 1.0 / e1, 1.0 / e2
    sx, sy, sz = w1 * w2, w1 * (1.0 - w2), 1.0 - w1

    # The gradient of log beta.
    rx, ry = 1.0 / fx, 1.0 / fy
    gx, gy = stored(sx * ix * rx), stored(sy * iy * ry)
    leaning = gx * x * lx_taper + gy * y * ly_taper
    gz = sz * iz - leaning * i3
    inverse_slope = 1.0 / jnp.sqrt(gx**2 + gy**2 + gz**2 + TINY)
    away = -jnp.expm1(-0.5 * jnp.clip(log_square, -8.0, 30.0))
    first_order = stored(away * inverse_slope)

    past_x = (jnp.abs(x) - a1) * fx * nx
    past_y = (jnp.abs(y) - a2) * fy * ny
    past_z = jnp.abs(z) - a3
    past_x, past_y = stored(past_x), stored(past_y)
    box = jnp.maximum(jnp.maximum(past_x, past_y), past_z)
    value = jnp.maximum(first_order, box)

    # From here on derivatives of `value`: `of_v` is that by v.
    smooth = first_order >= box
    on_x = ~smooth & (past_x >= box)
    on_y = ~smooth & (past_y >= box) & ~on_x
    on_z = ~smooth & ~on_x & ~on_y
    steep = jnp.where(smooth, inverse_slope, 0.0)
    inside = (log_square > -8.0) & (log_square < 30.0)
    of_log = stored(jnp.where(inside, 0.5 * (1.0 - away) * steep, 0.0))
    turn = -first_order * inverse_slope * steep
    of_gx, of_gy, of_gz = turn * gx, turn * gy, turn * gz
    of_gz = stored(of_gz)
    of_leaning = -of_gz * i3
    of_x, of_y = of_leaning * gx * lx_taper, of_leaning * gy * ly_taper
    of_kx = of_leaning * gx * x
    of_ky = of_leaning * gy * y
    of_a3 = -of_leaning * leaning * i3
    of_gx, of_gy = of_gx + of_leaning * x * lx_taper, of_gy + of_leaning * y * ly_taper
    of_gx, of_gy = stored(of_gx), stored(of_gy)
    of_sx, of_sy, of_sz = of_gx * ix * rx, of_gy * iy * ry, of_gz * iz
    of_ix, of_iy, of_iz = of_gx * sx * rx, of_gy * sy * ry, of_gz * sz

    of_w1 = of_sx * w2 + of_sy * (1.0 - w2) - of_sz
    of_w2 = w1 * (of_sx - of_sy)
    bent1 = stored(of_w1 * spread1 * ie1)
    of_across = stored(of_log * w1 + bent1)
    of_log_z = of_log * (1.0 - w1) - bent1
    of_e1 = of_log * entropy1 - bent1 * gap1
    bent2 = stored(of_w2 * spread2 * ie2)
    of_log_x = of_across * w2 + bent2
    of_log_y = of_across * (1.0 - w2) - bent2
    of_e2 = of_across * entropy2 - bent2 * gap2

    def coordinate(of_log_c, of_i, i, j, u, a, inverse_size):
        """By c and by a through u = c/a, of log(u^2 + TINY) and of i = u j."""
        of_u = 2.0 * a * i * of_log_c + of_i * (j - 2.0 * a * i * i)
        return of_u * inverse_size, -(of_u * u + of_i * i) * inverse_size

    more_x, of_a1 = coordinate(of_log_x, of_ix, ix, jx, ux, a1, i1)
    more_y, of_a2 = coordinate(of_log_y, of_iy, iy, jy, uy, a2, i2)
    of_z, more_a3 = coordinate(of_log_z, of_iz, iz, jz, uz, a3, i3)
    of_x, of_y, of_a3 = stored(of_x + more_x), stored(of_y + more_y), stored(of_a3 + more_a3)

    sign = lambda c, chosen: jnp.where(chosen, jnp.where(c < 0.0, -1.0, 1.0), 0.0)  # noqa: E731
    side_x, side_y, side_z = sign(x, on_x), sign(y, on_y), sign(z, on_z)
    of_x = of_x + side_x * fx * nx
    of_y = of_y + side_y * fy * ny
    of_z = of_z + side_z
    of_a1 = of_a1 - jnp.where(on_x, fx * nx, 0.0)
    of_a2 = of_a2 - jnp.where(on_y, fy * ny, 0.0)
    of_a3 = of_a3 - jnp.where(on_z, 1.0, 0.0)
    if taper is None:
        return value, ((of_a1, of_a2, of_a3), (of_e1, of_e2), None, (of_x, of_y, of_z))

    def tapered(of_c, c, of_g, g, of_leans, chosen, past, a, factor, cosine, lean, k, tapers):
        """What taper adds: by the wide coordinate, by k, by a and by a3."""
        held = jnp.where(chosen, past, 0.0)
        of_lean = -held * lean * cosine**2
        of_factor = (jnp.where(chosen, (jnp.abs(c) - a) * cosine, 0.0)
                     - (of_g * g + of_c * c) / factor)
        of_factor = jnp.where(tapers, of_factor, 0.0)
        of_leans = jnp.where(tapers & within, of_leans + of_lean * a * i3, 0.0)
        of_height = jnp.where(within, of_factor * k, 0.0)
        return (of_c / factor, of_leans + of_factor * height, of_height,
                of_lean * lean / a, -of_lean * lean * i3)

    wide_of_x, of_kx, height_x, a_x, a3_x = tapered(
        of_x, x, of_gx, gx, of_kx, on_x, past_x, a1, fx, nx, lean_x, kx, tapers_x)
    wide_of_y, of_ky, height_y, a_y, a3_y = tapered(
        of_y, y, of_gy, gy, of_ky, on_y, past_y, a2, fy, ny, lean_y, ky, tapers_y)
    of_height = (height_x + height_y) * i3
    of_a3 = of_a3 + a3_x + a3_y - of_height * height
    return value, ((of_a1 + a_x, of_a2 + a_y, of_a3), (of_e1, of_e2), (of_kx, of_ky),
                   (wide_of_x, wide_of_y, of_z + of_height))


def _backward(slopes, cotangent):
    return jax.tree.map(lambda slope: cotangent * slope, slopes)


straight_distance.defvjp(_forward, _backward)


@jax.custom_vjp
def soft_maximum(a, b, heat):
    """heat log(exp(a/heat) + exp(b/heat)), elementwise."""
    return soft_maximum_parts(a, b, heat)[0]


def soft_maximum_parts(a, b, heat):
    """The soft maximum, the weight of a, (a - b)/heat, the product of the two weights, and their
    entropy. The weights are the slopes along a and b, the entropy is that along the heat."""
    gap = (a - b) / heat
    decay = jnp.exp(-jnp.abs(gap))
    spill = jnp.log1p(decay)
    larger = 1.0 / (1.0 + decay)
    weight = jnp.where(gap > 0.0, larger, 1.0 - larger)
    entropy = spill + jnp.abs(gap) * (1.0 - larger)
    return jnp.maximum(a, b) + heat * spill, weight, gap, decay * larger**2, entropy


def _soft_forward(a, b, heat):
    value, weight, _, _, entropy = soft_maximum_parts(a, b, heat)
    return value, (weight, entropy)


def _soft_backward(kept, cotangent):
    weight, entropy = kept
    return cotangent * weight, cotangent * (1.0 - weight), cotangent * entropy


soft_maximum.defvjp(_soft_forward, _soft_backward)
