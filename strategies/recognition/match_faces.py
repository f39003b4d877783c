"""How well the flat faces that were felt belong to the known polyhedra.

The interpretation tree finds which face is which, and the pose (`fit.interpretation_tree`). The
table is one more face, under every body. Angles must agree; distances between faces decide, by a
normal density for a known body and a broad one for any other.
"""

from collections.abc import Sequence

import numpy as np

from fit.interpretation_tree import (
    FaceModel,
    Interpretation,
    interpret_sets,
    model_of_planes,
)
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


def best_interpretations(
    felt: Sequence[FeltFaces], model: FaceModel
) -> list[Interpretation | None]:
    """Of each world's faces the one that assigns most of them; none if more than one face, or the
    table, is left over."""
    best: list[Interpretation | None] = [None] * len(felt)
    counts = np.array([len(faces.points_m) for faces in felt], int)
    for count in np.unique(counts):
        index = np.flatnonzero(counts == count).tolist()
        touches = [with_table(felt[k]) for k in index]
        found = interpret_sets(np.array([points for points, _ in touches]),
                               np.array([normals for _, normals in touches]), model,
                               angle_rad=ANGLE_RAD, distance_m=DISTANCE_M,
                               most_null=1 if count > 2 else 0)
        for k, each in zip(index, found, strict=True):
            best[k] = next((one for one in each if one.assignment[-1] >= 0), None)
    return best


def log_density_of_faces(
    felt: Sequence[FeltFaces], model: FaceModel, std_m: float
) -> np.ndarray:
    """Log densities of the distances felt in each world, (world,), if the body is this one; minus
    infinity where it cannot be.

    `std_m` is the standard deviation of a plane about the model's.
    """
    return np.array([
        -np.inf if found is None else _log_density(faces, found, std_m)
        for faces, found in zip(felt, best_interpretations(felt, model), strict=True)])


def _log_density(faces: FeltFaces, found: Interpretation, std_m: float) -> float:
    on = np.array(found.assignment[:-1]) >= 0
    distances, spurious = _distances(faces.normals[on]), int((~on).sum())
    # Some of those left over tell no distance, but alone fix the place one way: of any body, too.
    placing = spurious + distances - _distances(faces.normals)
    square = float((found.away_m**2).sum()) / std_m**2
    return (-0.5 * square - distances * np.log(std_m * np.sqrt(2 * np.pi))
            + spurious * (np.log(SPURIOUS) + BROAD) - placing * BROAD)


def log_density_of_any(felt: Sequence[FeltFaces]) -> np.ndarray:
    """The same for a body of which nothing is known."""
    return np.array([_distances(faces.normals) * BROAD for faces in felt])


def _distances(normals: np.ndarray) -> int:
    """How many distances faces (face, 3) have: as many as faces, less those that fix the place."""
    level = np.linalg.norm(normals[:, :2], axis=1) > 0.5
    return len(normals) - int(np.linalg.matrix_rank(normals[level, :2], tol=0.3))
