"""Which exponents an upright cylinder has under the paper's equation (1)."""

import numpy as np

from fit.superquadric.geometry import Superquadric, superquadric_inside_outside

RADIUS_M, HEIGHT_M = 0.035, 0.120
"""The large cylinder of the catalogue."""
SHARP = 0.1
"""The least exponent that fits allow."""
_CELLS = 60


def cylinder_overlap(e1: float, e2: float) -> float:
    """IoU of the upright cylinder and the superquadric of its size with exponents e1 and e2.

    F = ((x/a1)^(2/e2) + (y/a2)^(2/e2))^(e2/e1) + (z/a3)^(2/e1), z upright; on a grid.
    """
    at = (np.arange(_CELLS) + 0.5) / _CELLS * 2.0 - 1.0
    points = np.stack(np.meshgrid(at, at, at, indexing="ij"), -1).reshape(-1, 3)
    points = points * [RADIUS_M, RADIUS_M, HEIGHT_M / 2]
    body = Superquadric(
        size_m=np.array([[RADIUS_M, RADIUS_M, HEIGHT_M / 2]]), exponents=np.array([[e1, e2]]),
        position_m=np.zeros((1, 3)), quaternion_xyzw=np.array([[0.0, 0.0, 0.0, 1.0]]),
        taper=np.zeros((1, 2)), bend=np.zeros((1, 2)))
    inside = superquadric_inside_outside(body, points[None])[0] <= 1.0
    cylinder = np.hypot(points[:, 0], points[:, 1]) <= RADIUS_M
    return float((inside & cylinder).sum() / (inside | cylinder).sum())


def exponents_said() -> str:
    """The contradiction between the paper's text and its equation, with both overlaps."""
    along, swapped = cylinder_overlap(SHARP, 1.0), cylinder_overlap(1.0, SHARP)
    pairs = ("ε1 ≈ 0.1 and ε2 ≈ 1", "ε1 ≈ 1 and ε2 ≈ 0.1")
    right, wrong = pairs if along > swapped else pairs[::-1]
    agrees = "contradicts" if along > swapped else "agrees with"
    return (f"Under the paper's equation (1) a cylinder whose axis is z has {right}: the "
            f"superquadric of its size with these exponents has an IoU of "
            f"{max(along, swapped):.3f} with it; with {wrong} the IoU is "
            f"{min(along, swapped):.3f}. The paper's text gives its upright cylinder {pairs[1]}, "
            f"which {agrees} the equation. This page follows the equation.")
