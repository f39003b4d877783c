"""Chamfer, Hausdorff and IoU against dense meshes of both bodies, on nine objects.

The surfaces are triangles of a few square millimetres; distances go from their middles to the other
mesh, so that means are nearly exact. What the scores of a sweep lose beside that is that they come
from some hundred points of each surface and two thousand inside.
"""

import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from fit.revolution.geometry import RevolutionBody, revolution_inside
from fit.superquadric.geometry import Superquadric, superquadric_inside_outside
from strategies.recovery.choose_model import Recovered, Shape
from sweeps.episode.scores import score_recovered
from sweeps.figures.meshes import quadrilaterals, revolution_grid, surface_mesh
from sweeps.validate.comparison import Comparison, engine
from sweeps.validate.scan_meshes import scan_meshes
from warpgrasp.export.convex_solids import object_solids
from warpgrasp.geometry.body import Body
from warpgrasp.geometry.scene import Shape as Primitive
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.objects.mesh_import import body_from_mesh, mesh_triangles
from warpgrasp.objects.mesh_orientation import mesh_distance, mesh_of

BODIES_EACH = 16
EDGE_M = 0.003
VASE = "z_mm,r_mm\n0,30\n10,38\n50,45\n90,30\n120,18\n140,24\n150,30\n"
INSIDE = 60_000
SHARE, CHAMFER_MM, HAUSDORFF_SHARE, HAUSDORFF_MM, IOU, VOLUME = 0.03, 0.03, 0.10, 0.5, 0.03, 0.015
"""A chamfer distance is within 3 % or 0.03 mm, a Hausdorff distance within 10 % or 0.5 mm."""


def compare_metrics(bodies_each: int = BODIES_EACH) -> list[Comparison]:
    """Scores of superquadrics, and of contours about round objects, from near to far off."""
    trimesh = engine("trimesh")
    rows = []
    for number, (name, body, true) in enumerate(true_bodies(trimesh)):
        ours, theirs = [], []
        for recovered in recovered_bodies(body, bodies_each, number):
            pose = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(recovered), 1))
            scores = score_recovered(recovered, body, pose)
            ours += list(zip(1e3 * scores.chamfer_m, 1e3 * scores.hausdorff95_m, scores.iou,
                             scores.volume_ratio, strict=True))
            theirs += [_scores(trimesh, true, recovered, k) for k in range(len(recovered))]
        rows += list(_comparisons(name, np.array(ours), np.array(theirs)))
    return rows


def _comparisons(name: str, a: np.ndarray, b: np.ndarray) -> Iterator[Comparison]:
    """The largest differences, a distance's as a share of what is allowed."""
    apart = np.abs(a - b)
    what = f"{name}, {{}} of {len(a)} bodies (means left)"
    for k, (score, share, least) in enumerate((
            ("chamfer", SHARE, CHAMFER_MM), ("hausdorff95", HAUSDORFF_SHARE, HAUSDORFF_MM))):
        within = np.maximum(share * b[:, k], least)
        worst = int((apart[:, k] / within).argmax())
        tight = np.maximum(0.01 * b[:, k], 0.01)
        note = f"{(apart[:, k] <= tight).mean():.0%} within 1 % or 0.01 mm"
        yield Comparison("metrics", what.format(score), "mm", float(a[:, k].mean()),
                         float(b[:, k].mean()), float(apart[worst, k]), float(within[worst]), note)
    for k, score, bound in ((2, "iou", IOU), (3, "volume ratio", VOLUME)):
        yield Comparison("metrics", what.format(score), "", float(a[:, k].mean()),
                         float(b[:, k].mean()), float(apart[:, k].max()), bound)


def true_bodies(trimesh: Any) -> Iterator[tuple[str, Body, Any]]:
    """Nine objects, each with a mesh of its own that no distance of ours made."""
    for name in ("block", "funnel", "wine_bottle", "wedge"):
        body = body_from_name(name)
        yield name, body, _mesh_of_body(trimesh, body)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "vase.csv").write_text(VASE)
        vase = body_from_table({"name": "vase", "profile": "vase.csv"}, Path(folder))
        yield "vase", vase, _mesh_of_body(trimesh, vase)
        for name, mesh in scan_meshes().items():
            file = Path(folder) / f"{name}.ply"
            mesh.export(file)
            vertices, faces = mesh_triangles(file, units="m")
            yield name, body_from_mesh(file, units="m"), trimesh.Trimesh(
                vertices, faces, process=False)


def recovered_bodies(body: Body, count: int, seed: int) -> Iterator[Recovered]:
    """Half of them within a millimetre or so where the model can be; of round objects contours."""
    for near, scale in ((True, 0.1), (False, 1.0)):
        rng = np.random.default_rng([seed, near])
        fits = _near(body, count // 2, rng, scale)
        if near and body.parts[0].shape == Primitive.BLOCK:
            fits = fits._replace(exponents=rng.uniform(0.05, 0.2, (count // 2, 2)))
        turned = None
        if body.parts[0].shape == Primitive.REVOLUTION:
            turned = _revolved(body.parts[0].profile_m, count // 2, rng, scale)
        shape = Shape.SUPERQUADRIC if turned is None else Shape.REVOLUTION
        yield Recovered(np.full(count // 2, shape), fits, turned)


def _revolved(profile: np.ndarray, count: int, rng: np.random.Generator,
              scale: float) -> RevolutionBody:
    """Contours about a profile, wrong by some millimetres and degrees times `scale`."""
    z = np.linspace(0.0, profile[-1, 0], 24)
    radius = np.interp(z, *profile.T) * (1.0 + scale * rng.normal(0.0, 0.03, (count, 1)))
    axis = np.concatenate([rng.normal(0.0, 0.02 * scale, (count, 2)), np.ones((count, 1))], 1)
    return RevolutionBody(
        np.concatenate([rng.normal(0.0, 0.003 * scale, (count, 2)), np.zeros((count, 1))], 1),
        axis / np.linalg.norm(axis, axis=1, keepdims=True), np.tile(z, (count, 1)),
        np.maximum(radius + scale * rng.normal(0.0, 0.001, radius.shape), 0.001))


def _near(body: Body, count: int, rng: np.random.Generator, scale: float) -> Superquadric:
    """Superquadrics about the size of a body, wrong by some millimetres and degrees."""
    low, high = np.asarray(body.low_m), np.asarray(body.high_m)
    half = (high - low) / 2
    turn = Rotation.from_rotvec(rng.normal(0.0, 0.08 * scale, (count, 3)))
    return Superquadric(
        size_m=half * (1.0 + scale * rng.uniform(-0.15, 0.1, (count, 3))),
        exponents=rng.uniform(0.2, 1.2, (count, 2)),
        position_m=(low + high) / 2 + rng.normal(0.0, 0.003 * scale, (count, 3)),
        quaternion_xyzw=turn.as_quat(), taper=scale * rng.uniform(-0.3, 0.3, (count, 2)),
        bend=np.zeros((count, 2)))


def _mesh_of(trimesh: Any, recovered: Recovered, k: int) -> Any:
    quads = quadrilaterals(revolution_grid(recovered.revolution, k, 192)) if (
        recovered.revolution is not None) else surface_mesh(
        Superquadric(*(f[k:k + 1] for f in recovered.superquadric)), rows=96)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    mesh = trimesh.Trimesh(**trimesh.triangles.to_kwargs(triangles))
    mesh.merge_vertices(digits_vertex=7)
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.fix_normals()
    return mesh


def _mesh_of_body(trimesh: Any, body: Any) -> Any:
    part = body.parts[0]
    if part.shape == Primitive.BLOCK:
        mesh = trimesh.creation.box(part.size_m)
        mesh.apply_translation([0.0, 0.0, part.size_m[2] / 2])
        return mesh
    if part.shape == Primitive.CYLINDER:
        mesh = trimesh.creation.cylinder(part.size_m[0], part.size_m[2], sections=360)
        mesh.apply_translation([0.0, 0.0, part.size_m[2] / 2])
        return mesh
    if part.shape == Primitive.WEDGE:
        solid = object_solids(body)[0]
        return trimesh.Trimesh(solid.vertices, solid.faces)
    z, rho = part.profile_m.T
    outline = np.array([[0.0, z[0]], *np.stack([rho, z], 1), [0.0, z[-1]]])
    return trimesh.creation.revolve(outline, sections=360)


def _scores(trimesh: Any, true: Any, recovered: Recovered, k: int) -> list[float]:
    """The four scores, by the middles of small triangles, weighed by area, and points inside."""
    fit = _mesh_of(trimesh, recovered, k)
    (on_true, of_true), (on_fit, of_fit) = _middles(trimesh, true), _middles(trimesh, fit)
    there = np.abs(mesh_distance(mesh_of(fit.vertices, fit.faces), on_true))
    back = np.abs(mesh_distance(mesh_of(true.vertices, true.faces), on_fit))
    box, in_true = _inside(true.vertices.tobytes(), true.faces.tobytes())
    in_fit = (revolution_inside(recovered.revolution[k], box[None])[0]
              if recovered.revolution is not None else superquadric_inside_outside(
                  Superquadric(*(f[k:k + 1] for f in recovered.superquadric)), box[None])[0] < 1.0)
    common = (in_true & in_fit).mean() * np.prod(np.ptp(true.bounds, axis=0))
    return [1e3 * 0.5 * float(there @ of_true + back @ of_fit),
            1e3 * max(_quantile(there, of_true), _quantile(back, of_fit)),
            float(common / (fit.volume + true.volume - common)), float(fit.volume / true.volume)]


@cache
def _inside(vertices: bytes, faces: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Points of a mesh's bounding box, and which lie inside."""
    corners = np.frombuffer(vertices).reshape(-1, 3)
    box = np.random.default_rng(3).uniform(corners.min(0), corners.max(0), (INSIDE, 3))
    return box, mesh_distance(mesh_of(corners, np.frombuffer(faces, np.int64).reshape(-1, 3)),
                              box) < 0.0


def _middles(trimesh: Any, mesh: Any) -> tuple[np.ndarray, np.ndarray]:
    """Middles of triangles no longer than `EDGE_M`, and their shares of the area."""
    vertices, faces = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, EDGE_M,
                                                       max_iter=20)
    corner = vertices[faces]
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]),
                          axis=1)
    return corner.mean(1), area / area.sum()


def _quantile(values: np.ndarray, share: np.ndarray) -> float:
    order = np.argsort(values)
    return float(values[order][np.searchsorted(np.cumsum(share[order]), 0.95)])
