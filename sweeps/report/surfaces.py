"""The true and the recovered surface of one episode, coloured by how sure the robot is of it.

What is shown is made of arrays alone, and only what makes it imports the simulator: a process that
draws does without it.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sweeps.figures.solids import CONTACT, TRUE, direction, draw_solid, set_box, visible
from sweeps.figures.style import cut, drawing, encode, figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sweeps.episode.episodes import EpisodeBlock
VIEWS_DEG = (22.0, -55.0), (48.0, 125.0)
"""Elevation and azimuth: from the front, and into the object from behind and above."""
NEAREST = 4
"""Samples of a free form's surface whose deviations make that of a place."""
UNSURE_M = 0.010
"""The deviation whose colour is the last of the scale; larger ones have it too."""


def surface_sigma(block: "EpisodeBlock", points_m: np.ndarray, world: int = 0) -> np.ndarray | None:
    """Standard deviation of a world's scored surface along its normal at places (point, 3) of it,
    as the robot knows it [m]; None where only the prior, or a user's mesh, stands for the body."""
    from scipy.spatial import KDTree

    from fit.arrays import rows_of
    from strategies.contacts.body_uncertainty import surface_spread
    from strategies.recovery.choose_model import Shape
    from sweeps.figures.meshes import mesh_of_world

    mesh, rebuilt = mesh_of_world(block, world), block.rebuilt
    if mesh is not None and rebuilt is not None:
        volume = rebuilt.volume(world)
        if volume is None:
            return None
        far, near = KDTree(volume.surface_m[0]).query(points_m, NEAREST)
        weight = 1.0 / np.maximum(far, 1e-6)
        return (volume.surface_std_m[0][near] * weight).sum(1) / weight.sum(1)
    belief, mine = block.exploration.belief, np.array([world])
    if block.recovered.shape[world] == Shape.PRIOR:
        return None
    return surface_spread(rows_of(belief.body, mine), rows_of(belief.uncertainty, mine),
                          rows_of(belief.felt, mine), points_m[None])[0]


@dataclass(frozen=True)
class SurfacesShown:
    """What the figure shows, in mm from the object's place on the table."""

    name: str
    made: str
    """What the body on the right is: recovered, or the prior."""
    true: np.ndarray
    """Faces of the true body, (face, corner, 3)."""
    faces: np.ndarray
    """Of the recovered one, (face, 3 or 4, 3)."""
    sigma: np.ndarray | None
    """Standard deviation of the recovered surface at each face's middle [m], where known."""
    points: np.ndarray
    """Contacts as placed on the body that stands, (contact, 3)."""


def surfaces_shown(block: "EpisodeBlock", name: str, world: int = 0) -> SurfacesShown:
    """What the figure of one world of a block shows."""
    from sweeps.figures.meshes import mesh_of_world, recovered_faces, turned_mesh

    pose = block.truth.body_pose[world]
    vertices, sides = turned_mesh(block.body, pose, 48)
    faces = recovered_faces(block, world)
    sigma = surface_sigma(block, faces.mean(1), world)
    made = "recovered" if sigma is not None or mesh_of_world(block, world) else "prior"
    placed = block.exploration.placed
    points = placed.points_m[world][placed.mask[world]]
    return SurfacesShown(name, made, (1e3 * vertices)[sides], 1e3 * (faces - pose[:3]),
                         sigma, 1e3 * (points - pose[:3]))


def draw_surfaces(shown: SurfacesShown) -> bytes:
    """A PNG; the same surfaces give the same bytes."""
    return encode(surfaces_figure(shown), "png")


@drawing()
def surfaces_figure(shown: SurfacesShown) -> "Figure":
    """The true surface beside the recovered one, a row a view, a page wide; the contacts in sight
    on the recovered one."""
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize, to_rgb

    name, made, sigma = shown.name, shown.made, shown.sigma
    true, faces, points = shown.true, shown.faces, shown.points
    scale = ScalarMappable(Normalize(0.0, 1e3 * UNSURE_M), colormaps["viridis"])
    tint = (np.tile(to_rgb(TRUE), (len(faces), 1)) if sigma is None
            else scale.to_rgba(1e3 * sigma)[:, :3])

    drawn = figure(6.2, 6.85)
    every = np.concatenate([true.reshape(-1, 3), faces.reshape(-1, 3)])
    low, high = every.min(0), every.max(0)
    middle, half = (low + high) / 2, 0.55 * max((high - low)[:2].max(), 0.7 * high[2])
    solids = []
    for row, (elevation, azimuth) in enumerate(VIEWS_DEG):
        eye, light = direction(azimuth, elevation), direction(azimuth - 12.0, 48.0)
        for column, (solid, colour) in enumerate(((true, "#b8b8b8"), (faces, tint))):
            axes = drawn.add_subplot(2, 2, 2 * row + column + 1, projection="3d")
            axes.computed_zorder = False
            axes.patch.set_visible(False)  # it would hide the labels of the row above
            draw_solid(axes, solid, eye, colour, light)
            if column:
                seen = visible(points, faces, eye)
                axes.scatter(*points[seen].T, s=7, color=CONTACT, depthshade=False, zorder=10)
            set_box(axes, np.array([*(middle[:2] - half), 0.0]),
                    np.array([*(middle[:2] + half), max(1.08 * high[2], half)]), 0.82, (3, 3, 4))
            axes.view_init(elevation, azimuth)
            if row == 0:
                axes.set_title(f"{cut(name)}: {made} surface, contacts in sight" if column
                               else f"{cut(name)}: true surface")
            solids.append(axes)
    if sigma is not None:
        drawn.colorbar(scale, ax=solids, orientation="horizontal", shrink=0.5, aspect=40, pad=0.02,
                       label="standard deviation of the recovered surface, as the robot knows it "
                       "[mm]", extend="max")
    return drawn
