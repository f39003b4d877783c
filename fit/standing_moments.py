"""Numbers of a body that stands on a table, from its moments: no turn about the vertical and no
shift along the table changes them.

Moments of superquadrics are known in closed form (`fit.superquadric.moments`); those of a body with
a surface of triangles are sums over the tetrahedra between the triangles and any point, signed by
the side that each is seen from. A polynomial of degree five or less is integrated exactly over a
tetrahedron by the rule of Grundmann and Moller (1978, SIAM J. Numer. Anal. 15, 282).
"""

from itertools import product
from math import factorial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

DESCRIPTION = (
    "log_size", "log_centre_height", "log_height_std", "log_section",
    "elongation", "taper", "uneven_taper", "squareness", "height_kurtosis",
)
"""Numbers of a description: logarithms of the cube root of the volume, of the height of the
centroid above the table, of the standard deviation of height and of the mean radius of gyration of
the level section [m]; then, without units, how much longer than wide it is, how the section shrinks
with height, how that differs between its two directions, its fourth harmonic (corners), and the
kurtosis of height (flat or pointed ends)."""
LEAST_HEIGHT_M = 1e-3
_ORDER = 2  # of the rule, exact to degree 2 * order + 1


class StandingMoments(NamedTuple):
    """Moments of bodies about their centroids, (body,) each; w = x + i y is level, z upright."""

    volume_m3: np.ndarray
    centre_m: np.ndarray
    """Height of the centroid above the table."""
    height: np.ndarray
    """Of z^2 [m^2]."""
    spread: np.ndarray
    """Of |w|^2 [m^2]."""
    long: np.ndarray
    """Size of that of w^2 [m^2]."""
    shrinks: np.ndarray
    """Of z |w|^2 [m^3]."""
    shrinks_long: np.ndarray
    """Size of that of z w^2 [m^3]."""
    corners: np.ndarray
    """Size of that of w^4 [m^4]."""
    ends: np.ndarray
    """Of z^4 [m^4]."""


def description_of(m: StandingMoments) -> Float[np.ndarray, "body 9"]:
    """`DESCRIPTION` of bodies that stand on a table at height 0."""
    std = np.sqrt(m.height)
    area = np.sqrt(np.maximum(m.spread**2 - m.long**2, 1e-12 * m.spread**2)) / 2
    return np.stack([
        np.log(m.volume_m3) / 3,
        np.log(np.maximum(m.centre_m, LEAST_HEIGHT_M)),
        np.log(std),
        np.log(area) / 2,
        m.long / m.spread,
        m.shrinks / (std * m.spread),
        m.shrinks_long / (std * m.spread),
        m.corners / m.spread**2,
        m.ends / std**4,
    ], axis=1)


def mesh_description(corners_m: Float[np.ndarray, "face 3 3"]) -> Float[np.ndarray, " 9"]:
    """The same of the body within closed triangles, anticlockwise seen from outside [m]."""
    near = corners_m.reshape(-1, 3).mean(axis=0)
    a, b, c = np.moveaxis(corners_m - near, 1, 0)
    share = np.einsum("fi,fi->f", a, np.cross(b, c)) / 6.0
    point, weight = _tetrahedron_rule()
    points = near + np.einsum("pk,fki->fpi", point[:, 1:], corners_m - near).reshape(-1, 3)
    weight = (share[:, None] * weight).ravel()
    volume = weight.sum()
    weight = weight / volume
    centre = weight @ points
    x, y, z = (points - centre).T
    w = x + 1j * y
    square = np.abs(w) ** 2
    moments = (volume, centre[2], weight @ z**2, weight @ square, abs(weight @ w**2),
               weight @ (z * square), abs(weight @ (z * w**2)), abs(weight @ w**4), weight @ z**4)
    return description_of(StandingMoments(*(np.array([v]) for v in moments)))[0]


def _tetrahedron_rule() -> tuple[np.ndarray, np.ndarray]:
    """Barycentric points (point, 4) and weights that sum to one, (point,)."""
    n, degree = 3, 2 * _ORDER + 1
    points, weights = [], []
    for i in range(_ORDER + 1):
        of_all = degree + n - 2 * i
        weight = (factorial(n) * (-1) ** i * 2.0 ** (-2 * _ORDER) * of_all**degree
                  / (factorial(i) * factorial(degree + n - i)))
        for beta in product(range(_ORDER - i + 1), repeat=n + 1):
            if sum(beta) == _ORDER - i:
                points.append([(2 * b + 1) / of_all for b in beta])
                weights.append(weight)
    return np.array(points), np.array(weights)
