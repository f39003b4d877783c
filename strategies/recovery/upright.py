"""A superquadric seen as a thing that stands: its level section, its height, its faces.

Any of a fitted body's three axes may be the one that stands upright; what a strategy asks (round or
blocky, how tall, where its faces are) does not depend on what that axis is called.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fit.rotation import matrix_of_quaternion
from fit.superquadric.geometry import (
    Superquadric,
    from_straight_frame,
    superquadric_inside_outside,
    superquadric_normals,
    superquadric_points,
)


@dataclass(frozen=True)
class Upright:
    """Bodies as they stand. Shapes start with (world,)."""

    section_exponent: np.ndarray
    """Of the level section: near 0 a rectangle, 1 an ellipse, 2 a rhomb."""
    profile_exponent: np.ndarray
    """Of the upright section: near 0 flat ends, 1 round ones."""
    axis: np.ndarray
    """The body axis that stands upright, upwards, unit (world, 3)."""
    body: Superquadric

    @property
    def centre_m(self) -> np.ndarray:
        """Middle of the body, (world, 3)."""
        return self.body.position_m

    @property
    def top_m(self) -> np.ndarray:
        """Highest point above the table."""
        return self._points[..., 2].max(1)

    @property
    def radius_m(self) -> np.ndarray:
        """Largest distance of the surface from the upright line through the centre."""
        x, y = (self._points[..., k] - self.centre_m[:, None, k] for k in range(2))
        return np.sqrt((x**2 + y**2).max(1))

    @cached_property
    def _points(self) -> np.ndarray:
        """On the surface, computed on first use, since they take most of the time."""
        return superquadric_points(self.body, 600)


def stand_upright(body: Superquadric) -> Upright:
    """How each body stands."""
    axes = matrix_of_quaternion(body.quaternion_xyzw)
    upright = np.abs(axes[:, 2]).argmax(1)
    e1, e2 = body.exponents.T
    on_z = upright == 2
    axis = axes[np.arange(len(axes)), :, upright]
    return Upright(
        section_exponent=np.where(on_z, e2, e1),
        # With x upright the section through x and y is that of e2.
        profile_exponent=np.where(on_z, e1, e2),
        axis=axis * np.where(axis[:, 2:] < 0, -1.0, 1.0),
        body=body,
    )


def faces_of(body: Superquadric) -> tuple[np.ndarray, np.ndarray]:
    """Middles [m] and outward normals of the six ends of the axes, each (world, 6, 3).

    In the order +x, -x, +y, -y, +z, -z of the body; normals are those of the surface there, so that
    the sides of a tapered body lean.
    """
    axes = matrix_of_quaternion(body.quaternion_xyzw)
    ways = np.concatenate([axes, -axes], 2).transpose(0, 2, 1)[:, [0, 3, 1, 4, 2, 5]]
    # Where they are after a bend, too; what is left below is rounding.
    ends = np.concatenate([np.eye(3), -np.eye(3)])[[0, 3, 1, 4, 2, 5]] * body.size_m[:, None]
    start = from_straight_frame(body, ends)
    arm = start - body.position_m[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        gauge = superquadric_inside_outside(body, start)
        points = body.position_m[:, None] + arm / np.clip(np.nan_to_num(gauge, nan=1.0), 0.5,
                                                          2.0)[..., None]
        normals = superquadric_normals(body, points)
    normals = np.where(np.isfinite(normals).all(-1, keepdims=True), normals, ways)
    return points, normals
