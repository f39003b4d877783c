# type: ignore  # Warp functions, which type checkers cannot follow
"""Silhouettes in a kernel: rays of pinhole cameras, sphere-traced."""

import warp as wp

from warpgrasp.core.dtypes import HALF, ONE, mat33, real, transform, vec3
from warpgrasp.geometry.scene import Scene, body_distance

_MARCHES = wp.constant(200)
_HIT = wp.constant(real(2e-4))  # [m]


@wp.kernel(enable_backward=False)
def _silhouette_kernel(
    first: int,
    # Scene:
    scene: Scene,
    body: wp.array[int],
    body_pose: wp.array[transform],
    march_scale: real,
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
    to_body = wp.transform_inverse(body_pose[w])
    middle = real(seen.shape[2]) * HALF
    x = (real(column) + HALF - middle) / focal
    y = (real(row) + HALF - middle) / focal
    ray = wp.transform_vector(to_body, wp.normalize(axes[w, camera] * vec3(x, y, ONE)))
    start = wp.transform_point(to_body, centre[w, camera])
    t = real(0.0)
    seen[w, camera, row, column] = wp.uint8(0)
    for _ in range(_MARCHES):
        d = body_distance(scene, body[w], start + ray * t)
        if d < _HIT:
            seen[w, camera, row, column] = wp.uint8(1)
            return
        t += wp.max(d * march_scale, _HIT * HALF)
        if t > reach:
            return
