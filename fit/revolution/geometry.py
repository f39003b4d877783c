"""Geometry of bodies of revolution with piecewise linear contours, in batch."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from fit.arrays import row_sums, rows_of
from fit.option_checks import checked_array

UNIT = 1e-6
"""By how much an axis may be longer or shorter than 1."""


@dataclass(frozen=True)
class RevolutionBody:
    """Bodies of revolution, one per row; NaN after the last node of a contour.

    Raises ValueError for arrays whose shapes disagree, axes that are neither of length 1 nor NaN,
    heights that fall, negative radii, and nodes after one that is not finite.
    """

    foot_m: Float[np.ndarray, "fit 3"]
    """Lower end of the axis [m]."""
    axis: Float[np.ndarray, "fit 3"]
    """Unit direction from the foot."""
    height_m: Float[np.ndarray, "fit node"]
    """Height of each node along the axis [m], rising from 0."""
    radius_m: Float[np.ndarray, "fit node"]

    def __post_init__(self) -> None:
        n, nodes = np.shape(self.height_m)[:1], (None, None)
        for name, shape in (("height_m", nodes), ("radius_m", np.shape(self.height_m)),
                            ("foot_m", (*n, 3)), ("axis", (*n, 3))):
            checked_array(name, getattr(self, name), shape)
        length = np.linalg.norm(self.axis, axis=1)
        if (wrong := np.abs(length - 1.0) > UNIT).any():  # heights are measured along them
            raise ValueError(f"axis: {np.asarray(self.axis)[wrong][0].tolist()}, should be of "
                             "length 1")
        height, radius = np.asarray(self.height_m), np.asarray(self.radius_m)
        known = np.isfinite(height) & np.isfinite(radius)
        gap = (known[:, 1:] & ~known[:, :-1]).any(1) | np.isinf(height + radius).any(1)
        for name, values, wrong, right in (
                ("height_m", height, (height[:, 1:] < height[:, :-1]).any(1), "rising"),
                ("radius_m", radius, (radius < 0.0).any(1), "0 or more"),
                ("height_m", height, gap, "finite, as radius_m, and NaN after the last node")):
            if wrong.any():
                raise ValueError(f"{name}: {values[wrong][0].tolist()}, should be {right}")

    def __len__(self) -> int:
        return len(self.foot_m)

    def __getitem__(self, index) -> "RevolutionBody":
        """The bodies `index`."""
        return rows_of(self, np.atleast_1d(np.arange(len(self))[index]))


def revolution_volume(body: RevolutionBody) -> Float[np.ndarray, " fit"]:
    """Volume [m^3] of stacked cone frustums."""
    low, high = body.radius_m[:, :-1], body.radius_m[:, 1:]
    step = np.diff(body.height_m, axis=1)
    return np.pi / 3 * row_sums(step * (low**2 + low * high + high**2))


def revolution_inside(
    body: RevolutionBody, points: Float[np.ndarray, "fit point 3"]
) -> Bool[np.ndarray, "fit point"]:
    """Whether points [m] lie inside. Raises ValueError for points of another shape."""
    along, away = _half_plane(body, points)
    return away < _radius_at(body, along)


def revolution_distance(
    body: RevolutionBody, points: Float[np.ndarray, "fit point 3"]
) -> Float[np.ndarray, "fit point"]:
    """Unsigned distance [m] of points to the surface, with both ends closed by discs. Raises
    ValueError for points of another shape."""
    along, away = _half_plane(body, points)
    out = np.full(along.shape, np.inf)
    for row in range(len(body)):
        z, r = _closed(body, row)
        p = np.stack([along[row], away[row]], 1)[:, None]
        start = np.stack([z[:-1], r[:-1]], 1)
        way = np.stack([np.diff(z), np.diff(r)], 1)
        square = np.maximum((way**2).sum(1), 1e-18)
        t = np.clip(((p - start) * way).sum(-1) / square, 0.0, 1.0)
        out[row] = np.linalg.norm(p - start - t[..., None] * way, axis=-1).min(1)
    return out


def closed_contours(body: RevolutionBody) -> Float[np.ndarray, "fit node 2"]:
    """Contours (height, radius) from the axis around both ends back to it; the last node repeats
    where a contour has fewer than others."""
    out = np.zeros((len(body), body.height_m.shape[1] + 2, 2))
    for row in range(len(body)):
        node = np.stack(_closed(body, row), 1)
        out[row, :len(node)], out[row, len(node):] = node, node[-1]
    return out


def revolution_surface(
    body: RevolutionBody, around: int = 24, rings: int = 36
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Surface points [m], outward unit normals, and the area [m^2] of each point.

    Shapes [fit, rings * around, 3], the same, and [fit, rings * around]. Rings are evenly spaced
    along the closed contour and points around each; every other ring is rotated by half a spacing.
    """
    count = rings * around
    points, normals = np.zeros((len(body), count, 3)), np.zeros((len(body), count, 3))
    area = np.zeros((len(body), count))
    number = np.arange(rings)
    angle = 2 * np.pi * (np.arange(around)[None] + 0.5 * (number % 2)[:, None]) / around
    for row in range(len(body)):
        z, r = _closed(body, row)
        length = np.hypot(np.diff(z), np.diff(r))
        s = np.concatenate([[0.0], np.cumsum(length)])
        edge = np.linspace(0.0, s[-1], rings + 1)
        middle = 0.5 * (edge[1:] + edge[:-1])
        rz, rr = np.interp(middle, s, z), np.interp(middle, s, r)
        piece = np.clip(np.searchsorted(s, middle, side="right") - 1, 0, len(length) - 1)
        with np.errstate(invalid="ignore", divide="ignore"):
            nz = np.nan_to_num(-(np.diff(r) / length)[piece])
            nr = np.nan_to_num((np.diff(z) / length)[piece])
        u, v = _across(body.axis[row])
        out = np.cos(angle)[..., None] * u + np.sin(angle)[..., None] * v
        points[row] = (body.foot_m[row] + rz[:, None, None] * body.axis[row]
                       + rr[:, None, None] * out).reshape(-1, 3)
        normals[row] = (nz[:, None, None] * body.axis[row]
                        + nr[:, None, None] * out).reshape(-1, 3)
        area[row] = np.repeat(2 * np.pi * np.maximum(rr, 1e-6) * np.diff(edge) / around, around)
    return points, normals, area


def _half_plane(body: RevolutionBody, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Heights along the axis and distances from it."""
    arm = checked_array("points", points, (len(body), None, 3)) - body.foot_m[:, None]
    along = np.einsum("fpi,fi->fp", arm, body.axis)
    return along, np.linalg.norm(arm - along[..., None] * body.axis[:, None], axis=-1)


def _closed(body: RevolutionBody, row: int) -> tuple[np.ndarray, np.ndarray]:
    """The contour (z, r) of one body, from the axis around both ends back to the axis."""
    known = np.isfinite(body.height_m[row]) & np.isfinite(body.radius_m[row])
    z, r = body.height_m[row][known], body.radius_m[row][known]
    if len(z) == 0:
        z = r = np.zeros(1)
    return (np.concatenate([z[:1], z, z[-1:]]), np.concatenate([[0.0], r, [0.0]]))


def _radius_at(body: RevolutionBody, along: np.ndarray) -> np.ndarray:
    """Radius at heights along the axis, -1 beyond its ends."""
    out = np.full(along.shape, -1.0)
    for row in range(len(body)):
        known = np.isfinite(body.height_m[row]) & np.isfinite(body.radius_m[row])
        if known.any():
            out[row] = np.interp(along[row], body.height_m[row][known], body.radius_m[row][known],
                                 left=-1.0, right=-1.0)
    return out


def _across(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors orthogonal to the axis and to each other."""
    other = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
    u = np.cross(axis, other)
    u /= np.linalg.norm(u)
    return u, np.cross(axis, u)
