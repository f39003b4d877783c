"""A figure of the hand on the object, at the moment of an episode at which it feels most."""

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from sweeps.figures.meshes import capsule_mesh
from sweeps.figures.replay_frames import Frame, Replay
from sweeps.figures.style import COLUMN_IN, cut, drawing, figure
from sweeps.spec.errors import StoreError

if TYPE_CHECKING:
    from matplotlib.figure import Figure
_BODY, _LINK, _FELT, _CONTACT = "#dcd6c4", "#6d8ab8", "#D55E00", "#111111"
_DOT_M = 0.0022
_PALM_M = np.array([0.095, 0.075, 0.03])
_WRIST_M, _WRIST_LONG_M = 0.03, 0.06
_ELEVATION = 18.0  # deg
_LIT = 35.0  # deg; the light stands this far aside of the eye, half as high again


def grasp_figure(replay: Replay, name: str) -> "Figure":
    """Hand and object in millimetres from the object's foot; contacts felt so far as dots.

    Raises StoreError where no finger ever felt anything.
    """
    frame = max(replay.frames, key=lambda frame: (float(frame.felt.sum()), frame.contacts))
    if not frame.felt.any():
        raise StoreError("grasp: no finger felt anything in this episode; ask for another")
    with drawing():
        return _draw(replay, frame, name)


def _draw(replay: Replay, frame: Frame, name: str) -> "Figure":
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    low, high = replay.body_m.min(0), replay.body_m.max(0)
    foot = np.array([*((low + high) / 2)[:2], 0.0])
    dot, quads = capsule_mesh(0.0, _DOT_M, 6, 2)
    solids = [(replay.body_m[replay.body_faces], _BODY), *_hand(replay, frame),
              *(((at + dot)[quads], _CONTACT) for at in replay.contacts_m[:frame.contacts])]
    faces = 1e3 * (np.concatenate([quads for quads, _ in solids]) - foot)
    tints = [tint for quads, tint in solids for _ in quads]
    drawn = figure(COLUMN_IN)
    axes: Any = drawn.add_subplot(projection="3d")
    azimuth = _aside(frame)
    colours = _shaded(faces, tints, azimuth)
    axes.add_collection3d(Poly3DCollection(
        list(faces), facecolors=colours, edgecolors=colours, linewidths=0.2, zsort="average"),
        autolim=False)
    corners = 1e3 * (np.concatenate([frame.fingers_m.reshape(-1, 3), replay.body_m]) - foot)
    half = 1.1 * np.abs(corners[:, :2]).max()
    tall = 1.1 * corners[:, 2].max()
    axes.set(xlim=(-half, half), ylim=(-half, half), zlim=(0.0, tall),
             xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]")
    # Of a tall box the floor's labels would stand in the legend.
    axes.set_box_aspect((2.0 * half, 2.0 * half, tall), zoom=0.84 if tall < 2.0 * half else 0.76)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        axis.set_major_locator(MaxNLocator(3))
    axes.zaxis.labelpad = 6.0
    axes.view_init(_ELEVATION, azimuth)
    axes.set_title(f"{cut(name)}: {frame.label}")
    drawn.legend(handles=[
        Patch(color=_LINK, label="hand"), Patch(color=_FELT, label="tip that feels"),
        Line2D([], [], ls="", marker="o", ms=2.5, color=_CONTACT, label="contacts so far")],
        loc="outside lower center", ncols=3)
    return drawn


def _hand(replay: Replay, frame: Frame) -> list[tuple[np.ndarray, str]]:
    """Quadrilaterals (face, 4, 3) of the palm and of each link, with their colours."""
    turn = Rotation.from_quat(frame.hand_turn)
    at = frame.arm_m[-1] - turn.apply([0.0, 0.0, 0.02])
    solids = [(at + turn.apply(_box(_PALM_M).reshape(-1, 3)).reshape(-1, 4, 3), _LINK),
              (_link(at - turn.apply([0.0, 0.0, _WRIST_LONG_M]), at, _WRIST_M), _LINK)]
    for points, felt in zip(frame.fingers_m, frame.felt, strict=True):
        for number, (a, b) in enumerate(pairwise(points)):
            tip = number + 2 == len(points)
            solids.append((_link(a, b, replay.link_radius_m), _FELT if tip and felt else _LINK))
    return solids


def _link(a: np.ndarray, b: np.ndarray, radius: float) -> np.ndarray:
    """A capsule from a to b, (face, 4, 3)."""
    length = float(np.linalg.norm(b - a))
    points, faces = capsule_mesh(length, radius)
    turn = Rotation.align_vectors([(b - a) / max(length, 1e-9)], [[0.0, 0.0, 1.0]])[0]
    return ((a + b) / 2 + turn.apply(points))[faces]


def _box(size: np.ndarray, parts: int = 6) -> np.ndarray:
    """The faces of a box about the origin in small quadrilaterals, (face, 4, 3)."""
    edge = np.linspace(-0.5, 0.5, parts + 1)
    u, v = np.meshgrid(edge, edge, indexing="ij")
    sides = []
    for axis in range(3):
        for end in (-0.5, 0.5):
            grid = np.insert(np.stack([u, v], -1), axis, end, axis=-1) * size
            ring = np.stack([grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]], 2)
            # Anticlockwise from outside: the middle axis and the lower ends are mirrored.
            mirrored = (end < 0) != (axis == 1)
            sides.append((ring[:, :, ::-1] if mirrored else ring).reshape(-1, 4, 3))
    return np.concatenate(sides)


def _shaded(faces: np.ndarray, tints: list[str], azimuth: float) -> np.ndarray:
    """Colours of faces in the light, (face, 3)."""
    from matplotlib.colors import to_rgb

    normal = np.cross(faces[:, 2] - faces[:, 0], faces[:, 3] - faces[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    turn, rise = np.radians([azimuth + _LIT, 1.5 * _LIT])
    sun = np.array([np.cos(turn) * np.cos(rise), np.sin(turn) * np.cos(rise), np.sin(rise)])
    light = 0.55 + 0.45 * np.clip(normal @ sun, 0.0, 1.0)
    return np.array([to_rgb(tint) for tint in tints]) * light[:, None]


def _aside(frame: Frame) -> float:
    """The azimuth [deg] from which the hand comes in from one side."""
    way = Rotation.from_quat(frame.hand_turn).apply([0.0, 0.0, 1.0])
    return float(np.degrees(np.arctan2(way[1], way[0]))) + 75.0
