"""The scaled radius of superquadrics by logarithms, with its gradient: 1 on the surface.

F^(e1/2) after Allen and Michelman 1990, equation (1), as `fit.superquadric_shape` has it.
Logarithms neither overflow nor lose the flat ends of bodies whose exponents differ much.
"""

import warp as wp

from warpgrasp.real import HALF, ONE, real, vec3, vec4
from warpgrasp.sdf_superquadric import SuperquadricShape, deformed_gradient, straighten

TINY_SQUARE = wp.constant(real(1e-20))  # added to squares, so that they have logarithms


@wp.func
def _power_mean(a: real, b: real, e: real):
    """e log(exp(a / e) + exp(b / e)), and its derivative by a."""
    t = wp.exp(-wp.abs(a - b) / e)
    by_larger = ONE / (ONE + t)
    value = wp.max(a, b) + e * wp.log(ONE + t)
    if a >= b:
        return wp.vec2d(value, by_larger)
    return wp.vec2d(value, t * by_larger)


@wp.func
def log_radius(log_x: real, log_y: real, log_z: real, e1: real, e2: real):
    """Logarithm of the squared scaled radius, from those of squared coordinates over sizes; and its
    derivatives by the three: (by x, by y, by z, value)."""
    across = _power_mean(log_x, log_y, e2)
    whole = _power_mean(across[0], log_z, e1)
    return vec4(whole[1] * across[1], whole[1] * (ONE - across[1]), ONE - whole[1], whole[0])


@wp.func
def superquadric_radius(p: vec3, s: SuperquadricShape):
    """Gradient and value (gx, gy, gz, f) at `p` of the scaled radius of the deformed body."""
    q = straighten(p, s)
    u = wp.cw_div(q.point, s.size)
    square = wp.cw_mul(u, u) + vec3(TINY_SQUARE, TINY_SQUARE, TINY_SQUARE)
    g = log_radius(wp.log(square[0]), wp.log(square[1]), wp.log(square[2]), s.e1, s.e2)
    f = wp.exp(HALF * g[3])
    by = f * vec3(g[0] * u[0] / (square[0] * s.size[0]), g[1] * u[1] / (square[1] * s.size[1]),
                  g[2] * u[2] / (square[2] * s.size[2]))
    return deformed_gradient(vec4(by[0], by[1], by[2], f), p, q, s)
