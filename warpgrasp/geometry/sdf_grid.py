# type: ignore  # Warp functions, which type checkers cannot follow
"""Distances baked on a regular grid: a quadratic B-spline of the nodes, and its very gradient.

The spline's gradient is continuous, and a finger's rest is found in a few Newton steps; between
linear pieces a descent stalls on their kinks. Its weights are positive and sum to one, so it is as
1-Lipschitz as the nodes; where the distance curves it lies cell^2 / 8 times the curvature off.

The nodes reach `GRID_MARGIN_M`, m, beyond the object's box. Outside the grid the value is a lower
bound. Let c be the nearest point of the grid to a point p, d the value there, and w = p - c. Every
place x of the object is at least m behind each side of the grid that p is beyond. So
|p - x|^2 = |c - x|^2 + 2 (c - x).w + |w|^2 >= d^2 + 2 m (|wx| + |wy| + |wz|) + |w|^2.
Before a face of the box this is the distance itself.
"""

import warp as wp

from warpgrasp.core.dtypes import HALF, TINY, ZERO, real, vec3, vec4

GRID_MARGIN_M = 0.016
"""All around the object: skin that touches has its link's axis 8 mm away, inside the grid."""
_MARGIN = wp.constant(real(GRID_MARGIN_M))
_THREE_QUARTERS = wp.constant(real(0.75))
_TWO = wp.constant(real(2.0))


@wp.func
def _spline(f: real):
    """Weights of the nodes at -1, 0 and 1 for a place `f` cells from the middle one."""
    low = HALF - f
    high = HALF + f
    return vec3(HALF * low * low, _THREE_QUARTERS - f * f, HALF * high * high)


@wp.func
def _spline_slope(f: real):
    """Derivatives of `_spline`."""
    return vec3(f - HALF, -_TWO * f, f + HALF)


@wp.func
def _sheet(
    values: wp.array[wp.float32], at: int, row: int, wy: vec3, sy: vec3, wz: vec3, sz: vec3
):
    """Value and slopes along y and z of nine nodes of one x, the middle one at `at`."""
    a = vec3(real(values[at - row - 1]), real(values[at - row]), real(values[at - row + 1]))
    b = vec3(real(values[at - 1]), real(values[at]), real(values[at + 1]))
    c = vec3(real(values[at + row - 1]), real(values[at + row]), real(values[at + row + 1]))
    v = vec3(wp.dot(wz, a), wp.dot(wz, b), wp.dot(wz, c))
    s = vec3(wp.dot(sz, a), wp.dot(sz, b), wp.dot(sz, c))
    return vec3(wp.dot(wy, v), wp.dot(sy, v), wp.dot(wy, s))


@wp.func
def _beyond(gap: real, slope: real, d: real):
    """Half the slope of the bound's square along one axis."""
    if gap == ZERO:
        return slope * d
    return gap + wp.where(gap > ZERO, _MARGIN, -_MARGIN)


@wp.func(inline=False)
def sdf_grid_grad(
    p: vec3, values: wp.array[wp.float32], first: int, nodes: wp.vec3i, origin: vec3, cell: real
):
    """Gradient and distance (gx, gy, gz, d) [m] of a grid of node values starting at `first`.

    Nodes are numbered x slowest, z fastest, the first at `origin`.
    """
    high = vec3(real(nodes[0] - 1), real(nodes[1] - 1), real(nodes[2] - 1)) * cell
    q = p - origin
    c = vec3(wp.clamp(q[0], ZERO, high[0]), wp.clamp(q[1], ZERO, high[1]),
             wp.clamp(q[2], ZERO, high[2]))
    x = c[0] / cell
    y = c[1] / cell
    z = c[2] / cell
    # The node nearest to the place, but for the outermost.
    ix = wp.clamp(int(x + HALF), 1, nodes[0] - 2)
    iy = wp.clamp(int(y + HALF), 1, nodes[1] - 2)
    iz = wp.clamp(int(z + HALF), 1, nodes[2] - 2)
    wx = _spline(x - real(ix))
    wy = _spline(y - real(iy))
    wz = _spline(z - real(iz))
    sx = _spline_slope(x - real(ix))
    sy = _spline_slope(y - real(iy))
    sz = _spline_slope(z - real(iz))
    row = nodes[2]
    sheet = nodes[1] * nodes[2]
    at = first + ix * sheet + iy * row + iz
    v0 = _sheet(values, at - sheet, row, wy, sy, wz, sz)
    v1 = _sheet(values, at, row, wy, sy, wz, sz)
    v2 = _sheet(values, at + sheet, row, wy, sy, wz, sz)
    v = v0 * wx[0] + v1 * wx[1] + v2 * wx[2]
    d = v[0]
    gx = (v0[0] * sx[0] + v1[0] * sx[1] + v2[0] * sx[2]) / cell
    gy = v[1] / cell
    gz = v[2] / cell
    gap = q - c
    gap_length = wp.length(gap)
    if gap_length > TINY and d > ZERO:
        bound = wp.sqrt(d * d + gap_length * gap_length
                        + _TWO * _MARGIN * (wp.abs(gap[0]) + wp.abs(gap[1]) + wp.abs(gap[2])))
        # Along an axis that is clamped only the gap grows.
        g = vec3(_beyond(gap[0], gx, d), _beyond(gap[1], gy, d), _beyond(gap[2], gz, d)) / bound
        return vec4(g[0], g[1], g[2], bound)
    return vec4(gx, gy, gz, d)


@wp.kernel(enable_backward=False)
def mesh_distance_kernel(
    first: int,
    # Mesh:
    mesh: wp.uint64,
    # Query in:
    point: wp.array[wp.vec3f],
    accuracy: wp.float32,
    winding: wp.float32,
    # Distance out:
    distance: wp.array[wp.float32],
):
    """Signed distances of points to a mesh: what a grid is baked from."""
    i = wp.tid() + first
    query = wp.mesh_query_point_sign_winding_number(mesh, point[i], 10.0, accuracy, winding)
    nearest = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
    distance[i] = query.sign * wp.length(point[i] - nearest)


@wp.kernel(enable_backward=False)
def simple_mesh_distance_kernel(
    first: int,
    # Mesh:
    mesh: wp.uint64,
    # Query in:
    point: wp.array[wp.vec3f],
    # Distance out:
    distance: wp.array[wp.float32],
):
    """Signed distances of points to a closed mesh that does not cross itself, by rays."""
    i = wp.tid() + first
    query = wp.mesh_query_point_sign_parity(mesh, point[i], 10.0)
    nearest = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
    distance[i] = query.sign * wp.length(point[i] - nearest)


@wp.kernel(enable_backward=False)
def mesh_gap_kernel(
    first: int,
    # Mesh:
    mesh: wp.uint64,
    # Query in:
    point: wp.array[wp.vec3f],
    # Distance out:
    distance: wp.array[wp.float32],
):
    """Distances of points to a mesh, on whichever side of it they are."""
    i = wp.tid() + first
    query = wp.mesh_query_point_no_sign(mesh, point[i], 10.0)
    nearest = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
    distance[i] = wp.length(point[i] - nearest)
