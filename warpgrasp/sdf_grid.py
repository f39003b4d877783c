"""Distances baked on a regular grid: trilinear value, and the gradient of that very interpolant."""

import warp as wp

from warpgrasp.real import ONE, TINY, ZERO, real, vec3, vec4


@wp.func
def sdf_grid_grad(
    p: vec3, values: wp.array[wp.float32], first: int, nodes: wp.vec3i, origin: vec3, cell: real
):
    """Gradient and distance (gx, gy, gz, d) [m] of a grid of node values starting at `first`.

    Nodes are numbered x slowest, z fastest, the first at `origin`. Outside the grid the value is
    the lower bound sqrt(gap^2 + d^2), d the value at the nearest point of the grid: the object lies
    inside the grid, so the angle at that point is obtuse.
    """
    high = vec3(real(nodes[0] - 1), real(nodes[1] - 1), real(nodes[2] - 1)) * cell
    q = p - origin
    c = vec3(wp.clamp(q[0], ZERO, high[0]), wp.clamp(q[1], ZERO, high[1]),
             wp.clamp(q[2], ZERO, high[2]))
    ix = wp.min(int(c[0] / cell), nodes[0] - 2)
    iy = wp.min(int(c[1] / cell), nodes[1] - 2)
    iz = wp.min(int(c[2] / cell), nodes[2] - 2)
    fx = c[0] / cell - real(ix)
    fy = c[1] / cell - real(iy)
    fz = c[2] / cell - real(iz)
    row = nodes[2]
    sheet = nodes[1] * nodes[2]
    at = first + ix * sheet + iy * row + iz
    v000 = real(values[at])
    v001 = real(values[at + 1])
    v010 = real(values[at + row])
    v011 = real(values[at + row + 1])
    v100 = real(values[at + sheet])
    v101 = real(values[at + sheet + 1])
    v110 = real(values[at + sheet + row])
    v111 = real(values[at + sheet + row + 1])
    v00 = v000 + (v001 - v000) * fz
    v01 = v010 + (v011 - v010) * fz
    v10 = v100 + (v101 - v100) * fz
    v11 = v110 + (v111 - v110) * fz
    v0 = v00 + (v01 - v00) * fy
    v1 = v10 + (v11 - v10) * fy
    d = v0 + (v1 - v0) * fx
    gx = (v1 - v0) / cell
    gy = ((v01 - v00) * (ONE - fx) + (v11 - v10) * fx) / cell
    gz0 = (v001 - v000) * (ONE - fy) + (v011 - v010) * fy
    gz1 = (v101 - v100) * (ONE - fy) + (v111 - v110) * fy
    gz = (gz0 * (ONE - fx) + gz1 * fx) / cell
    gap = q - c
    gap_length = wp.length(gap)
    if gap_length > TINY and d > ZERO:
        bound = wp.sqrt(gap_length * gap_length + d * d)
        g = (gap + vec3(gx, gy, gz) * d) / bound
        return vec4(g[0], g[1], g[2], bound)
    return vec4(gx, gy, gz, d)
