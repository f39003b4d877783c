"""The orientation of a mesh's faces, and signed distances to a mesh.

The inside of a mesh is decided by its winding number, which faces of the wrong orientation falsify.
Shells are turned outward where that is certain, and refused where it is not.
"""

from typing import Any

import numpy as np
import warp as wp

from warpgrasp.core.array_checks import check_array, check_finite, check_range
from warpgrasp.core.dtypes import float32
from warpgrasp.core.kernel_launch import launch
from warpgrasp.geometry.body import BodyError
from warpgrasp.geometry.sdf_grid import (
    mesh_distance_kernel,
    mesh_gap_kernel,
    simple_mesh_distance_kernel,
)

_CENTRES = 64  # of faces, which decide whether a shell lies in another


def outward_faces(vertices_m: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The faces, (m, 3), of a closed mesh, turned so that they bound what the mesh encloses.

    Every edge borders two faces. An outermost shell is turned outward, together with what lies in
    it: what looks the other way there is a cavity. Raises BodyError where a shell has no outside,
    or where it is ambiguous what one bounds.
    """
    shell, turned = _shells(faces)
    count = int(shell.max()) + 1
    middle = vertices_m.mean(0)
    a, b, c = (vertices_m[faces[:, k]] - middle for k in range(3))
    volume = (a * np.cross(b, c)).sum(1) * np.where(turned, -1.0, 1.0)
    inverted = np.bincount(shell, volume, count) < 0.0
    if not turned.any() and not inverted.any():
        return faces
    mixed = np.bincount(shell, turned, count) > 0
    outward = np.where((turned ^ inverted[shell])[:, None], faces[:, ::-1], faces)
    inner, outer, share = _held(vertices_m, outward, shell, count)
    crossing = share < 1.0
    opposed = (inverted[inner] != inverted[outer]) & ~mixed[inner] & ~mixed[outer]
    if (crossing & opposed).any():
        raise BodyError("two of its shells cross, and one is inside out: unite them first "
                        "(MeshLab 'Mesh Boolean: Union')")
    inner, outer = inner[~crossing], outer[~crossing]
    held = np.bincount(inner, minlength=count) > 0
    inner, outer = inner[~held[outer]], outer[~held[outer]]  # by the outermost alone
    holders, unsure, against = (np.bincount(inner, weight, count) for weight in (
        np.ones(len(outer)), mixed[outer], inverted[outer]))
    if (held & (mixed | (unsure > 0) | ((against > 0) & (against < holders)))).any():
        raise BodyError("a shell lies in another, and which way their faces look does not say "
                        "whether it is a cavity: make the faces of each shell look one way "
                        "(Blender 'Recalculate Outside', MeshLab 'Re-Orient All Faces')")
    turn = np.where(held, against > 0, inverted)
    return np.where((turned ^ turn[shell])[:, None], faces[:, ::-1], faces)


def _shells(faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each face's shell, and whether it looks the other way than the first face of its shell."""
    count = len(faces)
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    order = np.lexsort(np.sort(edges, axis=1).T)  # the two of an edge beside each other
    one, other = order[::2], order[1::2]
    alike = edges[one, 0] == edges[other, 0]  # faces that look one way run along it oppositely
    one, other = one // 3, other // 3
    # Every face is there twice, as it is and turned: what is connected looks one way.
    rows = np.concatenate([one, one + count])
    columns = np.concatenate([other + count * alike, other + count * ~alike])
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(rows), bool), (rows, columns)), shape=(2 * count, 2 * count))
    label = connected_components(graph, directed=False)[1]
    as_is, as_turned = label[:count], label[count:]
    if (as_is == as_turned).any():
        raise BodyError("its surface has one side, as a Klein bottle's: nothing is inside it")
    return np.unique(np.minimum(as_is, as_turned), return_inverse=True)[1], as_is > as_turned


def _held(
    vertices_m: np.ndarray, outward: np.ndarray, shell: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of shells, the first at least in part in the second, and the share of it that is."""
    order = np.argsort(shell, kind="stable")
    members = np.split(outward[order], np.cumsum(np.bincount(shell, minlength=count))[:-1])
    low = np.array([vertices_m[m].min((0, 1)) for m in members])
    high = np.array([vertices_m[m].max((0, 1)) for m in members])
    centres = [vertices_m[m[:: max(1, len(m) // _CENTRES)]].mean(1) for m in members]
    inner, outer, share = [], [], []
    for j, member in enumerate(members):
        near = np.flatnonzero(((low < high[j]) & (high > low[j])).all(1))
        near = near[near != j]
        if len(near) == 0:
            continue
        points = np.concatenate([centres[i] for i in near])
        inside = mesh_distance(mesh_of(vertices_m, member), points) < 0.0
        which = np.repeat(np.arange(len(near)), [len(centres[i]) for i in near])
        found = np.bincount(which, inside) / np.bincount(which)
        inner.append(near[found > 0.0])
        outer.append(np.full((found > 0.0).sum(), j))
        share.append(found[found > 0.0])
    if not inner:
        return np.zeros(0, int), np.zeros(0, int), np.zeros(0)
    return np.concatenate(inner), np.concatenate(outer), np.concatenate(share)


def mesh_of(vertices_m: np.ndarray, faces: np.ndarray, *, winding: bool = True) -> wp.Mesh:
    """The mesh of vertices, (n, 3), and faces, (m, 3); without `winding` not for `mesh_distance`.
    Raises TypeError and ValueError for other arrays, for vertices that are not finite, and for no
    faces, or faces of vertices that there are not.
    """
    check_array("vertices_m", vertices_m, "numbers", "vertex 3")
    check_array("faces", faces, "whole numbers", "face 3")
    check_finite("vertices_m", vertices_m)
    check_range("number of faces", len(faces), 1, np.iinfo(np.int32).max // 3)
    check_range("vertex of a face", faces, 0, len(vertices_m) - 1)
    return wp.Mesh(points=wp.array(vertices_m, dtype=wp.vec3f, device="cpu"),
                   indices=wp.array(faces.ravel(), dtype=int, device="cpu"),
                   support_winding_number=winding)


def mesh_distance(mesh: wp.Mesh, points_m: np.ndarray, *, accuracy: float = 2.0,
                  winding: float = 0.5) -> np.ndarray:
    """Signed distances [m] of points, (n, 3), to a mesh of at most 10 m: shape (n,), float32.

    Winding numbers say which side points are on: greater ones than `winding` are inside, than 1.5
    inside two pieces that overlap. Faces farther than `accuracy` times the size of
    their group are summed as one (Barill and others 2018). Of closed surfaces 1.5 gives the same
    sides in two thirds of the time. Raises TypeError and ValueError for other arrays.
    """
    return _distances(mesh_distance_kernel, mesh, points_m, accuracy=accuracy, winding=winding)


def simple_mesh_distance(mesh: wp.Mesh, points_m: np.ndarray) -> np.ndarray:
    """`mesh_distance` of a closed mesh that does not cross itself, in less than half the time.

    How often rays cross the mesh says which side points are on; inside two bodies that overlap,
    an even number would say outside. Raises as `mesh_distance`.
    """
    return _distances(simple_mesh_distance_kernel, mesh, points_m)


def mesh_gap(mesh: wp.Mesh, points_m: np.ndarray) -> np.ndarray:
    """Distances [m] of points, (n, 3), to a mesh, without a sign: shape (n,), float32. Raises as
    `mesh_distance`."""
    return _distances(mesh_gap_kernel, mesh, points_m)


def _distances(kernel: Any, mesh: wp.Mesh, points_m: np.ndarray, **how: float) -> np.ndarray:
    check_array("points_m", points_m, "numbers", "point 3")
    out = wp.empty(len(points_m), dtype=float32, device="cpu")
    launch(kernel, {"point": len(points_m)}, {"point": "point", "distance": "point"},
           {"mesh": mesh.id, "point": wp.array(points_m, dtype=wp.vec3f, device="cpu"), **how,
            "distance": out}, device="cpu")
    return out.numpy().copy()
