"""Tangent coordinates of superquadrics, and derivatives of the scaled radius by them.

In closed form for bodies without a bend, whose scaled radius is two nested logarithms of sums; by
central differences for bent ones.
"""

import numpy as np
from jaxtyping import Float

from fit.rotation import matrix_of_quaternion, quaternion_of_matrix
from fit.superquadric.geometry import (
    MIN_TAPER_FACTOR,
    TINY,
    Superquadric,
    SuperquadricLike,
    log_sum,
    radius_differences,
    superquadric_inside_outside,
)

TANGENT = (
    "log_a1", "log_a2", "log_a3", "eps1", "eps2",
    "turn_x_rad", "turn_y_rad", "turn_z_rad", "px_m", "py_m", "pz_m",
    "kx", "ky", "bend_x_per_m", "bend_y_per_m",
)  # fmt: skip
"""Tangent coordinates; rotations are about the body's own axes, the bend is a vector."""
STEP = 1e-5
"""Step of differences; of a bend over the body's half diagonal."""


def displaced(body: SuperquadricLike, tangent: Float[np.ndarray, "fit 15"]) -> Superquadric:
    """The bodies displaced by a step in tangent coordinates."""
    t = tangent
    rotation = matrix_of_quaternion(body.quaternion_xyzw)
    half = np.concatenate([0.5 * t[:, 5:8], np.ones((len(t), 1))], axis=1)
    turn = matrix_of_quaternion(half / np.linalg.norm(half, axis=1, keepdims=True))
    bend = _bend_vector(body) + t[:, 13:15]
    return Superquadric(
        body.size_m * np.exp(t[:, 0:3]),
        body.exponents + t[:, 3:5],
        body.position_m + t[:, 8:11],
        quaternion_of_matrix(rotation @ turn),
        body.taper + t[:, 11:13],
        np.stack([np.hypot(*bend.T), np.arctan2(bend[:, 1], bend[:, 0])], axis=1),
    )


def radius_slopes(
    body: SuperquadricLike, points: Float[np.ndarray, "fit point 3"]
) -> tuple[np.ndarray, np.ndarray]:
    """The scaled radius at points [m], (fit, point), and its derivatives by `TANGENT`, (fit, point,
    15). Those by the place are less its gradient."""
    straight = body.bend[:, 0] == 0.0
    if straight.all():
        return _of_straight(body, points)
    radius, slopes = np.zeros(points.shape[:2]), np.zeros((*points.shape[:2], 15))
    for rows, found in ((np.flatnonzero(straight), _of_straight),
                        (np.flatnonzero(~straight), _by_differences)):
        part = Superquadric(*(getattr(body, name)[rows] for name in Superquadric._fields))
        radius[rows], slopes[rows] = found(part, points[rows])
    return radius, slopes


def _of_straight(body: SuperquadricLike, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Chain rule from the outermost function inwards."""
    a1, a2, a3 = body.size_m.T[..., None]
    e1, e2 = body.exponents.T[..., None]
    kx, ky = body.taper.T[..., None]
    rotation = matrix_of_quaternion(body.quaternion_xyzw)[..., None]
    d = [points[..., k] - body.position_m[:, k, None] for k in range(3)]
    # Before the taper is undone.
    px, py, z = (d[0] * rotation[:, 0, k] + d[1] * rotation[:, 1, k] + d[2] * rotation[:, 2, k]
                 for k in range(3))
    within = np.abs(z) < a3
    height = np.clip(z / a3, -1.0, 1.0)
    factor_x, factor_y = 1 + kx * height, 1 + ky * height
    open_x, open_y = factor_x > MIN_TAPER_FACTOR, factor_y > MIN_TAPER_FACTOR
    factor_x, factor_y = (np.maximum(f, MIN_TAPER_FACTOR) for f in (factor_x, factor_y))
    x, y = px / factor_x, py / factor_y

    squares = [(c / a) ** 2 + TINY for c, a in ((x, a1), (y, a2), (z, a3))]
    lx, ly, lz = (np.log(square) for square in squares)
    section = log_sum(lx / e2, ly / e2)
    first, second = e2 * section / e1, lz / e1
    whole = log_sum(first, second)
    radius = np.exp(0.5 * e1 * whole)
    share, share_z = np.exp(first - whole), np.exp(second - whole)
    share_x, share_y = np.exp(lx / e2 - section), np.exp(ly / e2 - section)
    # Of the logarithm of the radius, by the coordinates of the straight body.
    gx = share * share_x * x / (a1**2 * squares[0])
    gy = share * share_y * y / (a2**2 * squares[1])
    gz = share_z * z / (a3**2 * squares[2])
    by_kx, by_ky = -gx * x * height / factor_x * open_x, -gy * y * height / factor_y * open_y
    by_height = -gx * x * kx / factor_x * open_x - gy * y * ky / factor_y * open_y
    own = [gx / factor_x, gy / factor_y, gz + by_height * within / a3]
    columns = [
        -x * gx, -y * gy, -z * gz - by_height * height * within,
        0.5 * (whole - share * first - share_z * second),
        0.5 * share * (section - (share_x * lx + share_y * ly) / e2),
        own[1] * z - own[2] * py, own[2] * px - own[0] * z, own[0] * py - own[1] * px,
        *(-(rotation[:, k, 0] * own[0] + rotation[:, k, 1] * own[1] + rotation[:, k, 2] * own[2])
          for k in range(3)),
        by_kx, by_ky,
        # A slight bend shifts sections by half its curvature times the height squared.
        own[2] * z * px - 0.5 * z**2 * own[0], own[2] * z * py - 0.5 * z**2 * own[1],
    ]
    slopes = np.empty((*radius.shape, len(TANGENT)))
    for k, column in enumerate(columns):
        np.multiply(column, radius, out=slopes[..., k])
    return radius, slopes


def _by_differences(body: SuperquadricLike, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    slopes = np.zeros((*points.shape[:2], 15))
    for k in (*range(8), *range(11, 15)):
        step = np.zeros((len(points), 15))
        step[:, k] = STEP if k < 13 else STEP / np.linalg.norm(body.size_m, axis=1)
        up, down = (superquadric_inside_outside(displaced(body, s * step), points) for s in (1, -1))
        slopes[..., k] = (up - down) / (2 * step[:, None, k])
    difference, step = radius_differences(body, points)
    slopes[..., 8:11] = -difference / (2 * step)[..., None]
    return superquadric_inside_outside(body, points), slopes


def _bend_vector(body: SuperquadricLike) -> np.ndarray:
    """Curvature vectors [1/m] in x and y, shape [fit, 2]."""
    curvature, direction = body.bend[:, :1], body.bend[:, 1]
    return curvature * np.stack([np.cos(direction), np.sin(direction)], axis=1)
