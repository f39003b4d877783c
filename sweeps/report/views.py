"""The best, median and worst episode of each strategy, run again for the report's 3-D view."""

import base64
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from strategies.recovery.choose_model import Shape
from sweeps.analysis.entries import values_of
from sweeps.analysis.rerun_episode import OTHERWISE, Episode, WorkerDied, cell_of, rerun_all
from sweeps.episode.episodes import EpisodeBlock
from sweeps.figures.meshes import (
    coarse_mesh,
    mesh_of_world,
    quadrilaterals,
    recovered_grid,
    true_mesh,
)
from sweeps.output import say
from sweeps.report.surfaces import UNSURE_M, surface_sigma
from sweeps.run.grown_units import begun_in
from sweeps.run.plan import Plan
from sweeps.run.store import Store
from sweeps.spec.errors import StoreError
from warpgrasp.geometry.body import Body

PLACES = ("best", "median", "worst")
BY_OBJECT = "median"
"""The place of an object's own episode."""
UNIT_M = 1e-4  # of the whole numbers that stand for coordinates in the page


@dataclass(frozen=True)
class Picked:
    """One episode, and which of its strategy's it is: one of PLACES."""

    place: str
    episode: Episode
    chamfer_mm: float


def pick_episodes(plan: Plan, stores: Sequence[Store]) -> list[Picked]:
    """Each strategy's best, median and worst episode by chamfer distance, over all cells."""
    picked = []
    for strategy, table in enumerate(_episodes(plan, stores)):
        if len(table):
            for place, n in zip(PLACES, (0, (len(table) - 1) // 2, len(table) - 1), strict=True):
                picked.append(_picked(place, strategy, table[n]))
    return picked


def pick_objects(plan: Plan, stores: Sequence[Store]) -> list[Picked]:
    """Of each object the median episode of the strategy whose median is the least there."""
    tables, picked = _episodes(plan, stores), []
    for body in range(len(plan.study.objects)):
        own = [(strategy, table[table[:, 1] == body]) for strategy, table in enumerate(tables)]
        medians = [(*rows[(len(rows) - 1) // 2], strategy) for strategy, rows in own if len(rows)]
        if medians:
            *row, strategy = min(medians)
            picked.append(_picked(BY_OBJECT, int(strategy), np.array(row)))
    return picked


def _picked(place: str, strategy: int, row: np.ndarray) -> Picked:
    chamfer, body, setting, episode = row
    return Picked(place, Episode(strategy, int(body), int(episode), int(setting)), float(chamfer))


def _episodes(plan: Plan, stores: Sequence[Store]) -> list[np.ndarray]:
    """Chamfer distance, object, setting and number of each strategy's episodes, in that order."""
    found: list[list[np.ndarray]] = [[] for _ in plan.study.strategies]
    units = map(begun_in(stores), plan.units())
    for ((strategy, body, setting), _), unit in zip(plan.blocks(), units, strict=True):
        rows = next((rows for store in stores if (rows := store.read(unit)) is not None), None)
        if rows is not None:
            chamfer, same = values_of(rows, "chamfer_mm"), np.ones(len(rows["episode"]))
            found[strategy].append(np.column_stack([
                chamfer, body * same, setting * same, rows["episode"]]))
    tables = []
    for parts in found:
        table = np.concatenate([np.zeros((0, 4)), *parts])
        table = table[np.isfinite(table[:, 0])]
        tables.append(table[np.lexsort(table.T[::-1])])
    return tables


@dataclass(frozen=True)
class Views:
    """The data of the page's 3-D view, ready for JSON, and notes for the reader."""

    bodies: dict[str, Any]
    episodes: list[dict[str, Any]]
    notes: list[str]
    died: bool = False
    """A worker process did, so that episodes are missing."""


def make_views(plan: Plan, picked: Sequence[Picked], device: str = "cpu", workers: int = 1,
               progress: Callable[[str], None] = lambda text: None) -> Views:
    """Runs the picked episodes again; notes name those that cannot be. A worker that dies is an
    error, which is said whatever becomes of `progress`."""
    bodies: dict[str, Any] = {}
    episodes: list[dict[str, Any]] = []
    missing = {pick.episode: _missing(plan, pick.episode) for pick in picked}
    shown = [pick for pick in picked if not missing[pick.episode]]
    differ = 0
    blocks = rerun_all(plan, [pick.episode for pick in shown], device, workers)
    died = ""
    try:
        for number, (pick, block) in enumerate(zip(shown, blocks, strict=True), 1):
            progress(f"episode {number} of {len(shown)} for the 3-D views")
            body = plan.study.objects[pick.episode.body].name
            if body not in bodies:
                bodies[body] = body_data(block.body)
            episodes.append(_view(plan, pick, block))
            differ += float(block.scores.chamfer_m[0] * 1e3) != pick.chamfer_mm
    except WorkerDied as error:
        died = (f"{len(shown) - len(episodes)} of {len(shown)} episodes are missing from the 3-D "
                f"views: {error}")
        say(died)
    notes = [died] if died else []
    notes += [f"no episode of it is shown: {why}" for why in sorted(set(missing.values()) - {""})]
    if differ:
        notes.append(f"{differ} of the episodes shown have other results than in the sweep: "
                     f"{OTHERWISE}")
    return Views(bodies, episodes, notes, bool(died))


def _view(plan: Plan, pick: Picked, block: EpisodeBlock) -> dict[str, Any]:
    """What the page shows of one episode."""
    placed = block.exploration.placed
    return {"place": pick.place, "strategy": plan.study.strategies[pick.episode.strategy].name,
            "object": plan.study.objects[pick.episode.body].name, "episode": pick.episode.episode,
            "chamfer_mm": round(float(block.scores.chamfer_m[0] * 1e3), 3),
            "iou": round(float(block.scores.iou[0]), 4), "status": str(block.status[0]),
            "prior": bool(block.recovered.shape[0] == Shape.PRIOR) and mesh_of_world(block) is None,
            **surface_data(block),
            **episode_data(recovered_grid(block.recovered, rows=16), block.truth.body_pose[0],
                           placed.points_m[0][placed.mask[0]])}


def _missing(plan: Plan, episode: Episode) -> str:
    """Why an episode cannot be run again, or nothing."""
    try:
        cell_of(plan, episode)
    except StoreError as error:
        return str(error)
    return ""


def body_data(body: Body) -> dict[str, Any]:
    """A true body in its own frame, packed."""
    vertices, faces = true_mesh(body, 24)
    return {"points": _packed(vertices), "faces": _encoded(faces.astype("<u2"))}


def episode_data(grid: np.ndarray, pose: np.ndarray, felt: np.ndarray) -> dict[str, Any]:
    """The recovered surface (row, column, 3) and the contacts in the true body's frame, packed."""
    turn = Rotation.from_quat(pose[3:]).inv()
    return {"grid": _packed(turn.apply(grid.reshape(-1, 3) - pose[:3])),
            "rows": grid.shape[0], "columns": grid.shape[1],
            "contacts": _packed(turn.apply(felt - pose[:3]) if len(felt) else felt)}


def surface_data(block: EpisodeBlock) -> dict[str, Any]:
    """How sure the robot is of each face of a block's scored surface, packed, 255 and more where it
    is not; of a free form its mesh too, in the true body's frame. Nothing where only the prior
    stands."""
    pose, mesh = block.truth.body_pose[0], mesh_of_world(block)
    found: dict[str, Any] = {}
    if mesh is None:
        middle = quadrilaterals(recovered_grid(block.recovered, rows=16)).mean(1)
    else:
        mesh = coarse_mesh(mesh)
        middle = mesh.corners_m.mean(1)
        turn = Rotation.from_quat(pose[3:]).inv()
        found = {"surface": _packed(turn.apply(mesh.vertices_m - pose[:3])),
                 "faces": _encoded(mesh.faces[:, [0, 1, 2, 2]].astype("<u2"))}
    sigma = surface_sigma(block, middle)
    if sigma is not None:
        found["unsure"] = _encoded(np.clip(255 * sigma / UNSURE_M, 0, 255).astype("u1"))
    return found


def _packed(points_m: np.ndarray) -> str:
    whole = np.clip(np.round(np.nan_to_num(points_m) / UNIT_M), -32768, 32767)
    return _encoded(whole.astype("<i2"))


def _encoded(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode()
