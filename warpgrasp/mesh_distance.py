"""Signed distances to a mesh of triangles: outside where its winding number is below a half."""

import numpy as np
import warp as wp

from warpgrasp.launch import launch


@wp.kernel(enable_backward=False)
def _mesh_distance_kernel(
    first: int,
    # Mesh:
    mesh: wp.uint64,
    # Query in:
    point: wp.array[wp.vec3f],
    # Distance out:
    distance: wp.array[wp.float32],
):
    i = wp.tid() + first
    query = wp.mesh_query_point_sign_winding_number(mesh, point[i], 10.0)
    nearest = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
    distance[i] = query.sign * wp.length(point[i] - nearest)


def mesh_of(vertices_m: np.ndarray, faces: np.ndarray) -> wp.Mesh:
    """The mesh of vertices, (n, 3), and faces, (m, 3), for `mesh_distance`."""
    return wp.Mesh(points=wp.array(vertices_m, dtype=wp.vec3f, device="cpu"),
                   indices=wp.array(faces.ravel(), dtype=int, device="cpu"),
                   support_winding_number=True)


def mesh_distance(mesh: wp.Mesh, points_m: np.ndarray) -> np.ndarray:
    """Signed distances [m] of points, (n, 3), to a mesh of at most 10 m: shape (n,), float32."""
    out = wp.empty(len(points_m), dtype=wp.float32, device="cpu")
    launch(_mesh_distance_kernel, {"point": len(points_m)},
           {"point": "point", "distance": "point"},
           {"mesh": mesh.id, "point": wp.array(points_m, dtype=wp.vec3f, device="cpu"),
            "distance": out}, device="cpu")
    return out.numpy().copy()
