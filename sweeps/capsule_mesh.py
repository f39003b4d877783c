"""A capsule as a mesh, to be drawn: links of arm and hand are capsules."""

import numpy as np


def capsule_mesh(length: float, radius: float, around: int = 12,
                 rings: int = 4) -> tuple[np.ndarray, np.ndarray]:
    """Points (vertex, 3), about the middle of the axis, which is z; and quadrilaterals (face, 4).

    `length` is that of the axis, without the caps. Faces run anticlockwise seen from outside.
    """
    bend = np.linspace(0.0, np.pi / 2, rings + 1)
    z = np.concatenate([-length / 2 - radius * np.cos(bend), length / 2 + radius * np.sin(bend)])
    r = np.concatenate([radius * np.sin(bend), radius * np.cos(bend)])
    turn = np.linspace(0.0, 2 * np.pi, around, endpoint=False)
    points = np.stack([r[:, None] * np.cos(turn), r[:, None] * np.sin(turn),
                       np.repeat(z[:, None], around, 1)], axis=-1)
    here = np.arange(len(z) - 1)[:, None] * around + np.arange(around)
    after = np.arange(len(z) - 1)[:, None] * around + (np.arange(around) + 1) % around
    faces = np.stack([here, after, after + around, here + around], axis=-1)
    return points.reshape(-1, 3), faces.reshape(-1, 4)
