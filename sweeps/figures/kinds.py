"""`warpgrasp figure`: figures of a study, made from its units."""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sweeps.analysis.entries import check_metric
from sweeps.output import write_atomic
from sweeps.run.plan import Plan
from sweeps.run.store import Store, open_study
from sweeps.spec.errors import StoreError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sweeps.episode.episodes import EpisodeBlock
    from sweeps.spec.cell import Cell


@dataclass(frozen=True)
class Asked:
    """What a figure is to show."""

    plan: Plan
    stores: Sequence[Store]
    metric: str = "chamfer_mm"
    strategy: str | None = None
    object: str | None = None
    episode: int = 0


def _forest(asked: Asked) -> "Figure":
    from sweeps.analysis.paired import read_paired
    from sweeps.figures.forest import draw_forest

    return draw_forest(read_paired(asked.plan, asked.stores, [asked.metric]), asked.metric)


def _curves_touches(asked: Asked) -> "Figure":
    from sweeps.analysis.curves import read_curves
    from sweeps.figures.curves import draw_curves

    return draw_curves(read_curves(asked.plan, asked.stores), "touches")


def _curves_time(asked: Asked) -> "Figure":
    from sweeps.analysis.curves import read_curves
    from sweeps.figures.curves import draw_curves

    return draw_curves(read_curves(asked.plan, asked.stores), "time_s")


def _pareto(asked: Asked) -> "Figure":
    from sweeps.analysis.paired import read_paired
    from sweeps.analysis.pareto import COST
    from sweeps.figures.pareto import draw_pareto

    return draw_pareto(read_paired(asked.plan, asked.stores, [asked.metric, COST]), asked.metric)


def _confusion(asked: Asked) -> "Figure":
    from sweeps.analysis.confusion import read_confusion
    from sweeps.figures.confusion import draw_confusion

    return draw_confusion(read_confusion(asked.plan, asked.stores), asked.strategy)


def _settings(asked: Asked) -> "Figure":
    from sweeps.analysis.settings import read_settings
    from sweeps.figures.settings import draw_settings

    return draw_settings(asked.plan, read_settings(asked.plan, asked.stores, asked.metric),
                         asked.metric)


def _contacts(asked: Asked) -> "Figure":
    from sweeps.figures.contacts import contacts_figure

    cell, block = _played_again(asked)
    return contacts_figure(block, cell.object_name)


def _faces(asked: Asked) -> "Figure":
    from sweeps.figures.faces import faces_figure

    cell, block = _played_again(asked)
    return faces_figure(block, cell.object_name)


def _contour(asked: Asked) -> "Figure":
    from sweeps.figures.contour import contour_figure

    cell, block = _played_again(asked)
    return contour_figure(block, cell.object_name)


def _taxels(asked: Asked) -> "Figure":
    from sweeps.figures.taxels import taxels_figure

    cell, block = _played_again(asked)
    return taxels_figure(block, cell.pads, cell.object_name)


def _grasp(asked: Asked) -> "Figure":
    from sweeps.analysis.rerun_episode import cell_of, choose_episode, in_a_worker
    from sweeps.figures.grasp import grasp_figure
    from sweeps.figures.replay_frames import replay_of

    episode = choose_episode(asked.plan, asked.stores, asked.strategy, asked.object,
                             asked.episode)
    cell = cell_of(asked.plan, episode)
    return grasp_figure(in_a_worker(replay_of, (cell, episode.episode, "cpu")), cell.object_name)


def _played_again(asked: Asked) -> "tuple[Cell, EpisodeBlock]":
    """The one episode that was asked for, run again."""
    from sweeps.analysis.rerun_episode import cell_of, choose_episode, rerun

    episode = choose_episode(asked.plan, asked.stores, asked.strategy, asked.object,
                             asked.episode)
    return cell_of(asked.plan, episode), rerun(asked.plan, episode)


KINDS: dict[str, Callable[[Asked], "Figure"]] = {
    "forest": _forest, "curves-touches": _curves_touches, "curves-time": _curves_time,
    "pareto": _pareto, "confusion": _confusion, "settings": _settings,
    "contacts": _contacts, "faces": _faces, "contour": _contour, "taxels": _taxels,
    "grasp": _grasp,
}


def figure(folders: Sequence[Path], kind: str, out: Path, *, metric: str, strategy: str | None,
           object_: str | None, episode: int) -> int:
    """Draws one figure into a file; its ending names the format."""
    from sweeps.figures.style import encode

    check_metric(metric)
    plan, stores = open_study(folders)
    asked = Asked(plan, stores, metric, strategy, object_, episode)
    content = encode(KINDS[kind](asked), out.suffix.removeprefix("."))
    try:
        write_atomic(out, content)
    except OSError as error:
        raise StoreError(f"{out}: cannot be written: {error.strerror}") from None
    print(out, file=sys.stderr)
    return 0
