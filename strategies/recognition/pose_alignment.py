"""Known bodies laid on touches: Gauss-Newton on x, y and the turn about the vertical, in a kernel.

One thread lays one body on one world's touches from one turn. Far touches are drawn in by the
weights of Geman and McClure 1985.
"""

import numpy as np
import warp as wp

from strategies.recognition.pose_alignment_kernel import _placement_kernel
from warpgrasp.core.array_checks import check_range
from warpgrasp.core.dtypes import real, vec3
from warpgrasp.core.kernel_launch import ShapeError, array_of, launch
from warpgrasp.geometry.scene import Scene


def placed_squares(
    scene: Scene, turns: list[np.ndarray], points_m: np.ndarray, mask: np.ndarray,
    sigma_m: np.ndarray, centre_m: np.ndarray, *, device: str
) -> np.ndarray:
    """Mean capped square of the best placement of each body of `scene`, (world, body).

    `turns` are the turns [rad] each body starts from; one alone is kept, for a turn does not change
    that body. Touches are (world, point, 3), their mask and standard deviations (world, point),
    where bodies start (world, 2). Raises ShapeError where shapes disagree, ValueError for turns of
    bodies that the scene has not.
    """
    check_range("number of turns", len(turns), 1, scene.bodies)
    for name, shape in ("mask", mask.shape), ("sigma_m", sigma_m.shape):
        if shape != points_m.shape[:2]:
            raise ShapeError(f"placed squares: {name!r} has shape {shape}, wants "
                             f"{points_m.shape[:2]}")
    # Most slots are empty: the touches first, in their order.
    first = np.argsort(~mask, axis=1, kind="stable")[:, :max(int(mask.sum(1).max(initial=0)), 1)]
    points_m = np.take_along_axis(points_m, first[..., None], 1)
    mask, sigma_m = (np.take_along_axis(values, first, 1) for values in (mask, sigma_m))
    counts = [len(starts) for starts in turns]
    body = np.repeat(np.arange(len(turns)), counts)
    start = np.concatenate(turns)
    out = wp.empty((len(points_m), len(body)), dtype=real, device=device)
    launch(_placement_kernel, {"world": len(points_m), "start": len(body)}, {
        "body": "start", "start": "start", "turns": "start", "point": "world point",
        "kept": "world point", "deviation": "world point", "centre": "world 2",
        "square": "world start"}, {
        "scene": scene, "body": array_of(body, int, device),
        "start": array_of(start, real, device),
        "turns": array_of(np.repeat(np.array(counts) > 1, counts), int, device),
        "point": array_of(points_m, vec3, device),
        "kept": array_of(mask, int, device),
        "deviation": array_of(sigma_m, real, device),
        "centre": array_of(centre_m, real, device), "square": out}, device=device)
    firsts = np.cumsum([0, *counts[:-1]])
    return np.minimum.reduceat(out.numpy(), firsts, axis=1)
