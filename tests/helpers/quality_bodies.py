"""Random bodies on a table and touches on them: the experiment of the quality table."""

import numpy as np

from fit.superquadric.geometry import (
    Superquadric,
    superquadric,
    superquadric_inside_outside,
    superquadric_surface,
)


def standing_bodies(n: int, rng: np.random.Generator, *, taper=0.0, bend=0.0) -> Superquadric:
    """Block-like to ellipsoidal bodies, half extents 20 to 60 mm, upright on the table z = 0."""
    size = rng.uniform(0.02, 0.06, (n, 3))
    yaw = rng.uniform(-np.pi, np.pi, n)
    turn = np.stack([0 * yaw, 0 * yaw, np.sin(yaw / 2), np.cos(yaw / 2)], axis=1)
    place = np.stack([0.45 + rng.uniform(-0.02, 0.02, n), rng.uniform(-0.02, 0.02, n), size[:, 2]],
                     axis=1)
    body = superquadric(size, rng.uniform(0.1, 1.0, (n, 2)), place, turn,
                        rng.uniform(-taper, taper, (n, 2)),
                        np.stack([rng.uniform(0, bend, n), rng.uniform(-np.pi, np.pi, n)], axis=1))
    sunk = superquadric_surface(body, 6000)[0][..., 2].min(axis=1)
    return body._replace(position_m=body.position_m - sunk[:, None] * [0, 0, 1])


def touches(body: Superquadric, count: int, noise_m: float, rng: np.random.Generator, *,
            outliers: float = 0.0, untouched: float = 0.1) -> np.ndarray:
    """Points even over the surface but for its lowest part, shape [fit, count, 3] in metres.

    `outliers` is the share that stands 15 mm off in a random direction.
    """
    surface, _, area = superquadric_surface(body, 6000)
    height = surface[..., 2].max(axis=1, keepdims=True)
    weight = area * (surface[..., 2] > untouched * height)
    points = np.stack([p[rng.choice(len(p), count, p=w / w.sum())]
                       for p, w in zip(surface, weight, strict=True)])
    points = points + noise_m * rng.normal(size=points.shape)
    away = rng.normal(size=(len(points), round(outliers * count), 3))
    away *= 0.015 / np.linalg.norm(away, axis=2, keepdims=True)
    points[:, : away.shape[1]] += away
    return points


def volume_iou(a, b, samples: int = 20000, seed: int = 0) -> np.ndarray:
    """Volume of intersection over union, by even samples of the common box, shape [fit]."""
    corners = np.concatenate([superquadric_surface(x, 600)[0] for x in (a, b)], axis=1)
    low, high = corners.min(axis=1), corners.max(axis=1)
    unit = np.random.default_rng(seed).random((samples, 3))
    points = low[:, None] + unit * (high - low)[:, None]
    in_a, in_b = (superquadric_inside_outside(x, points) < 1 for x in (a, b))
    return (in_a & in_b).sum(axis=1) / (in_a | in_b).sum(axis=1)
