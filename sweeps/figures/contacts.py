"""A figure of contacts over the recovered body, after figure 4 of Allen and Michelman 1990.

Left the recovered body with the contacts on it, what is behind it hidden; right the convex hulls
of its outline and of the true one, seen from the front and from above.
"""

from typing import TYPE_CHECKING

import numpy as np

from strategies.recovery.choose_model import Shape
from sweeps.episode.episodes import EpisodeBlock
from sweeps.figures.meshes import quadrilaterals, recovered_grid
from sweeps.figures.style import cut, drawing, encode, figure
from warpgrasp.geometry.body_sampling import sample_body

if TYPE_CHECKING:
    from matplotlib.figure import Figure
_BODY = "#9db7d5"
_CONTACT = "#b2182b"
_TRUE = "#4d4d4d"
_FIT = "#2166ac"
_VIEW = (22.0, -55.0)  # elevation, azimuth [deg]


def draw_contacts(block: EpisodeBlock, name: str, world: int = 0) -> bytes:
    """A PNG of one world of a block; the same block gives the same bytes."""
    with drawing():
        return encode(contacts_figure(block, name, world, wide=True), "png")


def contacts_figure(block: EpisodeBlock, name: str, world: int = 0,
                    wide: bool = False) -> "Figure":
    """One world of a block: a page wide, or one column with the hulls below the body."""
    with drawing():
        return _draw(block, name, world, wide)


def _draw(block: EpisodeBlock, name: str, world: int, wide: bool) -> "Figure":
    from matplotlib.colors import to_rgb
    from matplotlib.ticker import FixedLocator, MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    pose = block.truth.body_pose[world]
    faces = 1e3 * (quadrilaterals(recovered_grid(block.recovered, world)) - pose[:3])
    corners, told = faces.reshape(-1, 3), block.recovered.shape[world] == Shape.TOLD_CYLINDER
    evidence = block.exploration.belief.evidence
    points = 1e3 * (evidence.points_m[world][evidence.mask[world]] - pose[:3])
    yaw = 2.0 * np.arctan2(pose[5], pose[6])
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    true = 1e3 * sample_body(block.body, surface=8192).surface_m @ turn.T

    if wide:
        drawn = figure(3.5, 6.85)
        grid = drawn.add_gridspec(2, 2, width_ratios=(1.35, 1.0))
        places = (grid[:, 0], grid[0, 1], grid[1, 1])
    else:
        drawn = figure(5.0)
        grid = drawn.add_gridspec(2, 2, height_ratios=(1.5, 1.0))
        places = (grid[0, :], grid[1, 0], grid[1, 1])
    axes = drawn.add_subplot(places[0], projection="3d")
    elevation, azimuth = np.radians(_VIEW)
    eye = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth),
                    np.sin(elevation)])
    normal = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.maximum(length, 1e-12)
    middle = faces.mean(axis=1)
    outward = np.sign(((middle - middle.mean(0)) * normal).sum(1, keepdims=True))
    light = 0.55 + 0.45 * np.clip((normal * outward) @ np.array([0.3, -0.6, 0.74]), 0.0, 1.0)
    colour = np.concatenate([np.array(to_rgb(_BODY)) * light[:, None],
                             np.full((len(faces), 1), 1.0)], axis=1)
    facing = ((normal * outward) @ eye) > 0.0
    axes.add_collection3d(Poly3DCollection(list(faces[facing]), facecolors=colour[facing],
                                           edgecolors=colour[facing], linewidths=0.3,
                                           zsort="average", zorder=1))
    seen = _visible(points, middle, normal * outward, eye)
    axes.scatter(*points[seen].T, s=14, color=_CONTACT, depthshade=False, zorder=10,
                 label="contacts in sight")
    low, high = np.minimum(true.min(0), corners.min(0)), np.maximum(true.max(0), corners.max(0))
    across = (high - low)[:2].max()
    # A wall and a floor large enough for their numbers, behind a plate and under a bottle too.
    tall = max(1.08 * high[2], 0.5 * across)
    middle_box, aside = (low + high) / 2, max(0.65 * across, 0.38 * tall)
    axes.set(xlim=(middle_box[0] - aside, middle_box[0] + aside),
             ylim=(middle_box[1] - aside, middle_box[1] + aside),
             zlim=(0.0, tall), xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    axes.set_box_aspect((2.0 * aside, 2.0 * aside, tall),
                        zoom=0.9 if wide else 0.78)  # pyright: ignore[reportArgumentType]
    for axis, ticks in ((axes.xaxis, 3), (axes.yaxis, 3), (axes.zaxis, 5)):
        axis.set_major_locator(MaxNLocator(ticks))
    axes.zaxis.labelpad = 6.0
    axes.view_init(*_VIEW)
    axes.computed_zorder = False
    axes.set_title(f"{cut(name)}: {'cylinder as told' if told else 'recovered body'} and contacts")

    for row, (i, j, label) in enumerate(((0, 2, "front"), (0, 1, "above"))):
        flat = drawn.add_subplot(places[1 + row])
        for cloud, tint, style, text in ((true, _TRUE, "-", "true"),
                                         (corners, _FIT, "--", "as told" if told else "recovered")):
            outline = _outline(cloud[:, [i, j]])
            flat.plot(*outline.T, style, color=tint, lw=1.2, label=text)
        flat.plot(points[:, i], points[:, j], ".", color=_CONTACT, ms=3, label="contacts")
        flat.set_aspect("equal")
        wide_enough = np.ptp(true[:, i]) > 0.35 * np.ptp(true[:, j])
        flat.xaxis.set_major_locator(MaxNLocator(3) if wide_enough else FixedLocator([0.0]))
        flat.set(xlabel="xyz"[i] + " [mm]", ylabel="xyz"[j] + " [mm]")
        flat.set_title(f"hulls from {label}" if row else "hulls from the front")
        if row == 0 and wide:
            flat.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
        elif row == 0:
            drawn.legend(*flat.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return drawn


def _visible(points: np.ndarray, middle: np.ndarray, normal: np.ndarray,
             eye: np.ndarray) -> np.ndarray:
    """Which points lie on the side of the body that faces the eye."""
    if len(points) == 0:
        return np.zeros(0, bool)
    nearest = np.argmin(((points[:, None] - middle[None]) ** 2).sum(-1), axis=1)
    return normal[nearest] @ eye > 0.0


def _outline(cloud: np.ndarray) -> np.ndarray:
    """The convex hull of a silhouette, closed, (point, 2)."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(cloud)
    ring = cloud[hull.vertices]
    return np.concatenate([ring, ring[:1]])
