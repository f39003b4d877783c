"""A picture of a hand's shapes in its postures, from two sides, as its model has them."""

from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from sweeps.figures.solids import direction, lit, set_box
from sweeps.figures.style import COLUMN_IN, cut, drawing, figure
from warpgrasp.hands.hand_frames import finger_tips, link_frames, matrix_of, posture_angles
from warpgrasp.hands.hand_model import Box, Capsule, HandModel, Shape

if TYPE_CHECKING:
    from matplotlib.figure import Figure
_PALM, _FINGER, _THUMB, _TIP = "#9a9a9a", "#6d8ab8", "#E69F00", "#b2182b"
_AXES = {"x": (0, "#CC79A7"), "approach (z)": (2, "#009E73")}
"""Of the frame of the grasp that are drawn: which, and in which colour."""
_AXIS_RADIUS_M = 0.002
_ELEVATION_DEG = 15.0
_SIDES = {"": -60.0, ", from behind": 120.0}
"""What is said of each side that the hand is seen from, and its azimuth [deg]: fingers that point
away from one are hidden by the palm."""


@drawing()
def hand_picture(model: HandModel) -> "Figure":
    """The hand in each of its first two postures, seen from two sides, in the frame of the grasp,
    [mm]: z is the approach, x points to the thumb, both drawn as rods from the origin; a red ball
    marks each tip."""
    from matplotlib.patches import Patch
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    drawn = figure(2 * COLUMN_IN, 2 * COLUMN_IN)
    shown = model.postures[:2]
    solids = [posture_solids(model, posture_angles(model, posture)) for posture in shown]
    corners = np.concatenate([faces.reshape(-1, 3) for one in solids for faces, _ in one])
    rods = axis_solids(0.6 * float(np.ptp(corners, axis=0).max()))
    corners = np.concatenate([corners, *(faces.reshape(-1, 3) for faces, _ in rods)])
    middle, half = (corners.min(0) + corners.max(0)) / 2, 1.05 * np.ptp(corners, axis=0).max() / 2
    views = product(_SIDES.items(), zip(shown, solids, strict=True))
    for number, ((side, azimuth), (posture, one)) in enumerate(views, 1):
        axes: Any = drawn.add_subplot(len(_SIDES), len(shown), number, projection="3d")
        one = [*one, *rods]
        colours = np.concatenate([lit(faces, tint, direction(azimuth + 35.0, 50.0))
                                  for faces, tint in one])
        axes.add_collection3d(Poly3DCollection(
            [1e3 * face for faces, _ in one for face in faces], facecolors=colours,
            edgecolors=colours, linewidths=0.2, zsort="average"), autolim=False)
        set_box(axes, 1e3 * (middle - half), 1e3 * (middle + half), 0.85)
        axes.view_init(_ELEVATION_DEG, azimuth)
        axes.set_title(f"{cut(model.name)}: {posture.name}{side}")
    drawn.legend(handles=[*(Patch(color=tint, label=name) for name, (_, tint) in _AXES.items()),
                          Patch(color=_TIP, label="tip")], loc="outside lower center", ncols=3)
    return drawn


def axis_solids(length_m: float) -> list[tuple[np.ndarray, str]]:
    """Triangles (face, 3, 3) of rods along axes of the frame of the grasp, and their colours."""
    return [(_placed(np.eye(4), Capsule((0.0, 0.0, 0.0), tuple(length_m * np.eye(3)[axis]),
                                        _AXIS_RADIUS_M)), tint) for axis, tint in _AXES.values()]


def posture_solids(model: HandModel, q_rad: np.ndarray) -> list[tuple[np.ndarray, str]]:
    """Triangles (face, 3, 3) [m] of each shape in the frame of the grasp, and their colours."""
    to_grasp = np.linalg.inv(matrix_of(model.grasp_frame))
    solids = [(_placed(to_grasp, shape), _PALM) for shape in model.palm]
    for finger, frames in zip(model.fingers, link_frames(model, q_rad[None]), strict=True):
        tint = _THUMB if finger.name == model.thumb else _FINGER
        solids += [(_placed(to_grasp @ frame, shape), tint)
                   for joint, frame in zip(finger.joints, frames[0], strict=True)
                   for shape in joint.shapes]
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.003).triangles
    solids += [(ball + to_grasp[:3, :3] @ tip + to_grasp[:3, 3], _TIP)
               for tip in finger_tips(model, q_rad[None])[0]]
    return solids


def _placed(frame: np.ndarray, shape: Shape) -> np.ndarray:
    """Triangles (face, 3, 3) of a shape in a link's frame (4, 4), moved with it."""
    if isinstance(shape, Box):
        mesh = trimesh.creation.box(extents=shape.size)
        at = frame @ matrix_of(shape.place)
    else:
        start, along = np.asarray(shape.start), np.subtract(shape.end, shape.start)
        length = float(np.linalg.norm(along))
        mesh = trimesh.creation.capsule(length, shape.radius, count=(8, 12))
        at = np.eye(4)
        at[:3, 3] = start + along / 2
        if length > 0.0:
            at[:3, :3] = Rotation.align_vectors([along / length], [[0.0, 0.0, 1.0]])[0].as_matrix()
        at = frame @ at
    return (np.asarray(mesh.vertices) @ at[:3, :3].T + at[:3, 3])[mesh.faces]
