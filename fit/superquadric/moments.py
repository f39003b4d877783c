"""Moments of superquadrics in closed form, and a description of a standing body that no relabelling
of its axes and no turn about the vertical changes.

A section of a superquadric is a superellipse, whose moments are Dirichlet integrals; along z they
are beta functions (Jaklic and Solina 2003), and a linear taper makes a polynomial of them. Fits of
one body may differ in the names of their axes and in the sign of z: parameter vectors then differ
although the bodies do not. Moments are those of the body.
"""

from math import comb

import numpy as np
from jaxtyping import Float
from scipy.special import betaln, gammaln

from fit.rotation import matrix_of_quaternion
from fit.superquadric.geometry import Superquadric, SuperquadricLike
from fit.superquadric.slopes import displaced

DESCRIPTION = (
    "log_size", "log_centre_height", "log_height_std", "log_section",
    "elongation", "taper", "uneven_taper", "squareness", "height_kurtosis",
)
"""Numbers of a description: logarithms of the cube root of the volume, of the height of the
centroid above the table, of the standard deviation of height and of the mean radius of gyration of
the level section [m]; then, without units, how much longer than wide it is, how the section shrinks
with height, how that differs between its two directions, its fourth harmonic (corners), and the
kurtosis of height (flat or pointed ends)."""
STEP = 1e-4
"""Step of the differences, in standard deviations of each tangent coordinate."""
LEAST_HEIGHT_M = 1e-3
_HELD = (8, 9, 13, 14)
"""Tangent coordinates that change nothing (places on the table) or are not described (bend)."""


def superquadric_moment(body: SuperquadricLike, p: int, q: int, r: int) -> np.ndarray:
    """Integral of x^p y^q z^r over each body in its own frame [m^(3 + p + q + r)], shape (fit,).

    The bend is left out.
    """
    if p % 2 or q % 2:
        return np.zeros(len(body.size_m))
    (a1, a2, a3), (e1, e2) = body.size_m.T, body.exponents.T
    kx, ky = body.taper.T
    section = e2**2 * np.exp(gammaln((p + 1) * e2 / 2) + gammaln((q + 1) * e2 / 2)
                             - gammaln((p + q + 2) * e2 / 2 + 1))
    along = np.zeros(len(a1))
    for i in range(p + 2):
        for j in range(q + 2):
            n = i + j + r
            if n % 2 == 0:
                along += (comb(p + 1, i) * comb(q + 1, j) * kx**i * ky**j * e1
                          * np.exp(betaln((n + 1) * e1 / 2, (p + q + 2) * e1 / 2 + 1)))
    return a1 ** (p + 1) * a2 ** (q + 1) * a3 ** (r + 1) * section * along


def superquadric_description(body: SuperquadricLike) -> Float[np.ndarray, "fit 9"]:
    """`DESCRIPTION` of bodies that stand on a table at height 0."""
    def moment(p: int, q: int, r: int) -> np.ndarray:
        return superquadric_moment(body, p, q, r) / volume

    volume = superquadric_moment(body, 0, 0, 0)
    c, z2, z3 = moment(0, 0, 1), moment(0, 0, 2), moment(0, 0, 3)
    z4, x2, y2 = moment(0, 0, 4), moment(2, 0, 0), moment(0, 2, 0)
    x2z, y2z, x2z2, y2z2 = (moment(*n) for n in ((2, 0, 1), (0, 2, 1), (2, 0, 2), (0, 2, 2)))
    # About the centroid, which lies on the z axis at c.
    second = np.stack([x2, y2, z2 - c**2], 1)
    third = np.stack([x2z - c * x2, y2z - c * y2, z3 - 3 * c * z2 + 2 * c**3], 1)
    fourth = np.stack([moment(4, 0, 0), moment(0, 4, 0),
                       z4 - 4 * c * z3 + 6 * c**2 * z2 - 3 * c**4], 1)
    mixed = np.stack([y2z2 - 2 * c * y2z + c**2 * y2, x2z2 - 2 * c * x2z + c**2 * x2,
                      moment(2, 2, 0)], 1)  # of the two axes other than x, y, z

    turn = matrix_of_quaternion(body.quaternion_xyzw)
    up, across = turn[:, 2], turn[:, 0] + 1j * turn[:, 1]
    other = np.conj(across)

    def three(a, b, d):  # third moment along the directions a, b, d
        own = third[:, 2] * a[:, 2] * b[:, 2] * d[:, 2]
        for k in (0, 1):
            own = own + third[:, k] * (a[:, k] * b[:, k] * d[:, 2] + a[:, k] * b[:, 2] * d[:, k]
                                       + a[:, 2] * b[:, k] * d[:, k])
        return own

    def four(a):  # fourth moment along a
        square = a**2
        pairs = np.stack([square[:, 1] * square[:, 2], square[:, 0] * square[:, 2],
                          square[:, 0] * square[:, 1]], 1)
        return (fourth * square**2).sum(1) + 6 * (mixed * pairs).sum(1)

    height = np.sqrt((second * up**2).sum(1))
    spread = (second * np.abs(across) ** 2).sum(1)
    elongation = np.abs((second * across**2).sum(1))
    centre = body.position_m[:, 2] + turn[:, 2, 2] * c
    area = np.sqrt(np.maximum(spread**2 - elongation**2, 1e-12 * spread**2)) / 2
    return np.stack([
        np.log(volume) / 3,
        np.log(np.maximum(centre, LEAST_HEIGHT_M)),
        np.log(height),
        np.log(area) / 2,
        elongation / spread,
        three(up, across, other).real / (height * spread),
        np.abs(three(up, across, across)) / (height * spread),
        np.abs(four(across)) / spread**2,
        four(up) / height**4,
    ], axis=1)


def description_covariance(
    body: Superquadric, covariance: Float[np.ndarray, "fit 15 15"]
) -> Float[np.ndarray, "fit 9 9"]:
    """Covariance of the descriptions, to first order, from that of the tangent coordinates.

    `covariance` is that of `fit.superquadric.uncertainty`.
    """
    fits = len(covariance)
    free = np.array(sorted(set(range(15)) - set(_HELD)))
    std = np.sqrt(np.maximum(np.einsum("fii->fi", covariance), 1e-12))
    # All steps up and down as bodies of one call.
    step = STEP * std.T[free, :, None] * np.eye(15)[free, None]
    moved = displaced(Superquadric(*(np.tile(field, (2 * len(free), 1)) for field in body)),
                      np.concatenate([step, -step]).reshape(-1, 15))
    up, down = superquadric_description(moved).reshape(2, len(free), fits, len(DESCRIPTION))
    slopes = np.zeros((fits, len(DESCRIPTION), 15))
    slopes[..., free] = np.moveaxis((up - down) / (2 * STEP * std.T[free, :, None]), 0, -1)
    return np.einsum("fik,fkl,fjl->fij", slopes, covariance, slopes)
