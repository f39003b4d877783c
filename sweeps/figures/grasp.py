"""A figure of the hand on the object, at the frame of an episode with the strongest contacts."""

from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from sweeps.figures.replay_frames import Frame, Replay, segment_pose
from sweeps.figures.solids import direction, keep_labels_inside, lit, set_box
from sweeps.figures.style import COLUMN_IN, drawing, figure, titled
from sweeps.spec.errors import StoreError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
_BODY, _LINK, _FELT, _CONTACT = "#dcd6c4", "#6d8ab8", "#D55E00", "#111111"
_DOT_M = 0.0022
ZOOM = 0.84
ELEVATION_DEG, LIGHT_DEG = 18.0, 35.0
"""Of the eye above the floor; of the light aside of the eye, half as much more above the floor."""


@drawing()
def grasp_figure(replay: Replay, name: str) -> "Figure":
    """Hand and object in millimetres from the object's foot; contacts so far as dots.

    Raises StoreError for an episode without contacts.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    frame = max(replay.frames, key=lambda frame: (float(frame.felt.sum()), frame.contacts))
    if not frame.felt.any():
        raise StoreError("grasp: no finger felt anything in this episode; ask for another")
    low, high = replay.body_m.min(0), replay.body_m.max(0)
    foot = np.array([*((low + high) / 2)[:2], 0.0])
    dot = trimesh.creation.icosphere(subdivisions=1, radius=_DOT_M).triangles
    solids = [(replay.body_m[replay.body_faces], _BODY), *hand_solids(replay, frame),
              *((at + dot, _CONTACT) for at in replay.contacts_m[:frame.contacts])]
    way = Rotation.from_quat(frame.hand_turn).apply([0.0, 0.0, 1.0])
    azimuth = float(np.degrees(np.arctan2(way[1], way[0]))) + 75.0  # the hand is seen from a side
    light = direction(azimuth + LIGHT_DEG, 1.5 * LIGHT_DEG)
    colours = np.concatenate([lit(faces, tint, light) for faces, tint in solids])
    drawn = figure(COLUMN_IN)
    axes: Any = drawn.add_subplot(projection="3d")
    axes.add_collection3d(Poly3DCollection(
        [1e3 * (face - foot) for faces, _ in solids for face in faces], facecolors=colours,
        edgecolors=colours, linewidths=0.2, zsort="average"), autolim=False)
    corners = 1e3 * (np.concatenate([frame.links_m.reshape(-1, 3), replay.body_m]) - foot)
    half = 1.1 * np.abs(corners[:, :2]).max()
    tall = 1.1 * corners[:, 2].max()
    set_box(axes, np.array([-half, -half, 0.0]), np.array([half, half, tall]), ZOOM, (3, 3, 3))
    axes.zaxis.labelpad = 6.0
    axes.view_init(ELEVATION_DEG, azimuth)
    axes.set_title(titled(name, frame.label))
    drawn.legend(handles=[
        Patch(color=_LINK, label="hand"), Patch(color=_FELT, label="tip that feels"),
        Line2D([], [], ls="", marker="o", ms=2.5, color=_CONTACT, label="contacts so far")],
        loc="outside lower center", ncols=3)
    keep_labels_inside(drawn, ZOOM)
    return drawn


def hand_solids(replay: Replay, frame: Frame) -> list[tuple[np.ndarray, str]]:
    """Triangles (face, 3, 3) of palm, wrist and each link, with their colours."""
    bars = frame.in_base(replay.hand.bars_m)
    solids = [(_capsule(a, b, radius), _LINK)
              for (a, b), radius in zip(bars, replay.hand.bar_radius_m, strict=True)]
    for links, radii, felt in zip(frame.links_m, replay.hand.link_radius_m, frame.felt,
                                  strict=True):
        solids += [(_capsule(a, b, radius), _FELT if n + 1 == len(radii) and felt else _LINK)
                   for n, ((a, b), radius) in enumerate(zip(links, radii, strict=False))]
    return solids


def _capsule(a: np.ndarray, b: np.ndarray, radius_m: float) -> np.ndarray:
    """Triangles (face, 3, 3) of a capsule about the segment from a to b."""
    mesh = trimesh.creation.capsule(float(np.linalg.norm(b - a)), radius_m, count=(8, 12))
    return _placed(mesh, *segment_pose(a, b))


def _placed(mesh: trimesh.Trimesh, at: np.ndarray, turn: Rotation) -> np.ndarray:
    """Triangles (face, 3, 3) of a mesh, turned about its origin and moved."""
    return (at + turn.apply(np.array(mesh.vertices)))[mesh.faces]
