"""Starts of the descents of a superquadric fit: boxes around the points."""

import numpy as np
from jaxtyping import Bool, Float

from fit.rotation import turn_points

YAW_CANDIDATES = 18
"""Directions tried for the smallest upright box, over 90 degrees."""
MIN_RELATIVE_EXTENT = 0.05
"""Minimum extent of a start, as a fraction of its largest extent."""


def box_starts(
    points: Float[np.ndarray, "fit point 3"],
    mask: Bool[np.ndarray, "fit point"],
    down: Float[np.ndarray, "fit 3"] | None,
    floor: Float[np.ndarray, " fit"] | None,
    trim: float,
    upright_only: bool = False,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rotations [fit, start, 3, 3], half extents and centres [fit, start, 3] of the starts.

    Three starts use the principal axes, with each axis as z, since a tapered shape fails along the
    wrong one. With a support plane, three more use the upright box of least area, because uneven
    touches rotate the principal axes away from the faces. `trim` is the fraction of points
    ignored beyond each extent, for outliers. `floor` is the height of the plane along `down`.
    `upright_only`, which needs a plane, leaves out the principal axes.
    """
    kept = mask[..., None]
    mean = (points * kept).sum(1) / kept.sum(1)
    spread = np.where(kept, points - mean[:, None], 0.0)
    frames = [] if upright_only else [_cycled(_principal_axes(spread))]
    if down is not None:
        frames.append(_cycled(_upright_axes(spread, mask, down)))
    rotation = np.concatenate(frames, axis=1)
    local = turn_points(rotation.swapaxes(2, 3), points[:, None])
    low, high = _extent(local, mask[:, None], trim)
    if down is not None and floor is not None:
        # The body reaches the table even where it was not touched.
        along = np.einsum("fi,fsij->fsj", down, rotation)
        bottom = floor[:, None, None] / np.where(np.abs(along) > 0.9, along, 1.0)
        low = np.where(along < -0.9, np.minimum(low, bottom), low)
        high = np.where(along > 0.9, np.maximum(high, bottom), high)
    half = 0.5 * (high - low)
    half = np.maximum(half, MIN_RELATIVE_EXTENT * half.max(axis=-1, keepdims=True))
    centre = np.einsum("fsij,fsj->fsi", rotation, 0.5 * (high + low))
    return rotation, half, centre


def taper_starts(
    points: Float[np.ndarray, "fit point 3"],
    mask: Bool[np.ndarray, "fit point"],
    rotation: Float[np.ndarray, "fit start 3 3"],
    half: Float[np.ndarray, "fit start 3"],
    centre: Float[np.ndarray, "fit start 3"],
) -> Float[np.ndarray, "fit start 2"]:
    """Taper of each start, from the root mean square widths above and below its middle.

    The width is 1 + K/2 half way up and 1 - K/2 half way down.
    """
    local = turn_points(rotation.swapaxes(2, 3), points[:, None])
    local = local - np.einsum("fsi,fsij->fsj", centre, rotation)[:, :, None]
    height = local[..., 2] / half[..., None, 2]
    width = []
    for side in (1.0, -1.0):
        # Exclude points near the ends, which may lie on flat faces.
        weight = mask[:, None] * ((side * height > 0.1) & (side * height < 0.85))
        total = np.maximum(weight.sum(axis=2), 1)
        square = (weight[..., None] * local[..., :2] ** 2).sum(axis=2) / total[..., None]
        width.append(np.sqrt(square) + 1e-6)
    return np.clip(2 * (width[0] - width[1]) / (width[0] + width[1]), -0.9, 0.9)


def _principal_axes(spread: np.ndarray) -> np.ndarray:
    """Right-handed principal axes as columns, shape [fit, 3, 3], largest last."""
    _, axes = np.linalg.eigh(np.einsum("fpi,fpj->fij", spread, spread))
    return axes * np.where(np.linalg.det(axes) < 0, -1.0, 1.0)[:, None, None]


def _upright_axes(spread: np.ndarray, mask: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Axes with z up whose x, y box has the least area."""
    up = -down
    flat = spread - (spread @ up[..., None]) * up[:, None]
    x = _principal_axes(flat)[:, :, 2]
    y = np.cross(up, x)
    angle = np.arange(YAW_CANDIDATES) * (np.pi / 2 / YAW_CANDIDATES)
    cos, sin = np.cos(angle), np.sin(angle)
    px, py = (np.einsum("fpi,fi->fp", flat, axis)[:, None] for axis in (x, y))
    c, s = cos[None, :, None], sin[None, :, None]
    area = np.ones((len(spread), YAW_CANDIDATES))
    for coordinate in (c * px + s * py, c * py - s * px):
        low, high = _extent(coordinate[..., None], mask[:, None], 0.0)
        area *= (high - low)[..., 0]
    best = np.argmin(area, axis=1)
    cos, sin = cos[best, None], sin[best, None]
    return np.stack([cos * x + sin * y, cos * y - sin * x, up], axis=-1)


def _cycled(axes: np.ndarray) -> np.ndarray:
    """The three right-handed frames with each axis as z, shape [fit, 3, 3, 3]."""
    return np.stack([axes, axes[..., [1, 2, 0]], axes[..., [2, 0, 1]]], axis=1)


def _extent(local: np.ndarray, mask: np.ndarray, trim: float) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest coordinates of points, without the fraction `trim` at each end."""
    ordered = np.sort(np.where(mask[..., None], local, np.inf), axis=-2)
    count = np.broadcast_to(mask.sum(-1), local.shape[:-2])
    beyond = np.floor(trim * count).astype(int)[..., None, None]
    low = np.take_along_axis(ordered, np.broadcast_to(beyond, (*count.shape, 1, 1)), axis=-2)
    top = count[..., None, None] - 1 - beyond
    high = np.take_along_axis(ordered, top, axis=-2)
    return low[..., 0, :], high[..., 0, :]
