"""A body as a mesh: for display, and for distances where a body's formula is none.

Surface nets (Gibson 1998): one vertex in every cell of a grid that the surface passes through, one
quadrilateral across every grid edge that the surface crosses. A vertex stands where the tangent
planes at its cell's crossings meet (Ju and others 2002), so that edges stay sharp.
"""

from numbers import Integral

import numpy as np

from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of, signed_distance_to_bodies

_AROUND = ((0, 0), (1, 0), (1, 1), (0, 1))  # the four cells about an edge, in order
MOST_CELLS = 512
"""Along the longest side of a body's box."""
_TOWARDS_MIDDLE = 0.05
"""Weight of the mean of a cell's crossings, beside one for each tangent plane."""


def body_mesh(body: Body, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [m] in the body's frame, (vertex, 3), and quadrilaterals, (face, 4).

    `cells` is how many the longest side of the body's box has. Faces run anticlockwise seen from
    outside. Both are empty where the grid misses the body. Raises ValueError unless `cells` is a
    whole number from 1 to MOST_CELLS.
    """
    if not isinstance(cells, Integral) or not 1 <= cells <= MOST_CELLS:
        raise ValueError(f"cells: is {cells!r}; should be a whole number from 1 to {MOST_CELLS}")
    low, high = np.asarray(body.low_m, float), np.asarray(body.high_m, float)
    step = float((high - low).max()) / cells
    count = np.ceil((high - low) / step).astype(int) + 2
    first = (low + high) / 2 - step * count / 2
    nodes = np.stack(np.meshgrid(*(np.arange(n + 1) for n in count), indexing="ij"), -1)
    scene, only = scene_of([body], "cpu"), np.zeros(1, int)
    distance = signed_distance_to_bodies(
        scene, only, (first + step * nodes).reshape(1, -1, 3))[0].reshape(count + 1)
    cell, crossing = _crossings(distance)
    normal = distance_to_bodies(scene, only, (first + step * crossing)[None])[1][0]
    vertex_of, vertices = _vertices(count, cell, crossing, normal)
    points = first + step * vertices
    for _ in range(3):
        d, gradient = distance_to_bodies(scene, only, points[None])
        points = points - np.clip(d[0], -step / 2, step / 2)[:, None] * gradient[0]
    return points, _faces(distance < 0.0, vertex_of)


def _crossings(distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the surface crosses edges of the grid, once for each of the four cells about an edge:
    the cells, (n, 3), and the places in units of the grid."""
    cells, places = [np.zeros((0, 3), int)], [np.zeros((0, 3))]
    for axis in range(3):
        near = np.moveaxis(distance, axis, 0)
        at = np.argwhere((near[:-1] < 0.0) != (near[1:] < 0.0))
        a, b = near[tuple(at.T)], near[tuple((at + [1, 0, 0]).T)]
        place = at + (a / (a - b))[:, None] * [1.0, 0.0, 0.0]
        for u, v in _AROUND:
            cells.append(np.insert((at - [0, u, v])[:, 1:], axis, at[:, 0], axis=1))
            places.append(np.insert(place[:, 1:], axis, place[:, 0], axis=1))
    cell, place = np.concatenate(cells), np.concatenate(places)
    there = ((cell >= 0) & (cell < np.array(distance.shape) - 1)).all(1)
    return cell[there], place[there]


def _vertices(
    count: np.ndarray, cell: np.ndarray, crossing: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The number of each cell's vertex (-1: none), and the vertices in units of the grid."""
    number, own = np.unique(np.ravel_multi_index(tuple(cell.T), tuple(count)), return_inverse=True)
    total = lambda values: np.stack(  # noqa: E731
        [np.bincount(own, value, len(number)) for value in values.T], -1)
    middle = total(crossing) / np.bincount(own, minlength=len(number))[:, None]
    off = ((crossing - middle[own]) * normal).sum(1)
    planes = total((normal[:, :, None] * normal[:, None]).reshape(-1, 9)).reshape(-1, 3, 3)
    meet = np.linalg.solve(planes + _TOWARDS_MIDDLE * np.eye(3), total(normal * off[:, None])
                           [..., None])[..., 0]
    corner = np.stack(np.unravel_index(number, tuple(count)), -1)
    vertex_of = np.full(count, -1)
    vertex_of[tuple(corner.T)] = np.arange(len(number))
    return vertex_of, np.clip(middle + meet, corner, corner + 1)


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
