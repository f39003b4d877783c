# type: ignore  # Warp functions, which type checkers cannot follow
"""Where two line segments are nearest (Ericson 2005, Real-time collision detection, 5.1.9)."""

import warp as wp

from warpgrasp.core.dtypes import ONE, ZERO, real, struct, vec3

_TINY = wp.constant(real(1e-12))  # [m2]


@struct
class Nearest:
    """The nearest points of two segments, the unit vector from the second to the first, and how far
    they are apart [m]."""

    one: vec3
    two: vec3
    way: vec3
    apart: real


@wp.func
def segment_pair(a: vec3, b: vec3, c: vec3, d: vec3):
    """Segment `a` to `b` against `c` to `d`, neither of length 0."""
    u = b - a
    v = d - c
    r = a - c
    uu = wp.dot(u, u)
    vv = wp.dot(v, v)
    uv = wp.dot(u, v)
    ur = wp.dot(u, r)
    vr = wp.dot(v, r)
    s = ZERO
    across = uu * vv - uv * uv
    if across > _TINY * uu * vv:
        s = wp.clamp((uv * vr - ur * vv) / across, ZERO, ONE)
    t = (uv * s + vr) / vv
    if t < ZERO:
        t = ZERO
        s = wp.clamp(-ur / uu, ZERO, ONE)
    elif t > ONE:
        t = ONE
        s = wp.clamp((uv - ur) / uu, ZERO, ONE)
    found = Nearest()
    found.one = a + u * s
    found.two = c + v * t
    between = found.one - found.two
    found.apart = wp.length(between)
    found.way = between / wp.max(found.apart, _TINY)
    return found
