"""Signed distance to a superquadric, inverse bend and soft maximum, in JAX, derivatives by hand.

The distance is the larger of two lower bounds. One is (beta - 1)/|grad beta|, where beta, the
scaled radius, is convex without taper for exponents up to 2. It is exact to first order at the
surface, but deep in a thin body it measures to the end rather than the nearer side. The other is
the distance to the faces of the bounding box (with taper, a frustum).

Automatic derivatives repeat the same work up to five times, and fits spend most time here.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from fit.optimize.xla_flags import force_materialize
from fit.superquadric.geometry import MIN_TAPER_FACTOR

Row = Float[Array, " #point"]

TINY = 1e-12
"""Added to squared scaled coordinates; displaces the surface by less than a micrometre."""
MIN_AHEAD = 0.1
"""Lower bound of w: beyond the centre of the bend's circle the map would fold."""
SMALL = 1e-4
"""(k z / w)^2 below which the arctangent is a series."""


@jax.custom_vjp
def straight_distance(
    size: tuple[Row, Row, Row],
    exponents: tuple[Row, Row],
    taper: tuple[Row, Row] | None,
    local: tuple[Row, Row, Row],
) -> Row:
    """Signed distance of points in the frame of the unbent body, with one body per point."""
    return _distance_forward(size, exponents, taper, local)[0]


def _distance_forward(size, exponents, taper, local):
    a1, a2, a3 = size
    e1, e2 = exponents
    wide_x, wide_y, z = local
    stored = force_materialize(z)
    i1, i2, i3 = 1.0 / a1, 1.0 / a2, 1.0 / a3
    height = jnp.clip(z * i3, -1.0, 1.0)
    within = jnp.abs(z) < a3

    # x = X / fx, and nx is the cosine of the inclination of the face at x = a1.
    def section(wide, k, a):
        if k is None:
            return wide, 1.0, 1.0, 0.0, 0.0, False
        wanted = 1.0 + k * height
        tapers = wanted > MIN_TAPER_FACTOR
        factor = jnp.where(tapers, wanted, MIN_TAPER_FACTOR)
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

    # Derivatives of `value`: `of_v` is the derivative by v.
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
        """Derivatives by c and a through u = c/a, of log(u^2 + TINY) and of i = u j."""
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
        """Contributions of the taper: by the tapered coordinate, by k, by a and by a3."""
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


def _distance_backward(slopes, cotangent):
    return jax.tree.map(lambda slope: cotangent * slope, slopes)


straight_distance.defvjp(_distance_forward, _distance_backward)


@jax.custom_vjp
def soft_maximum(a, b, heat):
    """heat log(exp(a/heat) + exp(b/heat)), elementwise."""
    return soft_maximum_parts(a, b, heat)[0]


def soft_maximum_parts(a, b, heat):
    """The soft maximum, the weight of a, (a - b)/heat, the product of the two weights, and their
    entropy. The weights are the derivatives by a and b, the entropy is that by the heat."""
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


@jax.custom_vjp
def unbend(bend: Sequence[Row], local: Sequence[Row]) -> tuple[Row, ...]:
    """Inverse bend of points x, y, z in the body's frame; `bend` is the curvature vector b.

    A bend of curvature k lays the z axis on a circle (Solina and Bajcsy 1990). Its inverse, in
    polar coordinates about the centre of the circle and without division by k, is

        t = b . (x, y),   w = 1 - t,   rho^2 = w^2 + k^2 z^2,   shift = z^2 / (rho + w),

        (x, y) -> (x, y) - b shift,     z -> arctan(k z / w) / k.
    """
    return _unbend_forward(bend, local)[0]


def _unbend_forward(bend, local):
    x, y, z = local
    bx, by = bend
    square = bx**2 + by**2
    ahead = 1.0 - (bx * x + by * y)
    w = jnp.maximum(ahead, MIN_AHEAD)
    slant = z / w
    q = square * slant**2
    root = jnp.sqrt(1.0 + q)
    rho = w * root
    shift = z * slant / (1.0 + root)
    # arctan(u)/u and its derivative by u^2, smooth at zero.
    small = q < SMALL
    safe = jnp.where(small, 1.0, q)
    u = jnp.sqrt(safe)
    ratio = jnp.where(small, 1.0 - q * (1.0 / 3.0 - q * (0.2 - q / 7.0)), jnp.arctan(u) / u)
    series = -1.0 / 3.0 + q * (0.4 - q * (3.0 / 7.0))
    by_q = jnp.where(small, series, 0.5 * (1.0 / (1.0 + safe) - ratio) / safe)
    rise = slant * ratio
    stored = force_materialize(z)
    shift, rise = stored(shift), stored(rise)
    straight = (x - bx * shift, y - by * shift, rise)
    return straight, (bend, local, ahead > MIN_AHEAD, 1.0 / rho, w, shift, slant**3 * by_q)


def _unbend_backward(kept, cotangent):
    (bx, by), (x, y, z), free, inverse, w, shift, rise_by_square = kept
    stored = force_materialize(z)
    cx, cy, cz = (stored(c) for c in cotangent)
    of_shift = stored(-(cx * bx + cy * by))
    up = cz * inverse
    # Derivatives by t, by z, and by the square of the curvature.
    of_turn = stored(jnp.where(free, (of_shift * shift + up * z) * inverse, 0.0))
    of_z = (of_shift * z + up * w) * inverse
    of_square = stored(cz * rise_by_square - 0.5 * of_shift * shift**2 * inverse)
    by_bend = (of_turn * x + 2.0 * of_square * bx - cx * shift,
               of_turn * y + 2.0 * of_square * by - cy * shift)
    return by_bend, (cx + of_turn * bx, cy + of_turn * by, of_z)


unbend.defvjp(_unbend_forward, _unbend_backward)
