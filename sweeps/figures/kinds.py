"""`warpgrasp figure`: figures of a study, made from its units."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import sweeps.figures
from sweeps.analysis.confusion import read_confusion
from sweeps.analysis.curves import ERROR, once_notes, read_curves
from sweeps.analysis.entries import check_metric
from sweeps.analysis.paired import read_paired
from sweeps.analysis.pareto import columns_of
from sweeps.analysis.rerun_episode import (
    Episode,
    cell_of,
    choose_episode,
    ended_otherwise,
    in_a_worker,
    rerun,
)
from sweeps.analysis.settings import read_settings
from sweeps.figures.curves import draw_curves, draw_levels
from sweeps.figures.forest import draw_forest
from sweeps.figures.heat_maps import draw_confusion, draw_settings
from sweeps.figures.pareto import draw_pareto
from sweeps.figures.style import encode
from sweeps.output import note
from sweeps.result_file import check_result, write_result
from sweeps.run.plan import Plan
from sweeps.run.race_record import open_sweep
from sweeps.run.store import Store, open_study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sweeps.episode.episodes import EpisodeBlock
    from sweeps.spec.cell import Cell


@dataclass(frozen=True)
class Asked:
    """The study, and the options of the command."""

    plan: Plan
    stores: Sequence[Store]
    metric: str = "chamfer_mm"
    strategy: str | None = None
    object: str | None = None
    episode: int = 0
    over: str | None = None


def _curves(asked: Asked, axis: str) -> "Figure":
    curves = read_curves(asked.plan, asked.stores, asked.over)
    for line in once_notes(curves):
        note(line)
    return draw_curves(curves, axis)


def _of_episode(name: str) -> Callable[[Asked], "Figure"]:
    """Draws the chosen episode by a function of this room."""
    def draw(asked: Asked) -> "Figure":
        cell, block = _rerun(asked)
        return getattr(sweeps.figures, name)(block, cell.object_name)

    return draw


def _taxels(asked: Asked) -> "Figure":
    from sweeps.figures.taxels import taxels_figure

    cell, block = _rerun(asked)
    return taxels_figure(block, cell.pads, cell.object_name)


def _grasp(asked: Asked) -> "Figure":
    from sweeps.figures.grasp import grasp_figure
    from sweeps.figures.replay_frames import replay_of

    chosen = _chosen(asked)
    cell = cell_of(asked.plan, chosen)
    replay = in_a_worker(replay_of, (cell, chosen.episode, "cpu"))
    return grasp_figure(replay, cell.object_name)


def _chosen(asked: Asked) -> Episode:
    return choose_episode(asked.plan, asked.stores, asked.strategy, asked.object, asked.episode)


def _rerun(asked: Asked) -> "tuple[Cell, EpisodeBlock]":
    chosen = _chosen(asked)
    cell, block = cell_of(asked.plan, chosen), rerun(asked.plan, chosen)
    if line := ended_otherwise(asked.plan, asked.stores, chosen, str(block.status[0])):
        note(line)
    return cell, block


# Figures of episodes are attributes of the room, which imports them and the simulator when used.
KINDS: dict[str, Callable[[Asked], "Figure"]] = {
    "forest": lambda a: draw_forest(read_paired(a.plan, a.stores, [a.metric]), a.metric),
    "curves-touches": lambda a: _curves(a, "touches"),
    "curves-time": lambda a: _curves(a, "time_s"),
    "pareto": lambda a: draw_pareto(
        read_paired(a.plan, a.stores, [*columns_of(a.metric), ERROR], over=a.over), a.metric),
    "confusion": lambda a: draw_confusion(read_confusion(a.plan, a.stores), a.strategy),
    "settings": lambda a: draw_settings(
        a.plan, read_settings(a.plan, a.stores, a.metric, a.over), a.metric),
    "levels": lambda a: draw_levels(
        a.plan, read_settings(a.plan, a.stores, a.metric, a.over), a.metric),
    "contacts": _of_episode("contacts_figure"), "faces": _of_episode("faces_figure"),
    "contour": _of_episode("contour_figure"), "taxels": _taxels, "grasp": _grasp,
}


OF_EPISODE = ("contacts", "faces", "contour", "taxels", "grasp")
"""Kinds that compare nothing: a race has such episodes, too."""


def contacts_of_episode(asked: Asked) -> bytes:
    """The guarded moves of the chosen episode, run again, as `explore` writes them; a CSV file.

    A line on stderr says how the episode ended and where the object truly stands.
    """
    from sweeps.episode.contact_rows import contacts_csv
    from sweeps.episode.episodes import episode_notes

    cell, block = _rerun(asked)
    x, y, _, _, _, sine, cosine = block.truth.body_pose[0]
    said = episode_notes(block, cell, np.zeros(1, int))[0]
    note(f"{block.status[0]}{': ' * bool(said)}{said}; {cell.object_name} truly stands at "
         f"x_m {x:.4g}, y_m {y:.4g}, yaw_rad {2.0 * np.arctan2(sine, cosine):.4g}")
    return contacts_csv(block.exploration, block.truth).encode()


def figure(folders: Sequence[Path], kind: str, out: Path, *, metric: str, strategy: str | None,
           object_: str | None, episode: int, over: str | None = None) -> int:
    """Draws one figure into a file, whose ending names the format; contacts as numbers where that
    is .csv."""
    check_metric(metric)
    check_result(out)
    plan, stores = (open_study if kind in OF_EPISODE else open_sweep)(folders)
    asked = Asked(plan, stores, metric, strategy, object_, episode, over)
    if kind == "contacts" and out.suffix.lower() == ".csv":
        content = contacts_of_episode(asked)
    else:
        content = encode(KINDS[kind](asked), out.suffix.removeprefix("."))
    write_result(out, content)
    print(out)
    return 0
