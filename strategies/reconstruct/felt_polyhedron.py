"""A polyhedron of the faces that a pad has crossed, where it explains touches better than a model.

The planes of the faces and the table's close it, or they do not. Both it and the recovered model
are judged by what pads felt: contacts of fingers were placed on the model, and so lie near it.
Schwarz's criterion counts parameters, three a face, so that a body with a face more must pay for
it; a plane across a ridge, or one of a part that sticks out, is left out where it does not.
"""

from collections.abc import Sequence

import numpy as np

from fit.fit_status import FitStatus
from fit.implicit.record import TriangleMesh
from fit.polyhedron import polyhedron_distance, polyhedron_mesh
from strategies.poses.waypoints import BoundingCylinder
from strategies.procedures.planar_faces import Face
from strategies.recognition.descriptions import different_faces
from strategies.reconstruct.calibrated_planes import Planes
from strategies.recovery.choose_model import (
    CONTRADICTS_M,
    MOST_STRAYED,
    Recovered,
    Shape,
    parameter_count,
)
from strategies.recovery.contact_verdict import UNEXPLAINED_M, surface_gaps
from strategies.recovery.evidence import Evidence
from strategies.recovery.misfit import FARTHEST_M, schwarz
from strategies.recovery.plausibility import FEWEST_CONTACTS, plausible_vertices, swept_by
from warpgrasp.parameters import FitTable

FEWEST_FACES = 3
"""That must be felt: with the table the fewest that close a body."""
OF_A_FACE = 3
"""Parameters of a plane."""
CURVED_M = 0.0015
"""Sagitta from which on touches that fall away to both ends are those of a curved surface [est].
Where they rise instead, something stands out of a plane: the rim of a lid."""
LEAST_MISFIT_M = 0.0003
"""Mean distance of pads' touches from a body that explains them: nearer ones tell nothing [est]."""


def felt_polyhedron(
    faces: Sequence[Face], recovered: Recovered, evidence: Evidence, felt: Evidence,
    prior: BoundingCylinder, table: FitTable
) -> Planes | None:
    """The planes of one world's polyhedron; None where the model stands, for it explains what pads
    felt as well, or where contacts, free space, prior or table contradict the polyhedron.

    All arguments have one row; `evidence` has contacts as placed on the body `recovered`, `felt`
    all free space.
    """
    mask, pads = evidence.mask[0], (evidence.mask & evidence.by_pad)[0]
    planes = crossed_planes(faces, table_plane=table.table_plane)
    if planes is None or pads.sum() < FEWEST_CONTACTS:
        return None
    points = evidence.points_m[0]
    planes = _least(planes, points[pads])
    if planes is None:
        return None
    away = np.abs(polyhedron_distance(planes.normals, planes.offset_m, points[mask]))
    own = _mean(away[pads[mask]])
    if own > UNEXPLAINED_M or (away > CONTRADICTS_M).mean() > MOST_STRAYED:
        return None
    if recovered.shape[0] != Shape.PRIOR:
        others = _mean(surface_gaps(recovered, evidence.points_m, evidence.mask)[0][pads])
        count = int(pads.sum())
        if (_evidence(own, count, planes.felt * OF_A_FACE)
                >= _evidence(others, count, parameter_count(recovered, table))):
            return None
    return planes if _agrees(planes, felt, prior, table) else None


def crossed_planes(faces: Sequence[Face], *, table_plane: bool) -> Planes | None:
    """The planes that pads have crossed in one world, each once, and the table's; None where these
    are too few. Touches of a curved surface are none of a plane's."""
    known = np.flatnonzero([face.fit.status[0] == FitStatus.converged
                            and (face.bow_m[0] >= -CURVED_M).all() for face in faces])
    if len(known) < FEWEST_FACES:
        return None
    kept = different_faces(tuple(faces), known, 0)
    if len(kept.normals) < FEWEST_FACES:
        return None
    normals, offset = kept.normals, (kept.normals * kept.points_m).sum(1)
    if table_plane:
        normals, offset = np.append(normals, [[0.0, 0.0, -1.0]], axis=0), np.append(offset, 0.0)
    return Planes(normals, offset, len(kept.normals))


def mesh_of_planes(planes: Planes) -> TriangleMesh:
    """The surface of the polyhedron, without faces where the planes hold none."""
    try:
        return polyhedron_mesh(planes.normals, planes.offset_m)
    except ValueError:  # they leave it open
        return TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), int))


def _least(planes: Planes, points: np.ndarray) -> Planes | None:
    """The planes without those that touches (point, 3) do not ask for; None where they are open."""
    best = _cost(planes, points)
    while planes.felt > FEWEST_FACES:
        fewer = [_without(planes, face) for face in range(planes.felt)]
        costs = [_cost(each, points) for each in fewer]
        least = int(np.argmin(costs))
        if costs[least] >= best:
            break
        planes, best = fewer[least], costs[least]
    return planes if np.isfinite(best) else None


def _without(planes: Planes, face: int) -> Planes:
    return Planes(np.delete(planes.normals, face, axis=0), np.delete(planes.offset_m, face),
                  planes.felt - 1)


def _cost(planes: Planes, points: np.ndarray) -> float:
    """Schwarz's criterion of a polyhedron; infinite where the planes hold none."""
    try:
        away = polyhedron_distance(planes.normals, planes.offset_m, points)
    except ValueError:  # they leave it open
        return np.inf
    if not np.isfinite(away).all():
        return np.inf
    return _evidence(_mean(np.abs(away)), len(points), planes.felt * OF_A_FACE)


def _evidence(misfit_m: float, contacts: int, parameters: int) -> float:
    return schwarz(misfit_m, contacts, parameters, LEAST_MISFIT_M)


def _mean(away: np.ndarray) -> float:
    return float(np.minimum(away, FARTHEST_M).mean())


def _agrees(planes: Planes, felt: Evidence, prior: BoundingCylinder, table: FitTable) -> bool:
    """Whether prior, table and free space allow the polyhedron."""
    mesh = mesh_of_planes(planes)
    if not plausible_vertices([mesh.vertices_m], prior, table_plane=table.table_plane)[0]:
        return False
    if not table.free_space:
        return True
    away = polyhedron_distance(planes.normals, planes.offset_m, felt.free_m[0])
    return not swept_by(away[None], felt.free_mask)[0]
