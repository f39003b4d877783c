"""First guesses of what no URDF says: thumb, frame of the grasp, postures, closing path."""

from dataclasses import replace

import numpy as np

from warpgrasp.hands.hand_frames import finger_tips, matrix_of, place_of, posture_angles
from warpgrasp.hands.hand_model import (
    Box,
    HandClosing,
    HandJoint,
    HandModel,
    Place,
    Posture,
    Shape,
)

FLEXES = 1.25
"""A joint whose range is by this factor longer on one side of zero bends to that side."""
CLOSED = 0.8
"""Share of the way to its limit at which a bent joint counts as closed."""
_FIRST = 1e-3
"""Share of a closing that shows where tips go first."""
_OPPOSED = -0.5
"""Cosine between the ways of thumb and fingers below which they go against each other."""


def with_guesses(model: HandModel) -> HandModel:
    """The hand with a thumb, a frame, the postures open and closed, and a path between them."""
    bent = tuple((joint.name, CLOSED * _farther(joint)) for joint in model.driven
                 if _bends(joint))
    moves = tuple(name for name, _ in bent)
    guessed = replace(model, postures=(Posture("open", ()), Posture("closed", bent)),
                      closings=(HandClosing("grasp", "open", "closed", moves),) if moves else ())
    guessed = replace(guessed, thumb=guessed_thumb(guessed))
    return replace(guessed, grasp_frame=guessed_frame(guessed))


def guessed_thumb(model: HandModel) -> str:
    """The finger of that name, or the one whose tip goes most against the others' when the hand
    closes; none of fewer than three."""
    names = [finger.name for finger in model.fingers]
    if "thumb" in names or len(names) < 3:
        return "thumb" if "thumb" in names else ""
    open_, closed = (finger_tips(model, posture_angles(model, model.posture(name))[None])[0]
                     for name in ("open", "closed"))
    way = closed - open_
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    along = [way[n] @ np.delete(way, n, 0).mean(0) for n in range(len(way))]
    return names[int(np.argmin(along))]


def guessed_frame(model: HandModel) -> Place:
    """In the palm's frame: z is where the fingers' tips go first when the hand closes, or, if the
    thumb's tip goes the other way, where the open fingers point; x leads from the fingers' bases
    to the thumb's; the origin is the middle between them."""
    open_, closed = (posture_angles(model, model.posture(name)) for name in ("open", "closed"))
    base = np.array([finger.joints[0].place[:3] for finger in model.fingers])
    tip, after = finger_tips(model, np.stack([open_, open_ + _FIRST * (closed - open_)]))
    is_thumb = np.array([finger.name == model.thumb for finger in model.fingers])
    first, points = _unit((after - tip)[~is_thumb].mean(0)), _unit((tip - base)[~is_thumb].mean(0))
    fingers = middle = base[~is_thumb].mean(0)
    z, x = points, np.zeros(3)
    if is_thumb.any():
        middle = (fingers + base[is_thumb][0]) / 2
        x = base[is_thumb][0] - fingers
        if first @ _unit((after - tip)[is_thumb][0]) > _OPPOSED and first.any():
            z = first
    z = z if z.any() else np.array([0.0, 0.0, 1.0])
    x = _unit(x - z * (x @ z))
    if not x.any():
        x = np.eye(3)[int(np.argmin(np.abs(z)))]
        x = _unit(x - z * (x @ z))
    return place_of(np.block([[np.stack([x, np.cross(z, x), z], 1), middle[:, None]],
                              [np.array([[0.0, 0.0, 0.0, 1.0]])]]))


def farthest_point(shapes: tuple[Shape, ...]) -> np.ndarray:
    """The middle of the far end of shapes, seen from their frame's origin (3,) [m]."""
    points = np.concatenate([_outline(shape) for shape in shapes])
    way = points.mean(0)
    if np.linalg.norm(way) < 1e-9:
        way = points[int(np.argmax((points**2).sum(1)))]
    way = way / np.linalg.norm(way)
    return way * float((points @ way).max())


def _outline(shape: Shape) -> np.ndarray:
    """Corners of a box, or the six extremes of both balls of a capsule, (n, 3)."""
    if isinstance(shape, Box):
        corner = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2
        frame = matrix_of(shape.place)
        return corner * np.asarray(shape.size) @ frame[:3, :3].T + frame[:3, 3]
    ball = shape.radius * np.concatenate([np.eye(3), -np.eye(3)])
    return np.concatenate([np.asarray(end) + ball for end in (shape.start, shape.end)])


def _farther(joint: HandJoint) -> float:
    return joint.high_rad if joint.high_rad >= -joint.low_rad else joint.low_rad


def _bends(joint: HandJoint) -> bool:
    sides = sorted((abs(joint.low_rad), abs(joint.high_rad)))
    one_side = joint.low_rad >= 0.0 or joint.high_rad <= 0.0
    return one_side or sides[1] > FLEXES * sides[0]


def _unit(way: np.ndarray) -> np.ndarray:
    """A vector of length one, or zeros for one without length."""
    size = float(np.linalg.norm(way))
    return way / size if size > 1e-9 else np.zeros(3)
