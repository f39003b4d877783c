"""Scores of recovered meshes, defined as those of other bodies.

Distances from the true surface go to the mesh itself, those from the mesh are of points spread
evenly over its area (`fit.implicit.surface_samples`). Everything is computed in the true body's
frame; its sample is the one that superquadrics are scored by (`sweeps.episode.scores`).
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fit.arrays import joined, rows_of, with_rows
from fit.implicit.record import TriangleMesh
from fit.rotation import matrix_of_quaternion
from sweeps.episode.scores import (
    COVERAGE_M,
    FINE,
    Samples,
    Scorer,
    Scores,
    distance_to_surface,
    weighted_quantile,
)
from warpgrasp.geometry.body import Body
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects.mesh_orientation import (
    mesh_distance,
    mesh_gap,
    mesh_of,
    simple_mesh_distance,
)

WORLDS_AT_ONCE = 64
WINDING_ACCURACY = 1.5
"""Meshes of bodies are closed."""


def score_meshes(
    meshes: Sequence[TriangleMesh], body: Body, body_pose: np.ndarray, *, samples: Samples = FINE,
    device: str = "cpu"
) -> Scores:
    """Score one closed mesh a world, in the base frame, against `body` at `body_pose` (world, 7).

    Raises ValueError for another number of meshes than poses, or a mesh without faces.
    """
    if len(meshes) != len(body_pose):
        raise ValueError(f"meshes: {len(meshes)} for {len(body_pose)} worlds")
    if not all(len(mesh.faces) for mesh in meshes):
        raise ValueError("meshes: one has no faces; nothing that could be scored")
    sample = sample_body(body, surface=samples.surface, inside=samples.inside)
    turn = matrix_of_quaternion(body_pose[:, 3:])
    seen = [replace(mesh, vertices_m=(mesh.vertices_m - pose[:3]) @ matrix)
            for mesh, pose, matrix in zip(meshes, body_pose, turn, strict=True)]
    queried = [mesh_of(mesh.vertices_m, mesh.faces, winding=not mesh.simple) for mesh in seen]
    to_mesh = np.array([mesh_gap(mesh, sample.surface_m) for mesh in queried], float).reshape(
        -1, len(sample.surface_m))
    signed = np.array([
        simple_mesh_distance(query, sample.about_m) if mesh.simple
        else mesh_distance(query, sample.about_m, accuracy=WINDING_ACCURACY)
        for mesh, query in zip(seen, queried, strict=True)]).reshape(-1, len(sample.about_m))
    from fit.implicit.volume import surface_samples  # with it JAX's solvers, for a mesh alone

    count = samples.elements
    elements = np.array([surface_samples(mesh, count) for mesh in seen]).reshape(-1, count, 3)
    to_body = np.concatenate([np.zeros((0, count))] + [
        distance_to_surface(body, elements[first:first + WORLDS_AT_ONCE], device=device)
        for first in range(0, len(seen), WORLDS_AT_ONCE)])
    volume = np.array([mesh.volume_m3 for mesh in seen])
    thick = volume / np.array([mesh.area_m2 for mesh in seen])
    common = np.minimum(sample.common_volume(signed, thick),
                        np.minimum(volume, sample.volume_m3))
    return Scores(
        chamfer_m=0.5 * ((to_mesh * sample.surface_share).sum(1) + to_body.mean(1)),
        square_m2=(to_mesh**2 * sample.surface_share).sum(1) + (to_body**2).mean(1),
        hausdorff95_m=np.maximum(weighted_quantile(to_mesh, sample.surface_share, 0.95),
                                 np.quantile(to_body, 0.95, axis=1)),
        iou=common / (volume + sample.volume_m3 - common),
        volume_ratio=volume / sample.volume_m3,
        coverage=((to_mesh <= COVERAGE_M) * sample.surface_share).sum(1),
    )


def scores_with_meshes(
    scorer: Scorer, meshes: Sequence[TriangleMesh], scores: Scores
) -> Scores:
    """The scores of every world, those with a mesh scored by it; empty meshes leave theirs."""
    parts = []
    for body, rows in scorer.worlds():
        part, mine = rows_of(scores, rows), meshes[rows]
        made = np.flatnonzero([len(mesh.faces) > 0 for mesh in mine])
        if len(made):
            part = with_rows(part, made, score_meshes(
                [mine[int(k)] for k in made], body, scorer.body_pose[rows][made],
                samples=scorer.samples, device=scorer.device))
        parts.append(part)
    return joined(parts)
