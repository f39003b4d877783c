"""A figure of contacts over the recovered body, after figure 4 of Allen and Michelman (1990).

Left the recovered body with the contacts on its near side; right its outline and the true one, seen
from the front and from above. Contacts that do not count as the body's are hollow.

What is shown is made of arrays alone, and only `contacts_shown` imports the simulator: a process
that draws does without it.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sweeps.figures.solids import (
    CONTACT,
    FIT,
    TRUE,
    direction,
    draw_outline,
    draw_solid,
    set_box,
    visible,
)
from sweeps.figures.style import drawing, encode, figure, titled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sweeps.episode.episodes import EpisodeBlock
ELEVATION_DEG, AZIMUTH_DEG = 22.0, -55.0


@dataclass(frozen=True)
class ContactsShown:
    """What the figure shows, in mm from the object's place on the table."""

    name: str
    body: str
    """What the recovered body is."""
    prior: bool
    """Whether nothing was recovered."""
    faces: np.ndarray
    """Of the recovered body, (face, 3 or 4, 3)."""
    true: np.ndarray
    """Of the true one, (face, corner, 3)."""
    points: np.ndarray
    """Contacts as placed on the body that stands, (contact, 3)."""
    near: np.ndarray
    """Those that count as the body's, (contact,)."""


def contacts_shown(block: "EpisodeBlock", name: str, world: int = 0) -> ContactsShown:
    """What the figure of one world of a block shows."""
    from strategies.recovery.choose_model import Shape
    from strategies.recovery.contact_verdict import ACCEPTED
    from sweeps.figures.meshes import mesh_of_world, recovered_faces, turned_mesh

    pose = block.truth.body_pose[world]
    free_form = mesh_of_world(block, world) is not None
    prior = bool(block.recovered.shape[world] == Shape.PRIOR) and not free_form
    placed = block.exploration.placed
    mine = placed.mask[world]
    near = np.asarray(block.exploration.verdicts[world] == ACCEPTED)[mine]
    near |= prior  # nothing was recovered that contacts could contradict
    vertices, sides = turned_mesh(block.body, pose, 48)
    return ContactsShown(
        name, "given prior" if prior else "recovered surface" if free_form
        else "recovered body", prior, 1e3 * (recovered_faces(block, world) - pose[:3]),
        (1e3 * vertices)[sides], 1e3 * (placed.points_m[world][mine] - pose[:3]), near)


def draw_contacts(shown: ContactsShown) -> bytes:
    """A PNG, a page wide; the same contacts give the same bytes."""
    return encode(_drawn(shown, wide=True), "png")


def contacts_figure(block: "EpisodeBlock", name: str, world: int = 0,
                    wide: bool = False) -> "Figure":
    """One world of a block: a page wide, or one column with the hulls below the body."""
    return _drawn(contacts_shown(block, name, world), wide)


@drawing()
def _drawn(shown: ContactsShown, wide: bool) -> "Figure":
    from matplotlib.ticker import FixedLocator, MaxNLocator

    faces, true, points, near = shown.faces, shown.true, shown.points, shown.near
    corners, around = faces.reshape(-1, 3), true.reshape(-1, 3)
    if wide:
        drawn = figure(3.5, 6.85)
        grid = drawn.add_gridspec(2, 2, width_ratios=(1.35, 1.0))
        places = (grid[:, 0], grid[0, 1], grid[1, 1])
    else:
        drawn = figure(5.0)
        grid = drawn.add_gridspec(2, 2, height_ratios=(1.5, 1.0))
        places = (grid[0, :], grid[1, 0], grid[1, 1])
    axes = drawn.add_subplot(places[0], projection="3d")
    eye = direction(AZIMUTH_DEG, ELEVATION_DEG)
    draw_solid(axes, faces, eye)
    seen = visible(points, faces, eye) & near
    axes.scatter(*points[seen].T, s=14, color=CONTACT, depthshade=False, zorder=10,
                 label="contacts in sight")
    low = np.minimum(around.min(0), corners.min(0))
    high = np.maximum(around.max(0), corners.max(0))
    across = (high - low)[:2].max()
    # The wall and the floor leave room for their numbers, also behind a plate and under a bottle.
    tall = max(1.08 * high[2], 0.5 * across)
    middle, half = (low + high) / 2, max(0.65 * across, 0.38 * tall)
    set_box(axes, np.array([*(middle[:2] - half), 0.0]), np.array([*(middle[:2] + half), tall]),
            0.9 if wide else 0.78, (3, 3, 5))
    axes.zaxis.labelpad = 6.0
    axes.view_init(ELEVATION_DEG, AZIMUTH_DEG)
    axes.computed_zorder = False
    axes.set_title(titled(shown.name, f"{shown.body} and contacts"))

    for row, (i, j) in enumerate(((0, 2), (0, 1))):
        flat = drawn.add_subplot(places[1 + row])
        made = "prior" if shown.prior else "recovered"
        for solid, tint, style, text in ((true, TRUE, "-", "true"), (faces, FIT, "--", made)):
            draw_outline(flat, solid[..., [i, j]], tint, style, text)
        flat.plot(points[near, i], points[near, j], ".", color=CONTACT, ms=3, label="contacts")
        if not near.all():
            flat.plot(points[~near, i], points[~near, j], "o", ms=2.5, mfc="none", mew=0.6,
                      color=CONTACT, label="not counted")
        flat.use_sticky_edges = False  # the frame would lie on outlines and cut contacts there
        flat.set_aspect("equal")
        wide_enough = np.ptp(around[:, i]) > 0.35 * np.ptp(around[:, j])
        flat.xaxis.set_major_locator(MaxNLocator(3) if wide_enough else FixedLocator([0.0]))
        flat.set(xlabel="xyz"[i] + " [mm]", ylabel="xyz"[j] + " [mm]")
        flat.set_title("outlines from above" if row else "outlines from the front")
        if row == 0 and wide:
            flat.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        elif row == 0:
            drawn.legend(*flat.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return drawn

