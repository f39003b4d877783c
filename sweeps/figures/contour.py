"""A figure of a body recovered from its contour, after figure 6 of Allen and Michelman (1990).

Left the solid of revolution, right its contour over the true one.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from fit.revolution.geometry import RevolutionBody
from sweeps.episode.episodes import EpisodeBlock
from sweeps.figures.meshes import quadrilaterals, revolution_grid
from sweeps.figures.solids import CONTACT, FIT, TRUE, direction, draw_solid
from sweeps.figures.style import COLUMN_IN, cut_to, drawing, figure
from sweeps.spec.errors import StoreError
from warpgrasp.geometry.body_sampling import sample_body

if TYPE_CHECKING:
    from matplotlib.figure import Figure
ELEVATION_DEG, AZIMUTH_DEG = 20.0, -55.0


@drawing()
def contour_figure(block: EpisodeBlock, name: str, world: int = 0,
                   wide: bool = False) -> "Figure":
    """One world of a block, a page or a column wide. Raises StoreError without a contour."""
    profile = block.exploration.belief.profile
    if profile is None or not np.isfinite(profile.volume_m3[world]):
        raise StoreError("contour: none was followed to its end in this episode; ask for one of a "
                         'strategy that follows contours (order = ["containment", "contour"])')
    from matplotlib.ticker import MaxNLocator

    known = np.isfinite(profile.height_m[world])
    z, r = 1e3 * profile.height_m[world][known], 1e3 * profile.radius_m[world][known]
    ring = revolution_grid(RevolutionBody(
        np.zeros((1, 3)), np.array([[0.0, 0.0, 1.0]]), z[None], r[None]), 0, 48)
    drawn = figure(4.2, 6.85) if wide else figure(3.3)
    grid = drawn.add_gridspec(1, 2, width_ratios=(1.2, 1.0))
    axes: Any = drawn.add_subplot(grid[0, 0], projection="3d")
    draw_solid(axes, quadrilaterals(ring), direction(AZIMUTH_DEG, ELEVATION_DEG))
    half, tall = 1.15 * r.max(), z.max()
    axes.set(xlim=(-half, half), ylim=(-half, half), zlim=(0, tall))
    axes.view_init(ELEVATION_DEG, AZIMUTH_DEG)
    bar = _scale_bar(axes, 1.05 * r.max(), tall)
    fill_axes(axes, (2 * half, 2 * half, tall), np.concatenate([ring.reshape(-1, 3), bar]))
    axes.set_axis_off()
    volume = 1e6 * profile.volume_m3[world]
    drawn.suptitle(cut_to(name, 0.92 * COLUMN_IN), fontsize=7.5)
    axes.set_title(f"solid of revolution,\n{tall:.0f} mm tall,\n{volume:.0f} ml")

    flat = drawn.add_subplot(grid[0, 1])
    sample = 1e3 * sample_body(block.body, surface=8192).surface_m
    _true_outline(flat, sample)
    for side in (-1, 1):
        flat.plot(side * r, z, "-", color=FIT, lw=1.3, label="recovered" if side > 0 else None)
    followed = [p for p in block.exploration.procedures
                if p.name == "contour" and p.took_part[world]][-1].felt
    points, mask = followed.touches.sets(len(block.status))  # type: ignore[union-attr]
    arm = points[world][mask[world]] - profile.foot_m[world]
    along = arm @ profile.axis[world]
    away = np.linalg.norm(arm - along[:, None] * profile.axis[world], axis=1)
    flat.plot(1e3 * away * _side(arm), 1e3 * along, ".", color=CONTACT, ms=3, label="touches")
    flat.set_aspect("equal")
    flat.xaxis.set_major_locator(MaxNLocator(3))
    flat.set(xlabel="from the axis [mm]", ylabel="along the axis [mm]")
    flat.set_title("contour")
    drawn.legend(*flat.get_legend_handles_labels(),
                 loc="outside right center" if wide else "outside lower center",
                 ncols=1 if wide else 3)
    return drawn


def fill_axes(axes: Any, box: tuple[float, float, float], cloud: np.ndarray) -> None:
    """Draws a box [mm] as large as its axes can hold a cloud of points [mm] within it."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    zoom = 1.0
    for _ in range(3):  # perspective: near points grow faster than far ones
        axes.set_box_aspect(box, zoom=zoom)
        x, y, _ = proj_transform(cloud[:, 0], cloud[:, 1], cloud[:, 2], axes.get_proj())
        place = axes.transLimits.transform(np.stack([x, y], 1))
        zoom *= 0.5 / np.abs(place - 0.5).max()
    axes.set_box_aspect(box, zoom=0.99 * zoom)


def _scale_bar(axes: Any, aside: float, tall: float) -> np.ndarray:
    """Draws a round length [mm] upright at the right of a solid; its two ends."""
    length = max(size for size in (5, 10, 20, 50, 100) if size <= max(tall / 2, 5))
    right = np.radians(AZIMUTH_DEG + 90.0)
    foot = aside * np.array([np.cos(right), np.sin(right), 0.0])
    ends = np.array([foot, foot + [0.0, 0.0, length]])
    axes.plot(*ends.T, "-", color=TRUE, lw=1.5)
    axes.text(*(1.06 * foot + [0.0, 0.0, length / 2]), f"{length} mm", va="center",
              fontsize=6.0)
    return ends


def _side(arm: np.ndarray) -> np.ndarray:
    """+1 or -1 for touches on either side of the axis, along their main spread across it."""
    if len(arm) < 2:
        return np.ones(len(arm))
    _, _, ways = np.linalg.svd(arm[:, :2] - arm[:, :2].mean(0), full_matrices=False)
    return np.where(arm[:, :2] @ ways[0] < 0, -1.0, 1.0)


def _true_outline(axes: Any, sample: np.ndarray) -> None:
    """Largest radius of the true body at each height, both sides."""
    from scipy.stats import binned_statistic

    height, radius = sample[:, 2], np.hypot(sample[:, 0], sample[:, 1])
    most, edges, _ = binned_statistic(height, radius, "max", 59, (0.0, height.max()))
    middle = 0.5 * (edges[1:] + edges[:-1])
    for side in (-1, 1):
        axes.plot(side * most, middle, "-", color=TRUE, lw=3.0,
                  alpha=0.3, label="true" if side > 0 else None)
