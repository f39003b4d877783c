"""Signed distances against trimesh and dense sampling: values, slopes, bounds, baked grids."""

from collections.abc import Callable
from itertools import pairwise
from math import nan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from sweeps.validate.comparison import Comparison, engine
from warpgrasp.export.convex_solids import object_solids
from warpgrasp.geometry.body import Body, Part, distances_of
from warpgrasp.geometry.scene import Shape
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.objects.catalogue_names import BODY_NAMES
from warpgrasp.objects.mesh_import import body_from_mesh

NEAR_M = 1e-6
SLOPE = 1e-5
GRID_CELLS = 0.25
"""Baked grids err by at most this share of a cell within 10 mm, at the 99th percentile."""
POINTS = 10_000
_STEP_M = 1e-7


def compare_distances() -> list[Comparison]:
    """Analytic bodies, superquadric bounds, baked grids."""
    trimesh = engine("trimesh")
    rows = []
    for name in BODY_NAMES:
        body = body_from_name(name)
        points = _points(body)
        theirs, how = _reference(trimesh, body, points)
        rows.append(_values(name, body, points, theirs, how))
        rows += [_lipschitz(name, body, points), _slopes(name, body, points)]
    for extra in (_capsule(), _ball()):
        points = _points(extra)
        theirs, how = _section(extra, points)
        rows.append(_values(extra.name, extra, points, theirs, how))
        rows.append(_lipschitz(extra.name, extra, points))
    rows += _superquadrics()
    rows += _grids(trimesh)
    return rows


def _points(body: Body, count: int = POINTS, reach: float = 0.03) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.uniform(np.asarray(body.low_m) - reach, np.asarray(body.high_m) + reach, (count, 3))


def _reference(trimesh: Any, body: Body, points: np.ndarray) -> tuple[np.ndarray, str]:
    """Distances by trimesh of polyhedra, by dense sampling of the section of turned bodies."""
    part = body.parts[0]
    if part.shape == Shape.BLOCK:
        box = trimesh.creation.box(part.size_m)
        box.apply_translation([0.0, 0.0, part.size_m[2] / 2])
        return _by_trimesh(trimesh, box, points), "trimesh"
    if part.shape == Shape.WEDGE:
        solid = object_solids(body)[0]
        return _by_trimesh(trimesh, trimesh.Trimesh(solid.vertices, solid.faces), points), "trimesh"
    return _section(body, points)


def _by_trimesh(trimesh: Any, mesh: Any, points: np.ndarray) -> np.ndarray:
    """In millimetres: its tolerances are absolute, and made for larger things."""
    mesh = trimesh.Trimesh(1e3 * mesh.vertices, mesh.faces)
    return -1e-3 * trimesh.proximity.signed_distance(mesh, 1e3 * points)


def _section(body: Body, points: np.ndarray) -> tuple[np.ndarray, str]:
    """Distances to the outline of a turned body, sampled every two micrometres."""
    part = body.parts[0]
    r, _, h = part.size_m
    if part.shape == Shape.CYLINDER:
        corner = np.array([[0.0, 0.0], [r, 0.0], [r, h], [0.0, h]])
    elif part.shape == Shape.REVOLUTION:
        z, rho = part.profile_m.T
        corner = np.array([[0.0, z[0]], *np.stack([rho, z], 1), [0.0, z[-1]]])
    else:  # capsule or ball
        top = h - r if part.shape == Shape.CAPSULE else r
        angle = np.linspace(-np.pi / 2, np.pi / 2, 60_001)
        arc = np.stack([r * np.cos(angle), r * np.sin(angle)], 1)
        corner = np.concatenate([arc[:30_001] + [0.0, r], arc[30_000:] + [0.0, top]])
    outline = [corner[:1]]
    for a, b in pairwise(corner):
        count = max(int(np.ceil(np.linalg.norm(b - a) / 2e-6)), 1)
        outline.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    at = np.stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]], 1)
    away, _ = KDTree(np.concatenate(outline)).query(at)
    return np.where(_inside(corner, at), -away, away), "samples 2 um apart on the outline"


def _inside(corner: np.ndarray, at: np.ndarray) -> np.ndarray:
    from matplotlib.path import Path as Outline

    return Outline(corner).contains_points(at)


def _values(name: str, body: Body, points: np.ndarray, theirs: np.ndarray,
            how: str) -> Comparison:
    ours, _ = distances_of(body)(points)
    return Comparison("distances", f"{name}: largest of {len(points)} points", "m",
                      float(np.abs(ours).mean()), float(np.abs(theirs).mean()),
                      float(np.abs(ours - theirs).max()), NEAR_M, how)


def _lipschitz(name: str, body: Body, points: np.ndarray) -> Comparison:
    """Two points' distances never differ by more than the points do; near and far pairs."""
    rng = np.random.default_rng(1)
    size = 10.0 ** rng.uniform(-6, -1, len(points))
    step = rng.normal(size=points.shape)
    other = points + step / np.linalg.norm(step, axis=1, keepdims=True) * size[:, None]
    a, b = distances_of(body)(points)[0], distances_of(body)(other)[0]
    ratio = (np.abs(a - b) / np.linalg.norm(points - other, axis=1)).max()
    return Comparison("distances", f"{name}: steepest of {len(points)} pairs of points", "m/m",
                      float(ratio), 1.0, max(float(ratio) - 1.0, 0.0), 1e-8, "1-Lipschitz")


def _slopes(name: str, body: Body, points: np.ndarray) -> Comparison:
    """Gradients by central differences, where the distance is smooth over the step."""
    ours = distances_of(body)(points)[1]
    numeric, smooth = _differences(lambda p: distances_of(body)(p)[0], points)
    error = np.abs(ours - numeric).max(1)[smooth]
    return Comparison("distances", f"{name}: gradient, largest of {smooth.sum()} points", "m/m",
                      nan, nan, float(error.max()), SLOPE, "central differences")


def _differences(distance: Callable[[np.ndarray], np.ndarray],
                 points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    numeric, bend = np.zeros_like(points), np.zeros(len(points))
    middle = distance(points)
    for axis in range(3):
        step = np.eye(3)[axis] * _STEP_M
        ahead, behind = distance(points + step), distance(points - step)
        numeric[:, axis] = (ahead - behind) / (2 * _STEP_M)
        bend = np.maximum(bend, np.abs(ahead - 2 * middle + behind))
    return numeric, bend < 1e-5 * _STEP_M + 1e-15


def _superquadrics() -> list[Comparison]:
    """First-order distances: never more than the true one outside; how much less at a link."""
    rows = []
    for exponents in ((1.0, 1.0), (0.3, 1.0), (0.1, 0.1)):
        body = body_from_table({"name": "superquadric", "superquadric": {
            "size_mm": [25, 35, 50], "exponents": list(exponents)}}, Path())
        points = _points(body)
        true = _dense(body, points)
        ours, _ = distances_of(body)(points)
        outside = ours > 0.0
        over = np.maximum((ours - true)[outside], 0.0).max()
        near = outside & (np.abs(true - 0.008) < 0.001)
        label = f"superquadric bound, exponents {exponents[0]:g} {exponents[1]:g}"
        rows.append(Comparison("distances", f"{label}: more than the true distance", "m",
                               float(ours[outside].mean()), float(true[outside].mean()),
                               float(over), 1e-4, "dense samples err by up to 0.1 mm"))
        rows.append(Comparison("distances", f"{label}: short of it, 8 mm off, median", "m",
                               float(ours[near].mean()), float(true[near].mean()),
                               float(np.median(true[near] - ours[near]))))
    return rows


def _dense(body: Body, points: np.ndarray) -> np.ndarray:
    """Unsigned distances to a million points of a superquadric's surface."""
    a1, a2, a3, e1, e2 = body.parts[0].superquadric[:5]
    lift = body.parts[0].place[2]
    rng = np.random.default_rng(3)
    way = rng.normal(size=(1_000_000, 3))
    way /= np.abs(way).max(1, keepdims=True)
    u, v, w = np.abs(way.T)
    gauge = ((u ** (2 / e2) + v ** (2 / e2)) ** (e2 / e1) + w ** (2 / e1)) ** (e1 / 2)
    surface = way / gauge[:, None] * [a1, a2, a3] + [0.0, 0.0, lift]
    return KDTree(surface).query(points)[0]


def _grids(trimesh: Any) -> list[Comparison]:
    """Meshes of analytic bodies, read, baked to a grid, and compared with the formula."""
    rows = []
    for name in ("block", "large_cylinder", "wine_bottle"):
        body = body_from_name(name)
        with TemporaryDirectory() as folder:
            file = Path(folder) / f"{name}.ply"
            file.write_bytes(bytes(_mesh(trimesh, body).export(file_type="ply")))
            baked = body_from_mesh(file, units="m")
        cell = baked.parts[0].grid_cell_m
        points = _points(body, reach=0.012)
        exact, _ = distances_of(body)(points)
        near = np.abs(exact) < 0.010
        ours, slope = distances_of(baked)(points[near])
        error = np.abs(ours - exact[near]) / cell
        rows.append(Comparison("distances", f"{name}, baked: within 10 mm, p99", "cells",
                               float(np.abs(ours).mean() / cell),
                               float(np.abs(exact[near]).mean() / cell),
                               float(np.quantile(error, 0.99)), GRID_CELLS,
                               f"cell {1e3 * cell:.2f} mm; largest {error.max():.2g} cells"))
        numeric, smooth = _differences(lambda p, b=baked: distances_of(b)(p)[0], points[near])
        rows.append(Comparison("distances", f"{name}, baked: gradient of the interpolant", "m/m",
                               nan, nan, float(np.abs(slope - numeric).max(1)[smooth].max()),
                               SLOPE, "central differences"))
        true = distances_of(body)(points[near])[1]
        off = np.degrees(np.arccos(np.clip(
            (slope * true).sum(1) / np.linalg.norm(slope, axis=1), -1, 1)))
        rows.append(Comparison("distances", f"{name}, baked: direction of the gradient, p95",
                               "deg", nan, nan, float(np.quantile(off, 0.95))))
    return rows


def _mesh(trimesh: Any, body: Body) -> Any:
    part = body.parts[0]
    if part.shape == Shape.BLOCK:
        return trimesh.creation.box(part.size_m)
    if part.shape == Shape.CYLINDER:
        return trimesh.creation.cylinder(part.size_m[0], part.size_m[2], sections=720)
    z, rho = part.profile_m.T
    outline = np.array([[0.0, z[0]], *np.stack([rho, z], 1), [0.0, z[-1]]])
    return trimesh.creation.revolve(outline, sections=720)


def _capsule() -> Body:
    return body_from_table({"name": "capsule", "compound": [
        {"shape": "capsule", "radius_mm": 25, "height_mm": 110}]}, Path())


def _ball() -> Body:
    return Body("sphere", (Part(Shape.SPHERE, size_m=(0.03, 0.0, 0.0)),), (-0.03, -0.03, 0.0),
                (0.03, 0.03, 0.06))
