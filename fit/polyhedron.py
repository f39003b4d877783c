"""Convex polyhedra from touches, in batch, by k-planes.

Starting from a box (a fitted superquadric's frame), alternately assign each touch to the face with
the largest signed distance and refit every face with enough touches, until nothing changes.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from fit.arrays import is_valid
from fit.rotation import matrix_of_quaternion
from fit.superquadric.geometry import SuperquadricLike

FACE_POINTS = 4
"""Minimum number of touches to tilt a face; fewer only shift it."""
ROUNDS = 30


@dataclass(frozen=True)
class PolyhedronFit:
    """Polyhedra n.x <= offset for every face in use, one per row."""

    normal: Float[np.ndarray, "fit face 3"]
    offset_m: Float[np.ndarray, "fit face"]
    used: Bool[np.ndarray, "fit face"]
    """Faces determined by touches; the others are those of the box."""
    touches: Int[np.ndarray, "fit face"]
    """Number of touches on each face."""
    distance_m: Float[np.ndarray, "fit point"]
    """Signed distance of each touch to the plane of its face [m]; 0 for padding."""


def fit_polyhedron(
    points: Float[np.ndarray, "fit point 3"],
    mask: Bool[np.ndarray, "fit point"],
    box: SuperquadricLike,
) -> PolyhedronFit:
    """Fit six-faced convex polyhedra to touches [m], starting from the boxes around `box`."""
    rotation = matrix_of_quaternion(box.quaternion_xyzw)
    axes = np.moveaxis(rotation, 2, 1)
    normal = np.concatenate([axes, -axes], axis=1)
    offset = np.einsum("fki,fi->fk", normal, box.position_m) + np.tile(box.size_m, (1, 2))
    mask = mask & is_valid(points).all(axis=2)
    points = np.where(mask[..., None], points, 0.0)
    face = np.full(mask.shape, -1)
    for _ in range(ROUNDS):
        out = np.einsum("fpi,fki->fpk", points, normal) - offset[:, None]
        now = np.where(mask, np.argmax(out, axis=2), -1)
        if np.array_equal(now, face):
            break
        face = now
        member = (face[..., None] == np.arange(6)) & mask[..., None]
        count = member.sum(axis=1)
        some = np.maximum(count, 1)
        mean = np.einsum("fpk,fpi->fki", member, points) / some[..., None]
        spread = points[:, None] - mean[:, :, None]
        scatter = np.einsum("fpk,fkpi,fkpj->fkij", member, spread, spread)
        values, vectors = np.linalg.eigh(scatter)
        found = vectors[..., 0]
        found = found * np.sign(np.einsum("fki,fki->fk", found, normal) + 1e-12)[..., None]
        # Tilt a face only if touches spread in two directions, and never past its neighbours.
        wide = values[..., 1] > 4 * values[..., 0] + 1e-18
        close = np.einsum("fki,fki->fk", found, normal) > 0.75
        turns = (count >= FACE_POINTS) & wide & close
        normal = np.where(turns[..., None], found, normal)
        offset = np.where(count > 0, np.einsum("fki,fki->fk", normal, mean), offset)
    out = np.einsum("fpi,fki->fpk", points, normal) - offset[:, None]
    count = ((np.argmax(out, axis=2)[..., None] == np.arange(6)) & mask[..., None]).sum(axis=1)
    return PolyhedronFit(normal, offset, count > 0, count, np.where(mask, out.max(axis=2), 0.0))
