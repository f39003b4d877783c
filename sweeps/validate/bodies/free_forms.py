"""Free forms recovered from true contacts, beside the bodies that were touched."""

from math import nan
from pathlib import Path

import numpy as np

from fit.implicit.known import KnownProcess, fit_known
from fit.implicit.mesh import implicit_meshes
from fit.implicit.query import implicit_distance
from fit.implicit.record import ImplicitFit
from fit.implicit.volume import NORMAL_90
from strategies.recovery.free_contacts import BODY
from sweeps.episode.mesh_scores import score_meshes
from sweeps.validate.comparison import Comparison
from warpgrasp.geometry.body import Body, distance_to_bodies, scene_of
from warpgrasp.geometry.body_sampling import sample_body
from warpgrasp.objects.catalogue import body_from_name, body_from_table
from warpgrasp.objects.families import family_table

SHAPES = ("mug-1", "bowl-1", "hammer-1", "pliers-1", "bottle-1", "box-1", "toy-1",
          "block", "wedge", "funnel", "lightbulb", "wine_bottle")
TOUCHES, SETS = 96, 4
SIGMA_M, TILT_DEG = 0.001, 10.0
"""Deviation of a touch in each coordinate, and of its normal."""
MOST_M = 0.003
HELD, WITHIN = 0.9, 0.05
"""Share of surface points that 90 % bands should hold, all shapes together."""
_SURFACE, _BAND = 4096, 512


def compare_free_forms() -> list[Comparison]:
    """Chamfer distance and 90 % bands of free forms of 96 touches spread evenly over each shape,
    with 1 mm of noise and normals that are 10 degrees off."""
    rows, held = [], []
    for name in SHAPES:
        body = shape(name)
        fits = fitted_to(*touches(body, np.random.default_rng(len(rows))))
        away, iou = _scores(fits, body)
        rows.append(Comparison(
            "free_forms", f"{name}: chamfer distance, median of {SETS} sets", "m", nan, nan,
            float(np.median(away)), MOST_M, f"IoU {np.median(iou):.2f}"))
        held.append(_held(fits, body))
    share = float(np.mean(held))
    least = int(np.argmin(held))
    rows.append(Comparison(
        "free_forms", "surface points within 90 % bands, all shapes", "share", share, HELD,
        abs(share - HELD), WITHIN, f"from {held[least]:.2f} ({SHAPES[least]}) to {max(held):.2f}"))
    return rows


def shape(name: str) -> Body:
    """A shape of `SHAPES`: of the catalogue, or a member of a family."""
    table = family_table(name)
    return body_from_name(name) if table is None else body_from_table(table, Path())


def touches(body: Body, draw: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Touches [m] and outward unit normals, (set, touch, 3)."""
    surface = sample_body(body, surface=_SURFACE, inside=64).surface_m
    points = np.stack([surface[_spread(surface, draw)] for _ in range(SETS)])
    normals = distance_to_bodies(scene_of([body], "cpu"), np.zeros(1, int), points)[1]
    normals = _unit(normals) + np.tan(np.radians(TILT_DEG)) / np.sqrt(2) * draw.normal(
        size=points.shape)
    return points + SIGMA_M * draw.normal(size=points.shape), _unit(normals)


def fitted_to(points_m: np.ndarray, normals: np.ndarray, process: KnownProcess = BODY
              ) -> ImplicitFit:
    """Free forms of touches (set, touch, 3) on a table at 0."""
    mask = np.ones(points_m.shape[:2], bool)
    return fit_known(points_m, mask, normals, np.full(mask.shape, SIGMA_M), process, table_z=0.0)


def _scores(fits: ImplicitFit, body: Body) -> tuple[np.ndarray, np.ndarray]:
    """Chamfer distances [m] and IoU, (set,); infinity and 0 where there is no surface."""
    away, iou = np.full(SETS, np.inf), np.zeros(SETS)
    for row, mesh in enumerate(implicit_meshes(fits, BODY.mean)):
        if len(mesh.faces):
            scores = score_meshes([mesh], body, np.eye(7)[[6]])
            away[row], iou[row] = scores.chamfer_m[0], scores.iou[0]
    return away, iou


def _spread(surface_m: np.ndarray, draw: np.random.Generator) -> np.ndarray:
    """Numbers of `TOUCHES` points, each the farthest from those before it."""
    chosen = [int(draw.integers(len(surface_m)))]
    away = np.full(len(surface_m), np.inf)
    while len(chosen) < TOUCHES:
        away = np.minimum(away, np.linalg.norm(surface_m - surface_m[chosen[-1]], axis=1))
        chosen.append(int(away.argmax()))
    return np.array(chosen)


def _held(fits: ImplicitFit, body: Body) -> float:
    """Share of surface points where the distance is 0 within 90 % bands."""
    surface = sample_body(body, surface=_BAND, inside=64).surface_m
    values = implicit_distance(fits, np.tile(surface, (SETS, 1, 1)), BODY.mean)
    return float((np.abs(values.distance_m) < NORMAL_90 * values.std_m).mean())


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
