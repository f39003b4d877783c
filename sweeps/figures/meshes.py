"""Surfaces for drawing: a recovered body as a grid of points and as quadrilaterals, a true one as a
mesh."""

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from fit.implicit.record import TriangleMesh
from fit.revolution.geometry import RevolutionBody
from fit.superquadric.geometry import Superquadric, from_straight_frame
from strategies.recovery.choose_model import Recovered, Shape
from warpgrasp.geometry.body import Body
from warpgrasp.geometry.body_sampling import KeyedBody, keyed_body, sample_body
from warpgrasp.geometry.meshing import body_mesh

if TYPE_CHECKING:
    from sweeps.episode.episodes import EpisodeBlock

LEAST_HELD = 0.9
"""Of a body's volume: a coarse mesh that holds less has lost walls."""
FINEST_CELLS = 96
"""As fine as the grids that thin walls are baked to."""
MOST_VERTICES = 2**16
"""Pages number vertices with 16 bits."""


def true_mesh(body: Body, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """A true body to be looked at: `body_mesh` with so many cells, or with more where its walls
    would be lost; the body's box where it is too thin for any. Vertices (vertex, 3) [m] and
    quadrilaterals (face, 4)."""
    return _true_mesh(keyed_body(body), cells)


def turned_mesh(body: Body, pose: np.ndarray, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """As `true_mesh`, turned about the vertical as a body at a pose (7,) is, where it stands at the
    origin."""
    yaw = 2.0 * np.arctan2(pose[5], pose[6])
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    vertices, faces = true_mesh(body, cells)
    return vertices @ turn.T, faces


@lru_cache(maxsize=16)
def _true_mesh(keyed: KeyedBody, cells: int) -> tuple[np.ndarray, np.ndarray]:
    made = body_mesh(keyed.body, cells)
    wanted = LEAST_HELD * sample_body(keyed.body).volume_m3
    while _volume_m3(*made) < wanted and cells < FINEST_CELLS:
        cells = min(2 * cells, FINEST_CELLS)
        finer = body_mesh(keyed.body, cells)
        if len(finer[0]) > MOST_VERTICES:
            break
        made = finer
    return made if len(made[1]) else _box(keyed.body)


def _box(body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and outward faces of the box that holds a body."""
    corner = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), -1).reshape(8, 3)
    return np.where(corner, body.high_m, body.low_m), np.array(
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])


def _volume_m3(vertices: np.ndarray, faces: np.ndarray) -> float:
    """What closed quadrilaterals hold."""
    return TriangleMesh(vertices, faces[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)).volume_m3


def recovered_grid(recovered: Recovered, world: int = 0, rows: int = 48) -> np.ndarray:
    """Points of one world's chosen model, from end to end and around, (row, column, 3) [m]."""
    if recovered.shape[world] == Shape.REVOLUTION and recovered.revolution is not None:
        return revolution_grid(recovered.revolution, world, 2 * rows)
    return surface_grid(Superquadric(*(field[world:world + 1]
                                       for field in recovered.superquadric)), rows)


def mesh_of_world(block: "EpisodeBlock", world: int = 0) -> TriangleMesh | None:
    """The free-form body of one world, if that is what is scored."""
    if block.rebuilt is None or len(block.rebuilt.meshes[world].faces) == 0:
        return None
    return block.rebuilt.meshes[world]


def recovered_faces(block: "EpisodeBlock", world: int = 0) -> np.ndarray:
    """Faces of the body that is scored, triangles or quadrilaterals, (face, 3 or 4, 3) [m]."""
    mesh = mesh_of_world(block, world)
    return (quadrilaterals(recovered_grid(block.recovered, world)) if mesh is None
            else mesh.corners_m)


def coarse_mesh(mesh: TriangleMesh, cells: int = 40) -> TriangleMesh:
    """A mesh to be looked at, of fewer triangles: vertices of one cell, so many along the longest
    side, become one (Rossignac and Borrel 1993)."""
    low, high = mesh.vertices_m.min(0), mesh.vertices_m.max(0)
    cell = np.floor((mesh.vertices_m - low) / (float((high - low).max()) / cells)).astype(int)
    _, number, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    number = number.ravel()
    vertices = np.stack([np.bincount(number, mesh.vertices_m[:, k]) for k in range(3)], 1)
    faces = number[mesh.faces]
    whole = (faces != np.roll(faces, 1, axis=1)).all(1)
    return TriangleMesh(vertices / count[:, None], faces[whole])


def surface_grid(body: Superquadric, rows: int = 48) -> np.ndarray:
    """Points of the first superquadric of a batch, from pole to pole, (row, column, 3) [m].

    The product of two superellipses, each sampled evenly along the square about it, so that the
    edges of a block and the rims of a cylinder are lines of the grid; `rows` a multiple of four.
    """
    c, s = square_path(np.linspace(2.0, -2.0, rows + 1))
    x, y = square_path(np.linspace(-4.0, 4.0, 2 * rows + 1))
    up = np.stack([c, s]) * _onto(c, s, float(body.exponents[0, 0]))
    around = np.stack([x, y]) * _onto(x, y, float(body.exponents[0, 1]))
    unit = np.stack([np.outer(up[0], around[0]), np.outer(up[0], around[1]),
                     np.repeat(up[1][:, None], 2 * rows + 1, axis=1)], axis=-1)
    first = Superquadric(*(field[:1] for field in body))
    flat = (unit * body.size_m[0]).reshape(1, -1, 3)
    return from_straight_frame(first, flat)[0].reshape(unit.shape)


def square_path(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points along the square of half side 1 from (1, 0), two units of `t` a side."""
    return (np.clip(np.abs((t + 4.0) % 8.0 - 4.0) * -1.0 + 2.0, -1.0, 1.0),
            np.clip(np.abs((t + 2.0) % 8.0 - 4.0) * -1.0 + 2.0, -1.0, 1.0))


def _onto(x: np.ndarray, y: np.ndarray, exponent: float) -> np.ndarray:
    """The factor that moves points of the square along their rays onto the superellipse."""
    return (np.abs(x) ** (2.0 / exponent) + np.abs(y) ** (2.0 / exponent)) ** (-exponent / 2.0)


def revolution_grid(body: RevolutionBody, world: int, columns: int) -> np.ndarray:
    """Points of one body of revolution, from its upper end down, both ends closed."""
    known = np.isfinite(body.height_m[world]) & np.isfinite(body.radius_m[world])
    z, r = body.height_m[world][known][::-1], body.radius_m[world][known][::-1]
    z, r = np.concatenate([z[:1], z, z[-1:]]), np.concatenate([[0.0], r, [0.0]])
    axis = body.axis[world]
    aside = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    aside = aside / np.linalg.norm(aside)
    angle = np.linspace(0.0, 2.0 * np.pi, columns + 1)[:, None]
    out = np.cos(angle) * aside + np.sin(angle) * np.cross(axis, aside)
    return body.foot_m[world] + z[:, None, None] * axis + r[:, None, None] * out


def quadrilaterals(grid: np.ndarray) -> np.ndarray:
    """The faces between a grid's points, (face, 4, 3), anticlockwise seen from outside."""
    return np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]],
                    axis=2).reshape(-1, 4, 3)


def surface_mesh(body: Superquadric, rows: int = 48) -> np.ndarray:
    """Quadrilaterals of the first superquadric of a batch, (face, 4, 3) [m]."""
    return quadrilaterals(surface_grid(body, rows))
