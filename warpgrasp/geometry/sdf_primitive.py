# type: ignore  # Warp functions, which type checkers cannot follow
"""Signed distances of simple solids, each with its gradient, as Warp functions.

Negative inside. Every solid stands on z = 0 of its own frame, on the z axis, as an object stands
on a table. `sdf_x` is the distance [m], `sdf_x_grad` its gradient (unit length where the distance
is differentiable) and the distance, (gx, gy, gz, d), computed together. All are exact, hence
1-Lipschitz, after the constructions in Quilez, "3D SDFs".
"""

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, TINY, ZERO, greater, lesser, real, vec2, vec3, vec4


@wp.func
def sign_of(x: real):
    """-1 for negative numbers, else 1 (never 0)."""
    if x < ZERO:
        return -ONE
    return ONE


@wp.func
def _from_offset(v: vec3, radius: real):
    """Gradient and distance outside a body whose nearest point, or its `radius`, is `v` away."""
    n = wp.length(v)
    if n < TINY:
        return vec4(ZERO, ZERO, ONE, n - radius)
    scale = ONE / n
    return vec4(v[0] * scale, v[1] * scale, v[2] * scale, n - radius)


@wp.func
def sdf_block(p: vec3, size: vec3):
    """Block of full `size`, standing on z = 0."""
    h = size * HALF
    q = vec3(wp.abs(p[0]) - h[0], wp.abs(p[1]) - h[1], wp.abs(p[2] - h[2]) - h[2])
    most = greater(q[0], q[1])
    least = lesser(q[0], q[1])
    if greater(least, lesser(most, q[2])) > ZERO:
        return wp.length(vec3(greater(q[0], ZERO), greater(q[1], ZERO), greater(q[2], ZERO)))
    return greater(most, q[2])  # over a face, or inside: no root


@wp.func
def sdf_block_grad(p: vec3, size: vec3):
    """Gradient and distance of `sdf_block`."""
    h = size * HALF
    c = vec3(p[0], p[1], p[2] - h[2])
    q = vec3(wp.abs(c[0]) - h[0], wp.abs(c[1]) - h[1], wp.abs(c[2]) - h[2])
    s = vec3(sign_of(c[0]), sign_of(c[1]), sign_of(c[2]))
    if q[0] > ZERO or q[1] > ZERO or q[2] > ZERO:
        return _from_offset(vec3(s[0] * greater(q[0], ZERO), s[1] * greater(q[1], ZERO),
                                 s[2] * greater(q[2], ZERO)), ZERO)
    if q[0] >= q[1] and q[0] >= q[2]:
        return vec4(s[0], ZERO, ZERO, q[0])
    if q[1] >= q[2]:
        return vec4(ZERO, s[1], ZERO, q[1])
    return vec4(ZERO, ZERO, s[2], q[2])


@wp.func
def sdf_cylinder(p: vec3, radius: real, height: real):
    """Upright cylinder standing on z = 0."""
    a = wp.sqrt(p[0] * p[0] + p[1] * p[1]) - radius
    b = wp.abs(p[2] - height * HALF) - height * HALF
    if lesser(a, b) > ZERO:
        return wp.sqrt(a * a + b * b)
    return greater(a, b)  # beside or above it, or inside


@wp.func
def sdf_cylinder_grad(p: vec3, radius: real, height: real):
    """Gradient and distance of `sdf_cylinder`."""
    rho = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    radial = vec3(wp.where(rho > TINY, p[0] / rho, ONE), wp.where(rho > TINY, p[1] / rho, ZERO),
                  ZERO)
    axial = vec3(ZERO, ZERO, sign_of(p[2] - height * HALF))
    a = rho - radius
    b = wp.abs(p[2] - height * HALF) - height * HALF
    if a > ZERO or b > ZERO:
        return _from_offset(radial * greater(a, ZERO) + axial * greater(b, ZERO), ZERO)
    if a >= b:
        return vec4(radial[0], radial[1], ZERO, a)
    return vec4(ZERO, ZERO, axial[2], b)


@wp.func
def sdf_sphere(p: vec3, radius: real):
    """Sphere touching z = 0 from above."""
    return wp.length(p - vec3(ZERO, ZERO, radius)) - radius


@wp.func
def sdf_sphere_grad(p: vec3, radius: real):
    """Gradient and distance of `sdf_sphere`."""
    return _from_offset(p - vec3(ZERO, ZERO, radius), radius)


@wp.func
def sdf_capsule(p: vec3, radius: real, height: real):
    """Upright capsule of full `height` (at least 2 radius), standing on z = 0."""
    z = wp.clamp(p[2], radius, greater(radius, height - radius))
    return wp.length(p - vec3(ZERO, ZERO, z)) - radius


@wp.func
def sdf_capsule_grad(p: vec3, radius: real, height: real):
    """Gradient and distance of `sdf_capsule`."""
    z = wp.clamp(p[2], radius, greater(radius, height - radius))
    return _from_offset(p - vec3(ZERO, ZERO, z), radius)


@wp.func
def _nearest_on_segment(p: vec2, a: vec2, b: vec2):
    t = wp.dot(p - a, b - a) / greater(wp.dot(b - a, b - a), TINY)
    return a + (b - a) * wp.clamp(t, ZERO, ONE)


@wp.func
def _wedge_section(p: vec2, half: real, height: real):
    """Offset from the nearest point of an isosceles triangle's outline (x >= 0 half), and side."""
    x = wp.abs(p[0])
    foot = _nearest_on_segment(vec2(x, p[1]), vec2(half, ZERO), vec2(ZERO, height))
    base = vec2(lesser(x, half), ZERO)
    d_side = vec2(x, p[1]) - foot
    d_base = vec2(x, p[1]) - base
    inside = p[1] > ZERO and height * x + half * (p[1] - height) < ZERO
    nearest = d_side
    if wp.length(d_base) < wp.length(d_side):
        nearest = d_base
    s = ONE
    if inside:
        s = -ONE
    return vec3(nearest[0], nearest[1], s)


@wp.func
def sdf_wedge(p: vec3, size: vec3):
    """Triangular wedge: base `size` x by y on z = 0, a ridge along y at height `size` z."""
    w = _wedge_section(vec2(p[0], p[2]), size[0] * HALF, size[2])
    a = w[2] * wp.sqrt(w[0] * w[0] + w[1] * w[1])
    b = wp.abs(p[1]) - size[1] * HALF
    out = vec2(greater(a, ZERO), greater(b, ZERO))
    return wp.length(out) + lesser(greater(a, b), ZERO)


@wp.func
def sdf_wedge_grad(p: vec3, size: vec3):
    """Gradient and distance of `sdf_wedge`."""
    half = size[0] * HALF
    w = _wedge_section(vec2(p[0], p[2]), half, size[2])
    length = wp.sqrt(w[0] * w[0] + w[1] * w[1])
    slope = wp.sqrt(half * half + size[2] * size[2])
    section = vec3(size[2] / slope, ZERO, half / slope)
    if length > TINY:
        section = vec3(w[2] * w[0] / length, ZERO, w[2] * w[1] / length)
    section = vec3(section[0] * sign_of(p[0]), ZERO, section[2])
    side = vec3(ZERO, sign_of(p[1]), ZERO)
    a = w[2] * length
    b = wp.abs(p[1]) - size[1] * HALF
    if a > ZERO or b > ZERO:
        return _from_offset(section * greater(a, ZERO) + side * greater(b, ZERO), ZERO)
    if a >= b:
        return vec4(section[0], section[1], section[2], a)
    return vec4(side[0], side[1], side[2], b)


@wp.func
def _nearer(best: vec3, p: vec2, a: vec2, b: vec2):
    """(offset, squared distance) of the nearer of `best` and the segment from `a` to `b`."""
    d = p - _nearest_on_segment(p, a, b)
    sq = wp.dot(d, d)
    if sq < best[2]:
        return vec3(d[0], d[1], sq)
    return best


@wp.func
def sdf_revolution_section(rho: real, z: real, profile: wp.array[vec2], first: int, count: int):
    """Signed offset (rho, z, sign) from the nearest point of a profile closed by its two ends.

    `profile` holds (z, r) [m] with z rising; the solid lies between the polyline and the axis.
    The nearest point is exact: from the segment at the point's own height outwards, until the
    next one's whole band of heights is farther than the best so far.
    """
    p = vec2(rho, z)
    low = profile[first]
    high = profile[first + count - 1]
    d = p - vec2(lesser(rho, low[1]), low[0])
    best = vec3(d[0], d[1], wp.dot(d, d))
    d = p - vec2(lesser(rho, high[1]), high[0])
    if wp.dot(d, d) < best[2]:
        best = vec3(d[0], d[1], wp.dot(d, d))
    # The segment at this height, or the end one.
    k = int(0)
    above = int(count - 1)
    while above - k > 1:
        middle = (k + above) // 2
        if profile[first + middle][0] <= z:
            k = middle
        else:
            above = middle
    at = profile[first + k]
    b = profile[first + above]
    best = _nearer(best, p, vec2(at[1], at[0]), vec2(b[1], b[0]))
    s = ONE
    if z >= at[0] and z < b[0]:
        if rho < at[1] + (b[1] - at[1]) * (z - at[0]) / (b[0] - at[0]):
            s = -ONE
    a = at
    for i in range(k):
        gap = greater(z - a[0], ZERO)
        if gap * gap >= best[2]:
            break
        c = profile[first + k - 1 - i]
        best = _nearer(best, p, vec2(c[1], c[0]), vec2(a[1], a[0]))
        a = c
    for i in range(above + 1, count):
        gap = greater(b[0] - z, ZERO)
        if gap * gap >= best[2]:
            break
        c = profile[first + i]
        best = _nearer(best, p, vec2(b[1], b[0]), vec2(c[1], c[0]))
        b = c
    return vec3(best[0], best[1], s)


@wp.func
def sdf_revolution(p: vec3, profile: wp.array[vec2], first: int, count: int):
    """Solid of revolution about z of a radius profile of linear segments."""
    rho = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    w = sdf_revolution_section(rho, p[2], profile, first, count)
    return w[2] * wp.sqrt(w[0] * w[0] + w[1] * w[1])


@wp.func
def sdf_revolution_grad(p: vec3, profile: wp.array[vec2], first: int, count: int):
    """Gradient and distance of `sdf_revolution`."""
    rho = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    w = sdf_revolution_section(rho, p[2], profile, first, count)
    radial = vec2(ONE, ZERO)
    if rho > TINY:
        radial = vec2(p[0] / rho, p[1] / rho)
    length = wp.sqrt(w[0] * w[0] + w[1] * w[1])
    if length < TINY:
        return vec4(radial[0], radial[1], ZERO, w[2] * length)
    s = w[2] / length
    return vec4(radial[0] * w[0] * s, radial[1] * w[0] * s, w[1] * s, w[2] * length)
