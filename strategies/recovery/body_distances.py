"""Distances and normals of recovered bodies at points, in kernels."""

from typing import Any

import numpy as np
import warp as wp

from fit.revolution.geometry import RevolutionBody
from fit.superquadric.geometry import SuperquadricLike
from strategies.recovery.body_distances_kernel import (
    _contour_kernel,
    _distance_kernel,
    _radial_kernel,
)
from warpgrasp.core.dtypes import real, transform, vec3, vec4
from warpgrasp.core.kernel_launch import array_of, launch
from warpgrasp.core.lanes import LANES, has_lanes
from warpgrasp.core.struct_array import record_type
from warpgrasp.geometry.sdf_superquadric import SuperquadricShape


def surface_distances(
    body: SuperquadricLike, points_m: np.ndarray, kept: np.ndarray, *, device: str = "cpu"
) -> tuple[np.ndarray, np.ndarray]:
    """First-order signed distances [m] of points (world, point, 3), (world, point), and the unit
    normals outwards there, (world, point, 3).

    The scaled radius beyond one over its slope. 1 m and a normal of no length where not `kept` and
    where a body has no gradient. Raises ShapeError where shapes disagree.
    """
    distance = wp.empty(points_m.shape[:2], dtype=real, device=device)
    normal = wp.empty(points_m.shape[:2], dtype=vec3, device=device)
    _ask(_distance_kernel, body, points_m, kept,
         {"distance": distance, "normal": normal}, device)
    return distance.numpy(), normal.numpy()


def radial_distances(
    body: SuperquadricLike, points_m: np.ndarray, kept: np.ndarray, *, device: str = "cpu"
) -> np.ndarray:
    """Signed distances [m] of points (world, point, 3) along the rays from the bodies' centres,
    (world, point); inf where not `kept`. Raises ShapeError where shapes disagree."""
    distance = wp.empty(points_m.shape[:2], dtype=real, device=device)
    _ask(_radial_kernel, body, points_m, kept, {"distance": distance}, device)
    return distance.numpy()


def contour_distances(
    body: RevolutionBody, points_m: np.ndarray, kept: np.ndarray, *, device: str = "cpu"
) -> np.ndarray:
    """Unsigned distances [m] of points (world, point, 3) to bodies of revolution, ends and all,
    (world, point); inf where not `kept` and where a body has no contour.

    Those of `fit.revolution.geometry.revolution_distance`. Raises ShapeError where shapes disagree.
    """
    distance = wp.empty(points_m.shape[:2], dtype=real, device=device)
    launch(_contour_kernel, {"world": len(points_m), "point": points_m.shape[1]}, {
        **dict.fromkeys(("foot", "axis"), "world"),
        **dict.fromkeys(("height", "radius"), "world node"),
        **dict.fromkeys(("point", "kept", "distance"), "world point")}, {
        "foot": array_of(body.foot_m, vec3, device),
        "axis": array_of(body.axis, vec3, device),
        "height": array_of(body.height_m, real, device),
        "radius": array_of(body.radius_m, real, device),
        "point": array_of(points_m, vec3, device),
        "kept": array_of(kept, wp.bool, device), "distance": distance},
        device=device)
    return distance.numpy()


def _ask(
    kernel: Any, body: SuperquadricLike, points_m: np.ndarray, kept: np.ndarray,
    others: dict[str, Any], device: str
) -> None:
    shape, pose = bodies_on(body, device)
    launch(kernel, {"world": len(points_m), "group": -(-points_m.shape[1] // LANES)}, {
        "shape": "world", "pose": "world",
        **dict.fromkeys(("point", "kept", "gauge", "distance", "normal"), "world point")}, {
        "has_lanes": has_lanes(device), "shape": shape, "pose": pose,
        "point": array_of(points_m, vec3, device), "kept": array_of(kept, wp.bool, device),
        "gauge": wp.empty(points_m.shape[:2], dtype=vec4, device=device), **others},
        device=device)


def bodies_on(body: SuperquadricLike, device: str) -> tuple[wp.array, wp.array]:
    """The kernels' shapes and poses of recovered bodies."""
    rows = np.zeros(len(body.size_m), dtype=record_type(SuperquadricShape))
    rows["size"] = body.size_m
    rows["e1"], rows["e2"] = body.exponents.T
    rows["kx"], rows["ky"] = body.taper.T
    rows["bend"], rows["bend_angle"] = body.bend.T
    pose = np.concatenate([body.position_m, body.quaternion_xyzw], axis=1)
    return (array_of(rows, SuperquadricShape, device),
            array_of(pose, transform, device))
