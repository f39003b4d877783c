"""A figure of traces on faces and planes fitted to them (Allen and Michelman 1990, figure 5).

What is shown is made of arrays alone, and only what makes it imports the simulator: a process that
draws does without it.
"""

from dataclasses import dataclass
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np

from sweeps.figures.solids import TRUE, direction, set_cube
from sweeps.figures.style import COLOURS, drawing, encode, figure, titled
from sweeps.text_table import number_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sweeps.episode.episodes import EpisodeBlock
ELEVATION_DEG = 24.0
TRUE_CELLS = 12
"""Of the true body's mesh along its longest side: lines enough to see its shape."""
ASIDE_DEG = 40.0  # of the normal of a single side


@dataclass(frozen=True)
class FaceShown:
    """A face that was crossed, in mm from the object's place on the table."""

    corner: np.ndarray
    """Of the plane that was fitted, (4, 3)."""
    normal: np.ndarray
    points: np.ndarray
    """Touches, (touch, 3)."""
    part: np.ndarray
    """The line that each is of, (touch,)."""
    rms_mm: float
    flat: bool


@dataclass(frozen=True)
class FacesShown:
    """What the figure shows."""

    name: str
    faces: tuple[FaceShown, ...]
    true: np.ndarray
    """Faces of the true body, (face, corner, 3)."""


def crossed_faces(block: "EpisodeBlock", world: int = 0) -> list[int]:
    """Which faces of one world were crossed far enough to be drawn."""
    return [n for n, face in enumerate(block.exploration.belief.faces)
            if face.fit.n_points[world] >= 3]


def faces_shown(block: "EpisodeBlock", name: str, world: int = 0) -> FacesShown:
    """What the figure of one world of a block shows. Raises StoreError where no face was crossed.
    """
    from scipy.spatial.transform import Rotation

    from strategies.procedures.planar_record import PlanarExploration
    from sweeps.figures.meshes import true_mesh
    from sweeps.spec.errors import StoreError

    known = crossed_faces(block, world)
    if not known:
        raise StoreError("faces: none was crossed in this episode; ask for one of a strategy that "
                         'crosses faces (order = ["containment", "planar"])')
    origin = block.truth.body_pose[world, :3]
    crossed = [p.felt for p in block.exploration.procedures
               if isinstance(p.felt, PlanarExploration)]
    shown = []
    for number in known:
        face = block.exploration.belief.faces[number]
        u, v = face.fit.axes[world] * face.fit.extent_m[world][:, None] / 2
        corner = np.array([-u - v, u - v, u + v, v - u]) + face.fit.centre_m[world] - origin
        table = crossed[number].touches
        mine = (table.world == world) & np.isfinite(table.point_m).all(1)
        shown.append(FaceShown(
            1e3 * corner, face.normal[world], 1e3 * (table.point_m[mine] - origin),
            table.part[mine], float(1e3 * face.fit.rms_m[world]), bool(face.flat[world])))
    vertices, sides = true_mesh(block.body, TRUE_CELLS)
    true = 1e3 * Rotation.from_quat(block.truth.body_pose[world, 3:]).apply(vertices)
    return FacesShown(name, tuple(shown), true[sides])


def draw_faces(shown: FacesShown) -> bytes:
    """A PNG, a page wide; the same faces give the same bytes."""
    return encode(_drawn(shown, wide=True), "png")


def faces_figure(block: "EpisodeBlock", name: str, world: int = 0,
                 wide: bool = False) -> "Figure":
    """One world of a block: a page wide, or one column with the planes' numbers below.

    Raises StoreError where no face was crossed.
    """
    return _drawn(faces_shown(block, name, world), wide)


@drawing()
def _drawn(shown: FacesShown, wide: bool) -> "Figure":
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    drawn = figure(4.2, 6.85) if wide else figure(4.1)
    axes: Any = drawn.add_subplot(projection="3d")
    axes.computed_zorder = False
    clouds = [np.zeros((1, 3))]
    normals = np.array([face.normal for face in shown.faces])
    sides = normals[np.abs(normals[:, 2]) < 0.7]
    # The view is between the two sides whose angle is in the title.
    facing = (sides[0] + sides[1] if len(sides) > 1 and sides[0] @ sides[1] > -0.5
              else (sides if len(sides) else normals)[0])
    azimuth = np.degrees(np.arctan2(facing[1], facing[0])) + (
        0.0 if len(sides) > 1 else ASIDE_DEG)
    eye = direction(azimuth, ELEVATION_DEG)
    for place, face in enumerate(shown.faces):
        tint, points = COLOURS[place % len(COLOURS)], face.points
        hidden = face.normal @ eye < 0
        clouds += [face.corner, points]
        axes.add_collection3d(Poly3DCollection(
            [face.corner], facecolors=tint, edgecolors=tint, alpha=0.08 if hidden else 0.25,
            zorder=1 if hidden else 2))
        for part in np.unique(face.part):
            line = points[face.part == part]
            axes.plot(*line.T, "-", color=tint, lw=0.7, alpha=0.3 if hidden else 0.9,
                      zorder=1 if hidden else 3)
        label = (f"face {place + 1}: {len(points)} touches\n  "
                 f"normal ({', '.join(number_text(part, 2) for part in face.normal)})\n  "
                 f"rms {face.rms_mm:.2f} mm"
                 + ("" if face.flat else ", not flat"))
        axes.scatter(*points.T, s=5, color=tint, depthshade=False, label=label,
                     alpha=0.3 if hidden else 1.0, zorder=1 if hidden else 4)
    axes.add_collection3d(Poly3DCollection(
        list(shown.true), facecolors="none", edgecolors=TRUE, linewidths=0.25, alpha=0.35,
        zorder=0, label="true body"), autolim=False)
    set_cube(axes, np.concatenate(clouds), 0.54, 20.0, 0.86)
    axes.view_init(ELEVATION_DEG, azimuth)
    angle = _neighbours(normals)
    axes.set_title(titled(shown.name, "traces on faces, planes fitted" + (
        "" if angle is None else f"; neighbours at {angle:.1f} deg")))
    if wide:
        drawn.legend(loc="outside right center")
    else:
        drawn.legend(loc="outside lower center", ncols=2, handletextpad=0.2, columnspacing=0.8,
                     borderpad=0.0)
    return drawn


def _neighbours(normals: np.ndarray) -> float | None:
    """Angle between the first two faces that are neighbours [deg], None without such."""
    for one, other in combinations(normals, 2):
        angle = np.degrees(np.arccos(np.clip(one @ other, -1.0, 1.0)))
        if 45 < angle < 135:
            return float(angle)
    return None
