"""A figure of tactile images with their centroids and principal axes.

Moments as in section III of Allen and Michelman (1990), over the taxels that the robot itself uses:
counts of at least half the threshold, at most three taxels from the largest.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sweeps.figures.style import COLUMN_IN, cut_to, drawing, encode, figure
from warpgrasp.parameters import TAXELS, PadTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.touch.tactile_image import moments

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sweeps.episode.episodes import EpisodeBlock
SHOWN = 4
WINDOW = 3  # taxels each way from the largest
FINGERS = ("finger 1", "finger 2", "finger 3", "thumb")
_CENTRE, _AXES, _WINDOW = "#D55E00", "#E69F00", "#0072B2"


@dataclass(frozen=True)
class PadTouch:
    """One touch of a pad: its number in the episode, its finger, and the counts (16, 16)."""

    number: int
    finger: int
    image: np.ndarray


@dataclass(frozen=True)
class Ellipse:
    """Moments of an image on its pad [mm]: x across the link, y along it towards the tip."""

    centroid_mm: np.ndarray
    """(x, y)."""
    axes_mm: np.ndarray
    """Principal axes (axis, 2), the longer first; one standard deviation long."""
    low_mm: np.ndarray
    """Lower corner of the window, (x, y)."""
    size_mm: np.ndarray
    """Size of the window, (x, y)."""


@dataclass(frozen=True)
class TaxelsShown:
    """What the figure shows; a process that draws it does without the simulator."""

    name: str
    touches: tuple[PadTouch, ...]
    pads: PadTable


def pad_touches(block: "EpisodeBlock", world: int = 0) -> list[PadTouch]:
    """The touches of one world with contact at a pad, in their order."""
    from warpgrasp.robot import Grasps

    found = []
    made = 0
    for procedure in block.exploration.procedures:
        if isinstance(procedure.felt, Grasps):
            continue
        table = procedure.felt.touches
        for row in np.flatnonzero(table.world == world):
            made += 1
            if table.status[row] == ProbeStatus.CONTACT and table.image[row].any():
                found.append(PadTouch(made, int(table.finger[row]), table.image[row]))
    return found


def image_ellipse(image: np.ndarray, pads: PadTable) -> Ellipse:
    """Centroid and principal axes of an image (16, 16), over the taxels that the robot uses."""
    pitch = np.array([pads.width_m, pads.length_m]) * 1e3 / TAXELS
    top = np.array(np.unravel_index(int(image.argmax()), image.shape))
    low, high = np.maximum(top - WINDOW, 0), np.minimum(top + WINDOW + 1, TAXELS)
    part = image[low[0]:high[0], low[1]:high[1]].astype(float)
    # `moments` uses counts above the level; here a count equal to half the threshold is used.
    level = np.nextafter(pads.threshold_counts / 2, 0.0)
    if not (part > level).any():
        level = 0.0
    found = moments(part[None], level)
    rr, rc, cc = found.second[0]
    size, way = np.linalg.eigh(np.array([[cc, rc], [rc, rr]]) * np.outer(pitch, pitch))
    axes = (way * np.sqrt(np.maximum(size, 0.0))).T[::-1]
    centroid = (found.centroid[0] + low + 0.5)[::-1] * pitch
    return Ellipse(centroid, axes, low[::-1] * pitch, (high - low)[::-1] * pitch)


def taxels_shown(block: "EpisodeBlock", pads: PadTable, name: str, world: int = 0) -> TaxelsShown:
    """The touches with the largest sums of counts. Raises StoreError where no pad had contact."""
    from sweeps.spec.errors import StoreError

    touches = pad_touches(block, world)
    if not touches:
        raise StoreError(
            "taxels: no pad touched anything in this episode; ask for one of a strategy that "
            'crosses faces or follows a contour (order = ["containment", "decide"])')
    loaded = sorted(touches, key=lambda touch: -int(touch.image.astype(int).sum()))[:SHOWN]
    return TaxelsShown(name, tuple(sorted(loaded, key=lambda touch: touch.number)), pads)


def draw_taxels(shown: TaxelsShown) -> bytes:
    """A PNG, one column wide; the same touches give the same bytes."""
    return encode(_drawn(shown), "png")


def taxels_figure(block: "EpisodeBlock", pads: PadTable, name: str, world: int = 0) -> "Figure":
    """The touches of one world, one column wide. Raises StoreError where no pad had contact."""
    return _drawn(taxels_shown(block, pads, name, world))


@drawing()
def _drawn(shown: TaxelsShown) -> "Figure":
    """A panel for each of at most four touches."""
    from matplotlib.patches import Rectangle

    name, touches, pads = shown.name, shown.touches, shown.pads
    wide, tall = 1e3 * pads.width_m, 1e3 * pads.length_m
    drawn = figure(2.85)
    drawn.set_layout_engine("none")  # panels have a pad's own proportions: placed by hand
    grid = drawn.add_gridspec(1, SHOWN, left=0.12, right=0.97, bottom=0.42, top=0.80, wspace=0.12)
    bar = drawn.add_axes((0.12, 0.21, 0.85, 0.03))
    image: Any = None
    largest = max(int(touch.image.max()) for touch in touches)
    panels = []
    for place, touch in enumerate(touches):
        axes = drawn.add_subplot(grid[0, place])
        peak = int(touch.image.max())
        image = axes.imshow(touch.image, origin="lower", extent=(0.0, wide, 0.0, tall),
                            cmap="Greys", vmin=0.0, vmax=largest, interpolation="nearest")
        found = image_ellipse(touch.image, pads)
        axes.add_patch(Rectangle((found.low_mm[0], found.low_mm[1]), *found.size_mm, fill=False,
                                 ls=":", lw=0.8, color=_WINDOW, label="taxels that count"))
        for axis, style in zip(found.axes_mm, ("-", (0, (2, 1))), strict=True):
            ends = found.centroid_mm + np.outer([-2.0, 2.0], axis)
            axes.plot(*ends.T, ls=style, color=_AXES, lw=1.2,
                      label="principal axes, 2 sd each way" if style == "-" else None)
        axes.plot(*found.centroid_mm, "o", ms=2.6, mfc=_CENTRE, mec="white", mew=0.4,
                  label="centroid")
        axes.set(xlim=(0.0, wide), ylim=(0.0, tall))
        axes.set_xticks([0, 5, 10])
        axes.tick_params(labelleft=place == 0)
        axes.spines[:].set_visible(True)
        axes.set_title(f"touch {touch.number}\n{FINGERS[touch.finger]}\npeak {peak}", fontsize=6.5,
                       pad=3.0)
        panels.append(axes)
    panels[0].set_ylabel("along the link, tip up [mm]")
    drawn.text(0.545, 0.315, "across the link [mm]", ha="center", va="center", fontsize=7.0)
    drawn.colorbar(image, cax=bar, orientation="horizontal",
                   label="reading [counts of 255], the same scale for all")
    drawn.text(0.545, 0.965, f"{cut_to(name, 0.6 * COLUMN_IN)}: what pads read", ha="center",
               va="center", fontsize=7.5)
    drawn.legend(*panels[0].get_legend_handles_labels(), loc="lower center", ncols=3,
                 columnspacing=0.9, handlelength=1.2, handletextpad=0.5, borderaxespad=0.1,
                 borderpad=0.1, fontsize=6.0, bbox_to_anchor=(0.5, 0.0))
    return drawn
