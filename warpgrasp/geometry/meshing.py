"""A body as a mesh, for display only.

Surface nets (Gibson 1998): one vertex in every cell of a grid that the surface passes through,
moved onto the surface along the distance's gradient; one quadrilateral across every grid edge
that the surface crosses.
"""

import numpy as np

from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of

_AROUND = ((0, 0), (1, 0), (1, 1), (0, 1))  # the four cells about an edge, in order


def body_mesh(body: Body, cells: int = 28) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [m] in the body's frame, (vertex, 3), and quadrilaterals, (face, 4).

    `cells` is how many the longest side of the body's box has. Faces run anticlockwise seen from
    outside. Both are empty where the grid misses the body.
    """
    low, high = np.asarray(body.low_m, float), np.asarray(body.high_m, float)
    step = float((high - low).max()) / cells
    count = np.ceil((high - low) / step).astype(int) + 2
    first = (low + high) / 2 - step * count / 2
    nodes = np.stack(np.meshgrid(*(np.arange(n + 1) for n in count), indexing="ij"), -1)
    scene = scene_of([body], "cpu")
    found, _ = distance_to_bodies(scene, np.zeros(1, int),
                                  (first + step * nodes).reshape(1, -1, 3))
    distance = found[0].reshape(count + 1)
    vertex_of, vertices = _vertices(distance)
    points = first + step * vertices
    for _ in range(3):
        d, gradient = distance_to_bodies(scene, np.zeros(1, int), points[None])
        points = points - np.clip(d[0], -step / 2, step / 2)[:, None] * gradient[0]
    return points, _faces(distance < 0.0, vertex_of)


def _vertices(distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The number of each cell's vertex (-1: none), and the vertices in units of the grid."""
    count = np.array(distance.shape) - 1
    total = np.zeros((*count, 3))
    crossings = np.zeros(count, int)
    for axis in range(3):
        near = np.moveaxis(distance, axis, 0)
        a, b = near[:-1], near[1:]
        crossed = (a < 0.0) != (b < 0.0)
        share = np.where(crossed, a / np.where(crossed, a - b, 1.0), 0.0)
        p, q = (n for n in range(3) if n != axis)
        for u, v in _AROUND:
            window = np.s_[:, u:u + count[p], v:v + count[q]]
            there = crossed[window]
            place = np.zeros((*there.shape, 3))
            place[..., axis], place[..., p], place[..., q] = share[window], u, v
            total += np.moveaxis(np.where(there[..., None], place, 0.0), 0, axis)
            crossings += np.moveaxis(there, 0, axis)
    has = crossings > 0
    vertex_of = np.full(count, -1)
    vertex_of[has] = np.arange(has.sum())
    return vertex_of, np.argwhere(has) + total[has] / crossings[has][:, None]


def _faces(inside: np.ndarray, vertex_of: np.ndarray) -> np.ndarray:
    """A quadrilateral across every edge between an inner and an outer node."""
    faces = [np.zeros((0, 4), int)]
    for axis in range(3):
        near = np.moveaxis(inside, axis, 0)
        crossed = (near[:-1] != near[1:])[:, 1:-1, 1:-1]
        inner = near[:-1][:, 1:-1, 1:-1][crossed]
        cells = np.moveaxis(vertex_of, axis, 0)
        ring = np.stack([cells[:, u:u + crossed.shape[1], v:v + crossed.shape[2]][crossed]
                         for u, v in _AROUND], axis=1)
        forward = inner if axis != 1 else ~inner  # moving axis 1 to the front mirrors the frame
        faces.append(np.where(forward[:, None], ring, ring[:, ::-1]))
    return np.concatenate(faces)
