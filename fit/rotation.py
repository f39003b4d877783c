"""Unit quaternions (x, y, z, w), rotation matrices and directions, in batch."""

import numpy as np
from jaxtyping import Bool, Float


def matrix_of_quaternion(quaternion_xyzw: Float[np.ndarray, "*batch 4"]) -> np.ndarray:
    """Rotation matrices, shape [..., 3, 3]; columns are the body's axes in the world."""
    x, y, z, w = np.moveaxis(np.asarray(quaternion_xyzw, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def turn_points(
    rotation: Float[np.ndarray, "*#batch 3 3"], points: Float[np.ndarray, "*#batch point 3"]
) -> Float[np.ndarray, "*#batch point 3"]:
    """Points rotated by matrices.

    Written out, because einsum takes three to five times as long, and the rounding of a matrix
    product depends on memory layout, so that a row would depend on its neighbours.
    """
    x, y, z = (np.ascontiguousarray(v) for v in np.moveaxis(points, -1, 0))
    r = rotation[..., None]
    turned = np.empty((*np.broadcast_shapes(rotation.shape[:-2], points.shape[:-2]),
                       *points.shape[-2:]))
    for i in range(3):
        turned[..., i] = r[..., i, 0, :] * x + r[..., i, 1, :] * y + r[..., i, 2, :] * z
    return turned


def quaternion_of_matrix(rotation: Float[np.ndarray, "*batch 3 3"]) -> np.ndarray:
    """Unit quaternions x, y, z, w with w >= 0, shape [..., 4], stable for every angle.

    The symmetric matrix of products of quaternion components is linear in the rotation, and its
    largest row is proportional to the quaternion (after Bar-Itzhack 2000, with a row in place of
    the eigenvector, exact for a true rotation).
    """
    r = np.asarray(rotation, float)
    xx, yy, zz = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    xy, xz, yz = (r[..., i, j] + r[..., j, i] for i, j in ((0, 1), (0, 2), (1, 2)))
    xw, yw, zw = (r[..., i, j] - r[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0)))
    products = np.stack(
        [
            np.stack([1 + xx - yy - zz, xy, xz, xw], axis=-1),
            np.stack([xy, 1 - xx + yy - zz, yz, yw], axis=-1),
            np.stack([xz, yz, 1 - xx - yy + zz, zw], axis=-1),
            np.stack([xw, yw, zw, 1 + xx + yy + zz], axis=-1),
        ],
        axis=-2,
    )
    longest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    row = np.take_along_axis(products, longest[..., None, None], axis=-2)[..., 0, :]
    row = row / np.linalg.norm(row, axis=-1, keepdims=True)
    return np.where(row[..., 3:] < 0, -row, row)


def is_upward(direction: Float[np.ndarray, "fit 3"]) -> Bool[np.ndarray, "fit 1"]:
    """Whether z (else y, else x, where a component is zero but for rounding) is positive."""
    clear = np.abs(direction) > 1e-9
    last = np.where(clear[:, 2], 2, np.where(clear[:, 1], 1, 0))
    return np.take_along_axis(direction, last[:, None], axis=1) > 0
