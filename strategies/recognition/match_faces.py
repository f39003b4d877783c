"""How well the flat faces that were felt belong to the known polyhedra.

The interpretation tree finds which face is which, and the pose (`fit.interpretation_tree`). The
table is one more face, under every body. Angles must agree; distances between faces decide, by a
normal density for a known body and a broad one for any other.
"""

import numpy as np

from fit.interpretation_tree import FaceModel, Interpretation, interpret, model_of_planes
from strategies.recognition.descriptions import FeltFaces

ANGLE_RAD = np.radians(4)
"""Error of a felt normal, at most [est]: on blocks and wedges 95 % lie within one degree."""
DISTANCE_M = 0.006
"""Error of a felt plane, at most [est]."""
BOX_M = 1.0
"""How far a polyhedron reaches where no face was felt."""
SPURIOUS = 0.1
"""Probability that a plane was felt where there is no face: across a ridge, or what stands beside
it [est]."""
TYPICAL_M, SPREAD = 0.08, 0.6
"""Distances of faces of any body: the median and the spread of the logarithm [est]."""
BROAD = -np.log(TYPICAL_M * SPREAD * np.sqrt(2 * np.pi))
"""Log density [1/m] of one distance of any body."""


def with_table(faces: FeltFaces) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals of the faces and, last, of the table under them, (face + 1, 3) each."""
    below = faces.points_m.mean(axis=0) * [1.0, 1.0, 0.0]
    return (np.concatenate([faces.points_m, below[None]]),
            np.concatenate([faces.normals, [[0.0, 0.0, -1.0]]]))


def closed_model(name: str, normals: np.ndarray, offset_m: np.ndarray) -> FaceModel | None:
    """The body of planes (face, 3), (face,) [m], within a box where they leave it open.

    None where they hold no body.
    """
    sides = np.concatenate([np.eye(3), -np.eye(3)])
    for extra in (sides[:0], sides):
        try:
            model = model_of_planes(name, np.concatenate([normals, extra]),
                                    np.concatenate([offset_m, np.full(len(extra), BOX_M)]))
        except ValueError:
            continue
        return model if len(model.faces) >= 4 else None
    return None


def best_interpretation(faces: FeltFaces, model: FaceModel) -> Interpretation | None:
    """The one that assigns most faces; none if more than one face, or the table, is left over."""
    points, normals = with_table(faces)
    spare = 1 if len(faces.points_m) > 2 else 0
    found = interpret(points, normals, model, angle_rad=ANGLE_RAD, distance_m=DISTANCE_M,
                      most_null=spare)
    return next((f for f in found if f.assignment[-1] >= 0), None)


def log_density_of_faces(faces: FeltFaces, model: FaceModel, std_m: float) -> float:
    """Log density of the distances felt if the body is this one; minus infinity if it cannot be.

    `std_m` is the standard deviation of a plane about the model's.
    """
    found = best_interpretation(faces, model)
    if found is None:
        return -np.inf
    on = np.array(found.assignment[:-1]) >= 0
    spurious = int((~on).sum())
    square = float((found.away_m**2).sum()) / std_m**2
    return (-0.5 * square - _distances(faces.normals[on]) * np.log(std_m * np.sqrt(2 * np.pi))
            + spurious * (np.log(SPURIOUS) + BROAD))


def log_density_of_any(faces: FeltFaces) -> float:
    """The same for a body of which nothing is known."""
    return _distances(faces.normals) * BROAD


def _distances(normals: np.ndarray) -> int:
    """How many distances faces (face, 3) have: as many as faces, less those that fix the place."""
    level = np.linalg.norm(normals[:, :2], axis=1) > 0.5
    return len(normals) - int(np.linalg.matrix_rank(normals[level, :2], tol=0.3))
