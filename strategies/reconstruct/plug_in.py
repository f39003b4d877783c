"""Bodies from a user's own function, for instance a network: what it gets, what it may return.

    def my_network(touches: Touches):
        return [(vertices_m, faces) for world in range(touches.worlds)]    # or signed distances

A mesh is a pair of arrays, or anything with `vertices` and `faces`; None where the function has no
answer. Instead of meshes it may return a function of (points_m [row, point, 3], worlds [row]) that
gives signed distances [m] (row, point), whose zero set becomes the mesh.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.implicit.record import Mean, TriangleMesh
from strategies.planners.guarded_call import guarded_call
from strategies.planners.register import fault_text, place_of
from strategies.recovery.belief import read_only
from warpgrasp.core.plain_text import on_one_line
from warpgrasp.geometry.body_sampling import sobol_points
from warpgrasp.objects.mesh_orientation import mesh_distance, mesh_of, outward_faces

FARTHEST_M = 2.0
"""A vertex farther than this from the box that is given is an error."""
MOST_FACES = 500_000
_SMALLEST_M = 0.005
"""Of a body's greatest width: one that is less is hardly what was meant [est]."""
_CELLS = 64
"""Of the grid of signed distances: its box holds the whole prior, and a handle of 16 mm in it needs
cells of 4 mm, as that of a union of parts does [est]."""
_STEEP, _STEEP_SHARE = 1.2, 0.05
"""Distances that change by more than so many times the way between two points, at such a share of
them, are none of metres, and cells may be left out in which the surface is [est]."""
_LOG2_POINTS = 13
"""Of a mesh's box, of which none may lie in two pieces."""
_OUTSIDE_M = 1.0
"""Taken for a distance that is no number, so that the other worlds' meshes can be made."""
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
    """Corners of a box that holds the given prior and its error, (world, 3)."""
    high_m: np.ndarray
    recovered: Mean
    """Signed distance [m] of the superquadric or contour recovered, or of the prior:
    recovered(points_m [row, point, 3], worlds [row])."""

    @property
    def worlds(self) -> int:
        """Number of worlds."""
        return len(self.mask)


@dataclass(frozen=True)
class PlugInBodies:
    """What a function of a user's has answered."""

    meshes: list[TriangleMesh]
    """One a world, empty where there is none."""
    fault: np.ndarray
    """What was wrong, str (world,)."""
    note: np.ndarray
    """What its author may not have meant, str (world,): no body, or one that the box cuts off."""
    ended: np.ndarray
    """Worlds that an error ended which may have been about another one of them, bool (world,)."""


def run_plug_in(function: Callable[..., Any], touches: Touches) -> PlugInBodies:
    """The bodies of all worlds, by a function of a user's."""
    meshes, fault, cut, steep, raised = _answered(function, touches)
    empty = np.array([len(mesh.faces) == 0 for mesh in meshes], bool)
    place = place_of(function)
    note = np.where(empty, f"{place}: gave no body, what was recovered stands", np.where(
        cut, f"{place}: its body is cut off by the sides or the top of the box from low_m to "
        "high_m; should distances there be positive?", np.where(
            steep, f"{place}: its distances change by more than the way between points, so that "
            "thin parts may be lost; should they be in metres?", [
                _misplaced(place, mesh, low, high) for mesh, low, high
                in zip(meshes, touches.low_m, touches.high_m, strict=True)])))
    return PlugInBodies(meshes, fault, np.where(fault == "", note, ""),
                        np.full(touches.worlds, raised))


def _misplaced(place: str, mesh: TriangleMesh, low_m: np.ndarray, high_m: np.ndarray) -> str:
    """What is strange about where a mesh is, or how large; empty where nothing is."""
    if not len(mesh.faces):
        return ""
    least, most = mesh.corners_m.min((0, 1)), mesh.corners_m.max((0, 1))
    if (least > high_m).any() or (most < low_m).any():
        return (f"{place}: its body lies outside the box from low_m to high_m; should its vertices "
                "be in the base frame?")
    if (size := (most - least).max()) < _SMALLEST_M:
        return f"{place}: its body is {1e3 * size:.2g} mm across; should its vertices be in metres?"
    return ""


def _answered(function: Callable[..., Any], touches: Touches
              ) -> tuple[list[TriangleMesh], np.ndarray, np.ndarray, np.ndarray, bool]:
    """Meshes, faults, whether the box cuts off a mesh and whether distances are too steep, bool
    (world,), and whether the function raised."""
    from fit.implicit.mesh import zero_set_meshes

    worlds = touches.worlds
    meshes, fault = [NO_MESH] * worlds, np.full(worlds, "", object)
    cut, steep = np.zeros((2, worlds), bool)
    try:
        with guarded_call():
            answer = function(touches)
            if callable(answer):
                bad = np.zeros(worlds, bool)
                found = zero_set_meshes(_checked(answer, touches, cut, steep, bad), touches.low_m,
                                        touches.high_m, cells=_CELLS)
                fault[bad] = f"{place_of(function)}: a distance is not finite"
                return [NO_MESH if none else mesh for none, mesh in zip(bad, found, strict=True)
                        ], fault, cut, steep, False
            answer = list(answer) if isinstance(answer, Iterable) else answer
    except Exception as error:  # whatever a user's function may raise
        fault[:] = fault_text(function, error)
        return meshes, fault, cut, steep, True
    if not isinstance(answer, list):
        what = "None" if answer is None else type(answer).__name__
        fault[:] = (f"{place_of(function)}: answered with {what}; should be a list of a mesh or "
                    "None for each world, or a function of (points_m, worlds)")
        return meshes, fault, cut, steep, False
    if len(answer) != worlds:
        fault[:] = f"{place_of(function)}: {len(answer)} meshes for {worlds} worlds"
        return meshes, fault, cut, steep, False
    for world, given in enumerate(answer):
        if given is None:
            continue
        try:
            with guarded_call():  # what it gave may run code of its own when it is read
                meshes[world] = checked_mesh(given, touches.low_m[world], touches.high_m[world])
        except (ValueError, TypeError) as error:
            fault[world] = on_one_line(f"{place_of(function)}: {error!s:.400}")
        except Exception as error:
            fault[world] = fault_text(function, error)
    return meshes, fault, cut, steep, False


def _checked(distance: Callable[..., Any], touches: Touches, cut: np.ndarray, steep: np.ndarray,
             bad: np.ndarray) -> Callable[..., np.ndarray]:
    """The user's distance, checked. It raises ValueError, and notes in `cut` (world,) where it is
    negative on the sides or the top of the box, in `steep` where it changes by more than the way,
    and in `bad` where it is no number."""
    low, high = touches.low_m[:, None], touches.high_m[:, None]
    rim = 1e-6 * (high - low)

    def values(points: np.ndarray, worlds: np.ndarray, counts: np.ndarray) -> np.ndarray:
        found = _numbers(distance(read_only(points), read_only(worlds)), "distances")
        if found.shape != points.shape[:2]:
            raise ValueError(f"distances of shape {found.shape}, should be {points.shape[:2]}")
        known = np.isfinite(found)
        bad[worlds] |= ~known.all(1)
        found = np.where(known, found, _OUTSIDE_M)
        out = points >= (high - rim)[worlds]
        out[..., :2] |= (points <= (low + rim)[worlds])[..., :2]  # a body may stand on the table
        cut[worlds] |= (out.any(-1) & (found < 0.0)).any(1)
        way = np.linalg.norm(np.diff(points, axis=1), axis=-1)
        steeper = np.abs(np.diff(found, axis=1)) > _STEEP * way
        steep[worlds] |= steeper.mean(1) > _STEEP_SHARE if way.size else False
        return found

    return values


def checked_mesh(given: Any, low_m: np.ndarray, high_m: np.ndarray) -> TriangleMesh:
    """A closed mesh from a pair of arrays, or from what has `vertices` and `faces`.

    Raises ValueError or TypeError that says what is wrong.
    """
    vertices, faces = _pair(given)
    vertices, faces = _numbers(vertices, "vertices"), np.asarray(faces)
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise ValueError(f"vertices of shape {vertices.shape}, should be (any, 3)")
    if faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu":
        raise ValueError(f"faces of shape {faces.shape} and type {faces.dtype}, should be whole "
                         "numbers (any, 3)")
    if not 4 <= len(faces) <= MOST_FACES:
        raise ValueError(f"{len(faces)} faces, should be 4 to {MOST_FACES}")
    if faces.min() < 0 or faces.max() >= len(vertices):
        wrong = faces.min() if faces.min() < 0 else faces.max()
        raise ValueError(f"faces name vertex {wrong} of {len(vertices)}; should be 0 to "
                         f"{len(vertices) - 1}")
    if not np.isfinite(vertices).all():
        raise ValueError("a vertex is not finite")
    if (vertices < low_m - FARTHEST_M).any() or (vertices > high_m + FARTHEST_M).any():
        raise ValueError(f"a vertex is more than {FARTHEST_M:g} m from the object: are they in m?")
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    ahead = edges[:, 0] * len(vertices) + edges[:, 1]
    back = edges[:, 1] * len(vertices) + edges[:, 0]
    if not np.array_equal(np.sort(ahead), np.sort(back)):
        raise ValueError("the surface is open, or its faces do not look one way")
    if len(np.unique(ahead)) != len(ahead):
        raise ValueError("an edge borders more than two faces; should be two, and pieces that "
                         "touch there should have vertices of their own")
    mesh = TriangleMesh(vertices, faces.astype(int))
    if mesh.volume_m3 <= 0.0:
        raise ValueError("the volume is not positive: should its faces look outwards?")
    if not np.array_equal(outward_faces(mesh.vertices_m, mesh.faces), mesh.faces):
        raise ValueError("a piece of it is inside out; the faces of each should look outwards, "
                         "those of a cavity inwards")
    if _is_twice_inside(mesh):
        raise ValueError("pieces of it overlap, or it crosses itself, and what they share would "
                         "count twice; should be united, or signed distances, the least of all")
    return mesh


def _is_twice_inside(mesh: TriangleMesh) -> bool:
    """Whether pieces of a mesh share more than some 0.01 % of its box."""
    low, high = mesh.corners_m.min((0, 1)), mesh.corners_m.max((0, 1))
    points = low + sobol_points(_LOG2_POINTS) * (high - low)
    found = mesh_distance(mesh_of(mesh.vertices_m, mesh.faces), points, winding=1.5)
    return bool((found < 0.0).any())


def _pair(given: Any) -> tuple[Any, Any]:
    """Vertices and faces of what stands for a mesh."""
    if hasattr(given, "vertices"):
        return given.vertices, given.faces
    listed = isinstance(given, Iterable) and not isinstance(given, str | Mapping)
    parts = list(given) if listed else []
    if len(parts) != 2:
        what = f"{type(given).__name__}{f' of {len(parts)}' if listed else ''}"
        raise ValueError(f"is {what}; should be a pair of vertices and faces, or have both as its "
                         "`vertices` and `faces`")
    return parts[0], parts[1]


def _numbers(values: Any, what: str) -> np.ndarray:
    """Real numbers of a user's, as an array of our own."""
    if np.iscomplexobj(values):
        raise ValueError(f"{what} are complex, should be real numbers")
    return np.array(values, float)
