"""The surface of a recovered body as a grid of points, to be drawn, whichever model it is."""

import numpy as np

from fit.revolution_shape import RevolutionBody
from fit.superquadric_shape import (
    Superquadric,
    from_straight_frame,
    superquadric,
    superquadric_inside_outside,
)
from strategies.recovered import Recovered, Shape


def recovered_grid(recovered: Recovered, world: int = 0, rows: int = 48) -> np.ndarray:
    """Points of one world's body, from end to end and around, (row, column, 3) [m]."""
    if recovered.shape[world] == Shape.REVOLUTION and recovered.revolution is not None:
        return revolution_grid(recovered.revolution, world, 2 * rows)
    return surface_grid(Superquadric(*(field[world:world + 1]
                                       for field in recovered.superquadric)), rows)


def surface_grid(body: Superquadric, rows: int = 48) -> np.ndarray:
    """Points of the first superquadric of a batch, from pole to pole, (row, column, 3) [m]."""
    up = np.linspace(0.0, np.pi, rows + 1)
    around = np.linspace(0.0, 2.0 * np.pi, 2 * rows + 1)
    u, a = np.meshgrid(up, around, indexing="ij")
    ball = np.stack([np.sin(u) * np.cos(a), np.sin(u) * np.sin(a), np.cos(u)], -1)
    # Radial projection in the scaled frame, stretched to a cube first so that edges are kept.
    cube = ball / np.abs(ball).max(-1, keepdims=True)
    straight = superquadric(body.size_m[:1], body.exponents[:1])
    flat = (cube * body.size_m[0]).reshape(1, -1, 3)
    on = flat / superquadric_inside_outside(straight, flat)[..., None]
    first = Superquadric(*(field[:1] for field in body))
    return from_straight_frame(first, on)[0].reshape(*u.shape, 3)


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
    """The faces between a grid's points, (face, 4, 3)."""
    return np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]],
                    axis=2).reshape(-1, 4, 3)


def surface_mesh(body: Superquadric, rows: int = 48) -> np.ndarray:
    """Quadrilaterals of the first superquadric of a batch, (face, 4, 3) [m]."""
    return quadrilaterals(surface_grid(body, rows))
