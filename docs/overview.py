"""Draws the picture of the README: `make pictures`.

From left to right: the hand on an object, the contacts with the body recovered after one hand
pose, the same after twelve, and the error against touches for three ways to choose the poses.
"""

import io
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image

from strategies.poses.waypoints import Ring
from strategies.ready_made import STRATEGIES
from strategies.strategy import Strategy
from sweeps.episode.episodes import run_block, run_episodes
from sweeps.figures.grasp import hand_solids
from sweeps.figures.replay_frames import Replay, make_replay
from sweeps.figures.solids import CONTACT, direction, lit
from sweeps.figures.style import COLOURS, drawing, encode, figure
from sweeps.output import init_warp
from sweeps.spec.cell import Cell

OBJECT, EPISODE, EARLY = "block", 1, 1
AZIMUTH_DEG, ELEVATION_DEG = -60.0, 14.0
RING = Strategy("twelve around the object", (Ring(count=12),), refit_every=1)
EVEN = replace(STRATEGIES["even"], refit_every=1)
COMPARED = {"ring of twelve": RING, "farthest pose": EVEN,
            "least expected error": STRATEGIES["expected-error"]}
OBJECTS = ("block", "large_cylinder", "wedge", "lightbulb")
EPISODES = np.arange(16)


def draw_body(axes: Any, replay: Replay, estimate: np.ndarray, contacts: int) -> None:
    """The true body in grey, the recovered one as a net over it, contacts so far as dots."""
    foot = np.array([*((replay.body_m.min(0) + replay.body_m.max(0)) / 2)[:2], 0.0])
    faces = 1e3 * (replay.body_m[replay.body_faces] - foot)
    axes.add_collection3d(Poly3DCollection(faces, facecolors=lit(faces, "#e9e4d6"), zorder=1),
                          autolim=False)
    net = 1e3 * (estimate - foot)
    axes.plot_wireframe(*np.moveaxis(net, -1, 0), rstride=2, cstride=2, color="#2166ac", lw=0.45,
                        alpha=0.8, zorder=5)
    axes.scatter(*(1e3 * (replay.contacts_m[:contacts] - foot)).T, s=5, color=CONTACT,
                 depthshade=False, zorder=10)


def draw_hand(axes: Any, replay: Replay) -> None:
    """The hand on the object at the frame with the most fingers in contact."""
    frame = max(replay.frames, key=lambda frame: (float(frame.felt.sum()), frame.contacts))
    foot = np.array([*((replay.body_m.min(0) + replay.body_m.max(0)) / 2)[:2], 0.0])
    light = direction(AZIMUTH_DEG + 35.0, 52.0)
    for faces, tint in [(replay.body_m[replay.body_faces], "#e9e4d6"),
                        *hand_solids(replay, frame)]:
        colours = lit(faces, tint, light)
        axes.add_collection3d(Poly3DCollection(1e3 * (faces - foot), facecolors=colours,
                                               edgecolors=colours, lw=0.2), autolim=False)


def mean_curve(strategy: Strategy) -> tuple[np.ndarray, np.ndarray]:
    """Touches, and the mean chamfer distance [mm] over objects and episodes by then."""
    grid = np.arange(0, 97)
    errors = []
    for name in OBJECTS:
        cell = Cell(strategy, {"name": name}, name, seed=5)
        rows = run_episodes(cell, EPISODES, "cpu")
        for touches, chamfer in zip(rows["curve_touches"], rows["curve_chamfer_mm"], strict=True):
            at = np.searchsorted(touches, grid, side="right") - 1
            errors.append(np.where(at >= 0, np.asarray(chamfer)[np.maximum(at, 0)], np.nan))
    return grid, np.nanmean(errors, axis=0)


def overview() -> bytes:
    """The picture as PNG."""
    cell = Cell(EVEN, {"name": OBJECT}, OBJECT, seed=5)
    replay = make_replay(cell, run_block(cell, np.array([EPISODE]), "cpu"))
    with drawing():
        drawn = figure(2.2, 8.2)
        panels = drawn.add_gridspec(1, 4, width_ratios=(1.25, 1.0, 1.0, 1.25))
        titles = ("a grasp", "body after one grasp pose", "after twelve")
        for number, title in enumerate(titles):
            axes: Any = drawn.add_subplot(panels[0, number], projection="3d")
            axes.set_axis_off()
            axes.view_init(ELEVATION_DEG, AZIMUTH_DEG)
            axes.computed_zorder = False
            half, tall = (105.0, 200.0) if number == 0 else (70.0, 140.0)
            axes.set(xlim=(-half, half), ylim=(-half, half), zlim=(0, tall))
            axes.set_box_aspect((2 * half, 2 * half, tall), zoom=1.5)
            axes.set_title(title, y=-0.18)
            if number == 0:
                draw_hand(axes, replay)
            else:
                step = EARLY - 1 if number == 1 else len(replay.estimates_m) - 1
                shown = [f for f in replay.frames if f.estimate <= step]
                draw_body(axes, replay, replay.estimates_m[step], shown[-1].contacts)
        curve = drawn.add_subplot(panels[0, 3])
        for (name, chosen), colour in zip(COMPARED.items(), COLOURS, strict=False):
            curve.step(*mean_curve(chosen), where="post", color=colour, label=name)
        curve.set(xlabel="touches", ylabel="mean surface error [mm]", ylim=(0, None), xlim=(0, 96))
        curve.set_title("which sequence of poses?")
        curve.legend()
    small = io.BytesIO()
    Image.open(io.BytesIO(encode(drawn, "png"))).convert("RGB").quantize(96).save(
        small, "png", optimize=True)
    return small.getvalue()


if __name__ == "__main__":
    init_warp()
    Path(sys.argv[1]).write_bytes(overview())
