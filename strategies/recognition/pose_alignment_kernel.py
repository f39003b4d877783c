# type: ignore  # Warp functions, which type checkers cannot follow
"""Known bodies aligned with touches: Gauss-Newton on x, y and the yaw, in a kernel."""

import warp as wp

from warpgrasp.core.dtypes import ONE, ZERO, real, vec3, vec4
from warpgrasp.geometry.scene import Scene, body_distance_grad

ITERATIONS = 8
CAP = 3.0
"""Cap of a touch's deviation from a body, so that one bad touch does not decide."""
_ITERATIONS = wp.constant(ITERATIONS)
_CAP = wp.constant(real(CAP))
_MOST_MOVE = wp.constant(real(0.3))  # of one iteration [m], [rad]
_RIDGE = wp.constant(real(10.0))  # of x and y; the turn is of other units
_TURN_RIDGE = wp.constant(real(1e-3))
wp.set_module_options({"max_unroll": 1})  # one copy of the distance, which is then inlined


@wp.func
def _distance_at(scene: Scene, body: int, pose: vec3, c: real, s: real, p: vec3):
    """Slopes in x, y and the turn, and the distance, of the body at (x, y, turn)."""
    dx = p[0] - pose[0]
    dy = p[1] - pose[1]
    local = vec3(c * dx + s * dy, c * dy - s * dx, p[2])
    g = body_distance_grad(scene, body, local)
    slope = vec3(-(c * g[0] - s * g[1]), -(s * g[0] + c * g[1]), g[0] * local[1] - g[1] * local[0])
    if wp.isnan(slope[0]) or wp.isnan(slope[1]) or wp.isnan(slope[2]):
        slope = vec3(ZERO, ZERO, ZERO)
    return vec4(slope[0], slope[1], slope[2], g[3])


@wp.func
def _solve(a: vec3, b: vec3, right: vec3):
    """x of the symmetric system with diagonal a and (01, 02, 12) = b, by Cholesky."""
    l00 = wp.sqrt(a[0])
    l10 = b[0] / l00
    l20 = b[1] / l00
    l11 = wp.sqrt(a[1] - l10 * l10)
    l21 = (b[2] - l20 * l10) / l11
    l22 = wp.sqrt(a[2] - l20 * l20 - l21 * l21)
    y0 = right[0] / l00
    y1 = (right[1] - l10 * y0) / l11
    y2 = (right[2] - l20 * y0 - l21 * y1) / l22
    x2 = y2 / l22
    x1 = (y1 - l21 * x2) / l11
    return vec3((y0 - l10 * x1 - l20 * x2) / l00, x1, x2)


@wp.kernel(enable_backward=False)
def _placement_kernel(
    first: int,
    # Bodies in:
    scene: Scene,
    body: wp.array[int],
    start: wp.array[real],
    turns: wp.array[int],
    # Touches in:
    point: wp.array2d[vec3],
    kept: wp.array2d[int],
    deviation: wp.array2d[real],
    centre: wp.array2d[real],
    # Placement out:
    square: wp.array2d[real],
):
    w, k = wp.tid()
    w += first
    pose = vec3(centre[w, 0], centre[w, 1], start[k])
    for _ in range(_ITERATIONS):
        c = wp.cos(pose[2])
        s = wp.sin(pose[2])
        diagonal = vec3(_RIDGE, _RIDGE, _TURN_RIDGE)
        beside = vec3(ZERO, ZERO, ZERO)
        right = vec3(ZERO, ZERO, ZERO)
        for i in range(point.shape[1]):
            if kept[w, i] == 0:
                continue
            d = _distance_at(scene, body[k], pose, c, s, point[w, i])
            far = d[3] / (deviation[w, i] * _CAP)
            drawn = (ONE + far * far) * deviation[w, i]
            weight = ONE / (drawn * drawn)
            j = vec3(d[0], d[1], d[2])
            diagonal += weight * wp.cw_mul(j, j)
            beside += weight * vec3(j[0] * j[1], j[0] * j[2], j[1] * j[2])
            right += (weight * d[3]) * j
        step = _solve(diagonal, beside, right)
        turn = wp.clamp(step[2], -_MOST_MOVE, _MOST_MOVE)
        if turns[k] == 0:
            turn = ZERO
        pose -= vec3(wp.clamp(step[0], -_MOST_MOVE, _MOST_MOVE),
                     wp.clamp(step[1], -_MOST_MOVE, _MOST_MOVE), turn)
    c = wp.cos(pose[2])
    s = wp.sin(pose[2])
    total = real(0.0)
    count = int(0)
    for i in range(point.shape[1]):
        if kept[w, i] == 0:
            continue
        d = _distance_at(scene, body[k], pose, c, s, point[w, i])
        r = d[3] / deviation[w, i]
        total += wp.min(r * r, _CAP * _CAP)
        count += 1
    square[w, k] = total / real(wp.max(count, 1))
