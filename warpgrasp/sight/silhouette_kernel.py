# type: ignore  # Warp functions, which type checkers cannot follow
"""Silhouettes and ranges in kernels: rays of pinhole cameras, sphere-traced."""

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, ZERO, mat33, real, transform, vec3
from warpgrasp.geometry.scene import Scene, body_distance

_MARCHES = wp.constant(200)
_HIT = wp.constant(real(2e-4))  # [m]
_HALVINGS = wp.constant(40)


@wp.func
def _entry(scene: Scene, body: int, start: vec3, ray: vec3, outside: real, inside: real):
    """Where a ray enters the body, between a place outside it and one inside [m]."""
    low = outside
    high = inside
    for _ in range(_HALVINGS):
        middle = HALF * (low + high)
        if body_distance(scene, body, start + ray * middle) < _HIT:
            high = middle
        else:
            low = middle
        if high - low < _HIT * HALF:
            break
    return high


@wp.func
def _range(
    scene: Scene, body: int, to_body: transform, centre: vec3, axes: mat33, focal: real,
    pixels: int, row: int, column: int, reach: real
):
    """How far along a pixel's ray the object is [m]; negative where it is not."""
    middle = real(pixels) * HALF
    x = (real(column) + HALF - middle) / focal
    y = (real(row) + HALF - middle) / focal
    ray = wp.transform_vector(to_body, wp.normalize(axes * vec3(x, y, ONE)))
    start = wp.transform_point(to_body, centre)
    t = real(0.0)
    outside = real(0.0)
    for _ in range(_MARCHES):
        d = body_distance(scene, body, start + ray * t)
        if d < -_HIT:
            # A distance to first order may be too long: the last step led into the body.
            return _entry(scene, body, start, ray, outside, t)
        if d < _HIT:
            return t
        outside = t
        t += wp.max(d, _HIT * HALF)
        if t > reach:
            return -ONE
    return -ONE


@wp.kernel(enable_backward=False)
def _silhouette_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Camera in:
    centre: wp.array2d[vec3],
    axes: wp.array2d[mat33],
    focal: real,
    reach: real,
    # Image out:
    seen: wp.array4d[wp.uint8],
):
    w, camera, row, column = wp.tid()
    w += first
    far = _range(scene, body[w], wp.transform_inverse(body_pose[w]), centre[w, camera],
                 axes[w, camera], focal, seen.shape[2], row, column, reach)
    seen[w, camera, row, column] = wp.uint8(far >= ZERO)


@wp.kernel(enable_backward=False)
def _range_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    # Camera in:
    centre: wp.array2d[vec3],
    axes: wp.array2d[mat33],
    focal: real,
    reach: real,
    # Image out, negative where the object is not:
    far: wp.array4d[real],
):
    w, camera, row, column = wp.tid()
    w += first
    far[w, camera, row, column] = _range(
        scene, body[w], wp.transform_inverse(body_pose[w]), centre[w, camera], axes[w, camera],
        focal, far.shape[2], row, column, reach)
