"""Meshes such as scanners make of everyday objects: closed, not quite regular, uneven by noise.

They stand in for scanned objects in checks and tests, and need no files from elsewhere.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

_AROUND, _ALONG = 72, 60
_NOISE_M = 2e-4


def _tube(name: str, half_m: Callable[[np.ndarray, np.ndarray], np.ndarray],
          middle_m: np.ndarray, ahead: np.ndarray) -> Any:
    """A closed mesh of rings about a line through `middle_m` (ring, 3), across `ahead` (ring, 3).

    `half_m` gives the radius for the share of the length and the azimuth about the line; both ends
    are closed by fans. Radii are uneven by `_NOISE_M`, smooth over some millimetres.
    """
    import trimesh

    along, angle = np.meshgrid(np.linspace(0.0, 1.0, _ALONG),
                               2 * np.pi * np.arange(_AROUND) / _AROUND, indexing="ij")
    noise = np.random.default_rng(sum(name.encode())).normal(size=along.shape)
    for axis in (0, 1):
        noise = (noise + np.roll(noise, 1, axis) + np.roll(noise, -1, axis)) / np.sqrt(3.0)
    radius = half_m(along, angle) + _NOISE_M * noise
    side = np.cross([0.0, 1.0, 0.0], ahead)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(ahead, side)
    rings = middle_m[:, None] + radius[..., None] * (
        np.cos(angle)[..., None] * side[:, None] + np.sin(angle)[..., None] * up[:, None])
    vertices = np.concatenate([rings.reshape(-1, 3), middle_m[[0, -1]]])
    k, j = np.meshgrid(np.arange(_ALONG - 1), np.arange(_AROUND), indexing="ij")
    a, b = k * _AROUND + j, k * _AROUND + (j + 1) % _AROUND
    first, last = _ALONG * _AROUND, _ALONG * _AROUND + 1
    ring = np.arange(_AROUND)
    after = (ring + 1) % _AROUND
    top = (_ALONG - 1) * _AROUND
    faces = np.concatenate([
        np.stack([a, b, b + _AROUND], -1).reshape(-1, 3),
        np.stack([a, b + _AROUND, a + _AROUND], -1).reshape(-1, 3),
        np.stack([after, ring, np.full(_AROUND, first)], -1),
        np.stack([top + ring, top + after, np.full(_AROUND, last)], -1)])
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.fix_normals()
    return mesh


def _upright(height_m: float) -> tuple[np.ndarray, np.ndarray]:
    z = np.linspace(0.0, height_m, _ALONG)
    zero = np.zeros_like(z)
    return np.stack([zero, zero, z], 1), np.tile([0.0, 0.0, 1.0], (_ALONG, 1))


def _rectangle(angle: np.ndarray, half: tuple[float, float], exponent: float) -> np.ndarray:
    """Radius of a superellipse at an azimuth."""
    return np.asarray((np.abs(np.cos(angle) / half[0]) ** (2.0 / exponent)
                       + np.abs(np.sin(angle) / half[1]) ** (2.0 / exponent)) ** (-exponent / 2.0))


def scan_meshes() -> dict[str, Any]:
    """Trimesh meshes [m] by name: a carton with bulging faces, a can, an oval bottle, a banana."""
    bend = np.radians(np.linspace(-40.0, 40.0, _ALONG))
    arc = 0.13 * np.stack([np.sin(bend), 1.0 - np.cos(bend), np.zeros_like(bend)], 1)
    turned = np.stack([np.cos(bend), np.sin(bend), np.zeros_like(bend)], 1)

    def bottle(along: np.ndarray, angle: np.ndarray) -> np.ndarray:
        neck = 1.0 / (1.0 + np.exp((along - 0.78) * 28.0))
        return _rectangle(angle, (0.028, 0.046), 0.9) * (0.25 + 0.75 * neck)

    return {
        "carton": _tube("carton", lambda along, angle: _rectangle(angle, (0.030, 0.080), 0.12)
                        * (1.0 + 0.02 * np.sin(np.pi * along)), *_upright(0.21)),
        "can": _tube("can", lambda along, angle: 0.0505 + 0.0010 * (
            np.abs(along - 0.5) > 0.485) + 0.0 * angle, *_upright(0.14)),
        "oval_bottle": _tube("oval_bottle", bottle, *_upright(0.19)),
        "banana": _tube("banana", lambda along, angle: 0.018 * np.sqrt(
            np.clip(1.0 - (2.0 * along - 1.0) ** 6, 0.06, 1.0)) + 0.0008 * np.cos(5 * angle),
            arc, turned)}
