"""Chamfer, Hausdorff and IoU against KD-trees and containment tests on meshes of both bodies."""

from typing import Any

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from fit.superquadric.geometry import Superquadric
from sweeps.episode.scores import score_superquadrics
from sweeps.figures.meshes import surface_mesh
from sweeps.validate.comparison import Comparison, engine
from warpgrasp.export.convex_solids import object_solids
from warpgrasp.geometry.scene import Shape
from warpgrasp.objects.catalogue import body_from_name

OBJECTS = ("block", "small_cylinder", "wedge", "lightbulb")
POINTS = 60_000
CHAMFER_MM, HAUSDORFF_MM, IOU = 0.15, 0.5, 0.015
"""Scores come from some hundred points of each surface; these bound what that costs."""


def compare_metrics(recovered_each: int = 3) -> list[Comparison]:
    """Scores of superquadrics about right, shifted, tapered and turned, on four objects."""
    trimesh = engine("trimesh")
    names = ("chamfer", "hausdorff95", "iou", "volume ratio")
    ours, theirs = [], []
    for number, name in enumerate(OBJECTS):
        body = body_from_name(name)
        fits = _near(body, recovered_each, number)
        pose = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (recovered_each, 1))
        scores = score_superquadrics(fits, body, pose)
        true = _mesh_of_body(trimesh, body)
        for k in range(recovered_each):
            ours.append([1e3 * scores.chamfer_m[k], 1e3 * scores.hausdorff95_m[k], scores.iou[k],
                         scores.volume_ratio[k]])
            theirs.append(_scores(trimesh, true, _mesh_of_fit(trimesh, fits, k)))
    a, b = np.array(ours), np.array(theirs)
    rows = []
    for k, (name, unit, bound) in enumerate(zip(
            names, ("mm", "mm", "", ""), (CHAMFER_MM, HAUSDORFF_MM, IOU, IOU), strict=True)):
        what = f"{name}, largest of {len(a)} pairs of bodies (means left)"
        rows.append(Comparison("metrics", what, unit, float(a[:, k].mean()), float(b[:, k].mean()),
                               float(np.abs(a[:, k] - b[:, k]).max()), bound))
    return rows


def _near(body: Any, count: int, seed: int) -> Superquadric:
    """Superquadrics about the size of a body, wrong by some millimetres and degrees."""
    rng = np.random.default_rng(seed)
    low, high = np.asarray(body.low_m), np.asarray(body.high_m)
    half = (high - low) / 2
    turn = Rotation.from_rotvec(rng.normal(0.0, 0.08, (count, 3)))
    return Superquadric(
        size_m=half * rng.uniform(0.85, 1.1, (count, 3)),
        exponents=rng.uniform(0.2, 1.2, (count, 2)),
        position_m=(low + high) / 2 + rng.normal(0.0, 0.003, (count, 3)),
        quaternion_xyzw=turn.as_quat(), taper=rng.uniform(-0.3, 0.3, (count, 2)),
        bend=np.zeros((count, 2)))


def _mesh_of_fit(trimesh: Any, fits: Superquadric, k: int) -> Any:
    quads = surface_mesh(Superquadric(*(f[k:k + 1] for f in fits)), rows=96)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    mesh = trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles))
    mesh.merge_vertices(digits_vertex=7)
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.fix_normals()
    return mesh


def _mesh_of_body(trimesh: Any, body: Any) -> Any:
    part = body.parts[0]
    if part.shape == Shape.BLOCK:
        mesh = trimesh.creation.box(part.size_m)
        mesh.apply_translation([0.0, 0.0, part.size_m[2] / 2])
        return mesh
    if part.shape == Shape.CYLINDER:
        mesh = trimesh.creation.cylinder(part.size_m[0], part.size_m[2], sections=360)
        mesh.apply_translation([0.0, 0.0, part.size_m[2] / 2])
        return mesh
    if part.shape == Shape.WEDGE:
        solid = object_solids(body)[0]
        return trimesh.Trimesh(solid.vertices, solid.faces)
    z, rho = part.profile_m.T
    outline = np.array([[0.0, z[0]], *np.stack([rho, z], 1), [0.0, z[-1]]])
    return trimesh.creation.revolve(outline, sections=360)


def _scores(trimesh: Any, true: Any, fit: Any) -> list[float]:
    """The four scores, by samples on both meshes, KD-trees and containment."""
    on_true, _ = trimesh.sample.sample_surface(true, POINTS, seed=1)
    on_fit, _ = trimesh.sample.sample_surface(fit, POINTS, seed=2)
    to_fit, to_true = KDTree(on_fit).query(on_true)[0], KDTree(on_true).query(on_fit)[0]
    low = np.minimum(true.bounds[0], fit.bounds[0])
    high = np.maximum(true.bounds[1], fit.bounds[1])
    points = np.random.default_rng(3).uniform(low, high, (POINTS, 3))
    in_true, in_fit = true.contains(points), fit.contains(points)
    return [1e3 * 0.5 * (to_fit.mean() + to_true.mean()),
            1e3 * max(np.quantile(to_fit, 0.95), np.quantile(to_true, 0.95)),
            float((in_true & in_fit).sum() / (in_true | in_fit).sum()),
            float(fit.volume / true.volume)]
