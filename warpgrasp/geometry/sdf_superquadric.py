# type: ignore  # Warp functions, which type checkers cannot follow
"""Superquadrics with linear taper and bend: first-order distance bounds, with gradients.

The gauge f = F^(e1/2), F the inside-outside function of Allen and Michelman 1990, equation (1), is
homogeneous of degree one and, for exponents up to 2, convex; so (f - 1) / |grad f| never exceeds
the true distance outside, and agrees with it to first order at the surface. Taper and bend (Solina
and Bajcsy 1990) keep the agreement at the surface; away from it the value is an estimate of the
distance that is not guaranteed a bound. Hands touch superquadrics at distances that are baked
(`objects.body_baking`).
Beside a strong taper's thin end it is far too small: there the larger distance to the frustum's
faces is used.
"""

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, TINY, TWO, ZERO, real, struct, transform, vec3, vec4
from warpgrasp.geometry.sdf_primitive import sign_of

_STRAIGHT = wp.constant(real(1e-6))  # curvatures below are no bend [1/m]
_SMALL = wp.constant(real(1e-4))  # angles whose sine is taken by its series [rad]
_THIN = wp.constant(real(0.02))  # a section tapered to less counts as this, to stay finite
_STRONG = wp.constant(real(0.75))  # taper: an end thinner than a quarter of the middle


@struct
class SuperquadricShape:
    """Half axes [m], exponents, taper (Kx, Ky), bend curvature [1/m] and its direction [rad]."""

    size: vec3
    e1: real
    e2: real
    kx: real
    ky: real
    bend: real
    bend_angle: real


@wp.func
def _power(base: real, exponent: real):
    if base < TINY:
        return ZERO
    if base == ONE:
        return ONE  # one of any two compared below is; a power costs as much as ten products
    return wp.pow(base, exponent)


@wp.func
def superquadric_gauge(p: vec3, size: vec3, e1: real, e2: real):
    """Gradient and value (gx, gy, gz, f) of the undeformed gauge f = F^(e1/2), 1 on the body."""
    u = wp.abs(p[0]) / size[0]
    v = wp.abs(p[1]) / size[1]
    w = wp.abs(p[2]) / size[2]
    m = wp.max(wp.max(u, v), wp.max(w, TINY))
    u = u / m
    v = v / m
    w = w / m
    # By the wider of the two across: the other way round a body square across and round above loses
    # its pole, where the powers of both are too small to count.
    across = wp.max(wp.max(u, v), TINY)
    u = u / across
    v = v / across
    u_power = _power(u, TWO / e2)
    v_power = _power(v, TWO / e2)
    a = u_power + v_power
    if a < HALF:
        a = ONE  # on the axis: `across` alone says that nothing is there
    level = _power(across, TWO / e1) * _power(a, e2 / e1)
    upright = _power(w, TWO / e1)
    total = level + upright
    f = _power(total, e1 * HALF)
    # Slopes have powers less by one: quotients of those above.
    common = f / total
    ring = common * level / (across * a)
    return vec4(sign_of(p[0]) * ring * u_power / (wp.max(u, TINY) * size[0]),
                sign_of(p[1]) * ring * v_power / (wp.max(v, TINY) * size[1]),
                sign_of(p[2]) * common * upright / (wp.max(w, TINY) * size[2]),
                m * f)


@struct
class Straightened:
    """A point before taper and bend, and what leads a gradient there back to where it came from."""

    point: vec3
    untapered: vec3
    tx: real
    ty: real
    thin_x: bool
    thin_y: bool
    ca: real
    sa: real
    lever: real
    rho: real


@wp.func
def straighten(p: vec3, s: SuperquadricShape):
    """The point whose place in the plain body is that of `p` in the tapered and bent one."""
    x = p[0]
    y = p[1]
    z = p[2]
    q = Straightened()
    q.lever = ZERO
    q.rho = ONE
    if s.bend > _STRAIGHT:
        q.ca = wp.cos(s.bend_angle)
        q.sa = wp.sin(s.bend_angle)
        along = p[0] * q.ca + p[1] * q.sa
        q.lever = ONE / s.bend - along
        q.rho = wp.max(wp.sqrt(p[2] * p[2] + q.lever * q.lever), TINY)
        shift = along - (ONE / s.bend - q.rho)
        x = p[0] - q.ca * shift
        y = p[1] - q.sa * shift
        z = wp.atan2(p[2], q.lever) / s.bend
    # Above and below the body the taper goes no further: carried on, it would close to a point
    # there, and open air above a wedge would count as touched.
    height = wp.clamp(z / s.size[2], -ONE, ONE)
    tx = s.kx * height + ONE
    ty = s.ky * height + ONE
    beyond = wp.abs(z) > s.size[2]
    q.thin_x = tx < _THIN or beyond
    q.thin_y = ty < _THIN or beyond
    q.tx = wp.max(tx, _THIN)
    q.ty = wp.max(ty, _THIN)
    q.untapered = vec3(x, y, z)
    q.point = vec3(x / q.tx, y / q.ty, z)
    return q


@wp.func
def bent_gradient(g: vec3, p: vec3, q: Straightened, s: SuperquadricShape):
    """The gradient at `p` of the field whose gradient before the bend is `g`."""
    if s.bend <= _STRAIGHT:
        return g
    gr = g[0] * q.ca + g[1] * q.sa
    turn = g[2] / (s.bend * q.rho * q.rho)
    along_part = gr * (q.lever / q.rho - ONE) + turn * p[2]
    return vec3(g[0] + along_part * q.ca, g[1] + along_part * q.sa,
                turn * q.lever - gr * p[2] / q.rho)


@wp.func
def deformed_gradient(g: vec4, p: vec3, q: Straightened, s: SuperquadricShape):
    """The gradient at `p` of the field whose gradient and value at `q.point` are `g`."""
    gx = g[0] / q.tx
    gy = g[1] / q.ty
    gz = g[2]
    if not q.thin_x:
        gz -= g[0] * q.untapered[0] * s.kx / (s.size[2] * q.tx * q.tx)
    if not q.thin_y:
        gz -= g[1] * q.untapered[1] * s.ky / (s.size[2] * q.ty * q.ty)
    bent = bent_gradient(vec3(gx, gy, gz), p, q, s)
    return vec4(bent[0], bent[1], bent[2], g[3])


@wp.func
def _sinc(x: real):
    if wp.abs(x) < _SMALL:
        return ONE - x * x / real(6.0)
    return wp.sin(x) / x


@wp.func
def taper_and_bend(p: vec3, s: SuperquadricShape):
    """Where a point of the plain body comes to lie; the inverse of `straighten`."""
    height = wp.clamp(p[2] / s.size[2], -ONE, ONE)
    x = p[0] * wp.max(s.kx * height + ONE, _THIN)
    y = p[1] * wp.max(s.ky * height + ONE, _THIN)
    if s.bend <= _STRAIGHT:
        return vec3(x, y, p[2])
    # (1/k - r)(1 - cos kz) and (1/k - r) sin kz without a division by k.
    ca = wp.cos(s.bend_angle)
    sa = wp.sin(s.bend_angle)
    inward = ONE - s.bend * (x * ca + y * sa)
    turn = s.bend * p[2]
    half = _sinc(HALF * turn)
    shift = inward * HALF * turn * p[2] * half * half
    return vec3(x + ca * shift, y + sa * shift, inward * p[2] * _sinc(turn))


@wp.func
def superquadric_deformed_gauge(p: vec3, s: SuperquadricShape):
    """Gradient and value of the gauge of the tapered and bent body at `p`."""
    q = straighten(p, s)
    return deformed_gradient(superquadric_gauge(q.point, s.size, s.e1, s.e2), p, q, s)


@wp.func
def _side_past(x: real, z: real, a: real, a3: real, k: real):
    """Slopes by x and z and value of the signed distance to a frustum's sides, one axis across."""
    top = wp.max(ONE + k, _THIN)
    foot = wp.max(ONE - k, _THIN)
    lean = HALF * a * (top - foot) / a3
    cosine = ONE / wp.sqrt(ONE + lean * lean)
    past = (wp.abs(x) - HALF * a * (top + foot) - lean * z) * cosine
    return vec3(sign_of(x) * cosine, -lean * cosine, past)


@wp.func
def _past_frustum(p: vec3, q: Straightened, s: SuperquadricShape):
    """Gradient and signed distance to the face most passed of the frustum around a body."""
    x = _side_past(q.untapered[0], q.untapered[2], s.size[0], s.size[2], s.kx)
    y = _side_past(q.untapered[1], q.untapered[2], s.size[1], s.size[2], s.ky)
    past = wp.abs(q.untapered[2]) - s.size[2]
    g = vec3(ZERO, ZERO, sign_of(p[2]))
    if x[2] > past:
        past = x[2]
        g = vec3(x[0], ZERO, x[1])
    if y[2] > past:
        past = y[2]
        g = vec3(ZERO, y[0], y[1])
    g = bent_gradient(g, p, q, s)
    slope = wp.length(g)
    return vec4(g[0] / slope, g[1] / slope, g[2] / slope, past / slope)


@wp.func
def superquadric_is_plain(s: SuperquadricShape, pose: transform):
    """Whether a body is neither bent nor so tapered that its frustum counts, and all numbers of it
    are finite: what `superquadric_lanes` takes."""
    place = wp.transform_get_translation(pose)
    turn = wp.transform_get_rotation(pose)
    known = wp.isfinite(wp.length_sq(s.size) + s.e1 + s.e2 + s.kx + s.ky + wp.length_sq(place)
                        + wp.dot(turn, turn))
    strong = wp.abs(s.kx) > _STRONG or wp.abs(s.ky) > _STRONG
    return known and s.bend <= _STRAIGHT and not strong


@wp.func
def sdf_superquadric_bound_grad(p: vec3, s: SuperquadricShape):
    """Unit gradient and first-order distance (nx, ny, nz, d) [m], see the module's text."""
    q = straighten(p, s)
    g = deformed_gradient(superquadric_gauge(q.point, s.size, s.e1, s.e2), p, q, s)
    slope = wp.max(wp.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2]), TINY)
    distance = (g[3] - ONE) / slope
    # No straight body reaches beyond its ends. Over a ridge the gauge's slope is that of its sides.
    beyond = vec4(ZERO, ZERO, sign_of(p[2]), wp.abs(p[2]) - s.size[2])
    if wp.max(wp.abs(s.kx), wp.abs(s.ky)) > _STRONG:
        beyond = _past_frustum(p, q, s)
    elif s.bend > _STRAIGHT:
        beyond[3] = distance
    if beyond[3] > wp.max(distance, ZERO):
        return beyond
    return vec4(g[0] / slope, g[1] / slope, g[2] / slope, distance)
