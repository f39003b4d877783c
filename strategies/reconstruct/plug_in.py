"""Bodies from a user's own function, for instance a network: what it gets, what it may return.

    def my_network(touches: Touches):
        return [(vertices_m, faces) for world in range(touches.worlds)]    # or signed distances

A mesh is a pair of arrays, or anything with `vertices` and `faces`; None where the function has no
answer. Instead of meshes it may return a function of (points_m [row, point, 3], worlds [row]) that
gives signed distances [m] (row, point), whose zero set becomes the mesh.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.implicit.record import Mean, TriangleMesh
from strategies.planners.guarded_call import guarded_call
from strategies.planners.register import fault_text, place_of

FARTHEST_M = 2.0
"""A vertex farther than this from the box that is given is an error."""
MOST_FACES = 500_000
NO_MESH = TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), int))


@dataclass(frozen=True)
class Touches:
    """What was felt, for all worlds at once, in the base frame. Arrays cannot be written to."""

    points_m: np.ndarray
    """Contacts as placed by the last fit (world, point, 3)."""
    mask: np.ndarray
    """Which slots hold a contact, (world, point)."""
    covariance_m2: np.ndarray
    """(world, point, 3, 3)."""
    normals: np.ndarray
    """Outward, of the body last fitted or as pads tell; NaN where it is in doubt which link
    touched, (world, point, 3)."""
    free_m: np.ndarray
    """Centres of balls outside the body, (world, ball, 3)."""
    free_radius_m: float
    free_mask: np.ndarray
    """(world, ball)."""
    low_m: np.ndarray
    """Corners of a box that holds the given prior cylinder and its error, (world, 3)."""
    high_m: np.ndarray
    recovered: Mean
    """Signed distance [m] of the superquadric or contour recovered, or of the prior cylinder:
    recovered(points_m [row, point, 3], worlds [row])."""

    @property
    def worlds(self) -> int:
        """Number of worlds."""
        return len(self.mask)


def run_plug_in(function: Callable[..., Any], touches: Touches) -> tuple[list[TriangleMesh],
                                                                         np.ndarray]:
    """A mesh of each world, empty where there is none, and what was wrong, str (world,)."""
    from fit.implicit.mesh import zero_set_meshes

    worlds = touches.worlds
    meshes, fault = [NO_MESH] * worlds, np.full(worlds, "", object)
    try:
        with guarded_call():
            answer = function(touches)
            if callable(answer):
                answer = zero_set_meshes(_checked(answer), touches.low_m, touches.high_m)
                return answer, fault
            answer = list(answer)
    except Exception as error:  # whatever a user's function may raise
        fault[:] = fault_text(function, error)
        return meshes, fault
    if len(answer) != worlds:
        fault[:] = f"{place_of(function)}: {len(answer)} meshes for {worlds} worlds"
        return meshes, fault
    for world, given in enumerate(answer):
        if given is None:
            continue
        try:
            meshes[world] = checked_mesh(given, touches.low_m[world], touches.high_m[world])
        except (ValueError, TypeError) as error:
            fault[world] = f"{place_of(function)}: world {world}: {error}"
    return meshes, fault


def _checked(distance: Callable[..., Any]) -> Callable[..., np.ndarray]:
    """The user's distance, checked. It raises ValueError."""
    def values(points: np.ndarray, worlds: np.ndarray, counts: np.ndarray) -> np.ndarray:
        found = np.asarray(distance(points, worlds), float)
        if found.shape != points.shape[:2]:
            raise ValueError(f"distances of shape {found.shape}, should be {points.shape[:2]}")
        if not np.isfinite(found).all():
            raise ValueError("a distance is not finite")
        return found

    return values


def checked_mesh(given: Any, low_m: np.ndarray, high_m: np.ndarray) -> TriangleMesh:
    """A closed mesh from a pair of arrays, or from what has `vertices` and `faces`.

    Raises ValueError or TypeError that says what is wrong.
    """
    vertices, faces = (given.vertices, given.faces) if hasattr(given, "vertices") else given
    vertices, faces = np.asarray(vertices, float), np.asarray(faces)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ValueError(f"vertices of shape {vertices.shape}, should be (any, 3)")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise ValueError(f"faces of shape {faces.shape} and type {faces.dtype}, should be whole "
                         "numbers (any, 3)")
    if not 4 <= len(faces) <= MOST_FACES:
        raise ValueError(f"{len(faces)} faces, should be 4 to {MOST_FACES}")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(f"faces name vertex {faces.max()} of {len(vertices)}")
    if not np.isfinite(vertices).all():
        raise ValueError("a vertex is not finite")
    if (vertices < low_m - FARTHEST_M).any() or (vertices > high_m + FARTHEST_M).any():
        raise ValueError(f"a vertex is more than {FARTHEST_M:g} m from the object: are they in m?")
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    ahead = edges[:, 0] * len(vertices) + edges[:, 1]
    back = edges[:, 1] * len(vertices) + edges[:, 0]
    if len(np.unique(ahead)) != len(ahead) or not np.array_equal(np.sort(ahead), np.sort(back)):
        raise ValueError("the surface is open, or its faces do not look one way")
    mesh = TriangleMesh(vertices, faces.astype(int))
    if mesh.volume_m3 <= 0.0:
        raise ValueError("the volume is not positive: should its faces look outwards?")
    return mesh
