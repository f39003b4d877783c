"""A hand from a URDF alone: its chains and shapes as they stand, the rest guessed and said."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.hands.hand_checks import MOST_FINGERS, NEAR, check_hand
from warpgrasp.hands.hand_frames import matrix_of, place_of
from warpgrasp.hands.hand_guesses import with_guesses
from warpgrasp.hands.hand_model import (
    STILL,
    Box,
    Capsule,
    Finger,
    HandError,
    HandJoint,
    HandModel,
    Place,
    Shape,
)
from warpgrasp.hands.urdf_chains import Chains, finger_chains
from warpgrasp.hands.urdf_shapes import shapes_of, with_capsules
from warpgrasp.hands.urdf_tree import FRAME_LINK, UrdfJoint, UrdfTree, read_urdf
from warpgrasp.parameters import HandTable

_WORDS = (("thumb", r"thumb|(^|_)th($|[^a-z])"), ("index", r"index|(^|_)ff"),
          ("middle", r"middle|(^|_)mf"), ("ring", r"ring|(^|_)rf"),
          ("little", r"little|pinky|(^|_)lf"))
"""Names of fingers, and how their links and joints are called."""
_TIP = r"tip(s|link|frame)?(?![a-z])"
"""In the name of a link that is a finger's tip, but not in "multiplier"."""
FRAMED = f"the grasp frame is the URDF's link {FRAME_LINK}"
"""What is said where it is no guess."""
_CENTRED = 0.05
"""Shapes are about their frame's origin if their middle is nearer to it than this share of their
farthest point [est]."""
_TOLD_M = 5e-6
"""Errors of fitted shapes from which on a note names them."""
_ARM = 4
"""Joints in a row that carry all fingers are an arm's from so many on, not a wrist's [est]."""


def hand_from_urdf(
    file: Path, *, palm: str | None = None, tips: Sequence[str] = (),
    held_rad: Mapping[str, float] | None = None,
) -> tuple[HandModel, tuple[str, ...]]:
    """A hand, and what was left out or changed, a sentence each.

    `palm` is the link that fingers start from, by default the root, or the link that the last joint
    of an arm moves, or one that floats; what lies before it is left out. Only chains to the links
    `tips` are fingers, by default all that end in a joint. Joints in `held_rad` stand still at
    these angles. Thumb, postures and closing path are guesses, and so is the frame of the grasp
    unless a link called `FRAME_LINK` says it. Raises HandError.
    """
    tree = read_urdf(file)
    for what, names in (("palm", [palm] if palm else []), ("tip", tips)):
        for name in names:
            if name not in tree.links:
                raise HandError(f"{file}: {what}: there is no link {name!r}; should be one of "
                                f"{', '.join(tree.links)}")
    arm = () if palm else _arm(tree, tips, held_rad or {})
    root = palm or (arm[-1].child if arm else tree.root)
    beyond = {joint.name for joint in tree.joint_to.values()
              if root in [before.parent for before in tree.path(joint.child)]}
    for name in tips:
        if not beyond.intersection(joint.name for joint in tree.path(name)):
            raise HandError(f"{file}: tip: link {name} is not beyond the palm, link {root}; should "
                            "be")
    leading = {joint.follows[0] for joint in tree.joint_to.values() if joint.follows is not None}
    turning = {joint.name: joint for joint in tree.joint_to.values()
               if joint.turns and joint.name in beyond | leading}
    for name, angle in (held_rad or {}).items():
        if name not in turning:
            raise HandError(f"{file}: hold: there is no moving joint {name!r} beyond link "
                            f"{root}; should be one of {', '.join(turning)}")
        low, high = (math.degrees(v) for v in (turning[name].low_rad, turning[name].high_rad))
        if not low - NEAR <= math.degrees(angle) <= high + NEAR:
            raise HandError(f"{file}: hold: joint {name} at {math.degrees(angle):.4g} deg; should "
                            f"be {low:.4g} to {high:.4g}")
    chains = finger_chains(tree, root, tips, held_rad or {})
    if len(chains.fingers) > MOST_FINGERS:
        raise HandError(f"{file}: {len(chains.fingers)} chains of joints lead from link {root}; "
                        f"should be 1 to {MOST_FINGERS} fingers: --palm names the palm of one of "
                        "several hands, --tip the tips of some fingers")
    names = _names(chains)
    fingers = tuple(_finger(tree, root, name, chain, chains)
                    for name, chain in zip(names, chains.fingers, strict=True))
    model = HandModel(
        tree.name, f"{file.name}, read by `warpgrasp hand`", "", STILL,
        _rigid(tree, root, chains), fingers, "", "tendons", (), ())
    where = [("palm", model.palm), *((f"joint {j.name}", j.shapes) for j in model.joints)]
    fits = tuple(f"{name}: a {'capsule' if isinstance(shape, Capsule) else 'box'} stands for a "
                 f"mesh or cylinder, off by at most {shape.fit_error_m * 1e3:.2f} mm"
                 for name, shapes in where for shape in shapes if shape.fit_error_m > _TOLD_M)
    before = {joint.name for joint in tree.path(root)}
    beside = [joint.name for joint in tree.joint_to.values()
              if joint.turns and joint.name not in beyond | before]
    said = [f"link {root} is the palm: joints beside it are left out: {', '.join(beside)}"
            ] if beside else []
    if arm:
        carry = "joint {} carries" if len(arm) == 1 else "joints {} carry"
        holds = (f"; `--palm {tree.root}` holds them instead"
                 if all(joint.usable for joint in arm) else "")
        said.append(f"{carry.format(', '.join(joint.name for joint in arm))} all fingers: link "
                    f"{root} is the palm, and what lies before it is left out{holds}")
    frame = _grasp_frame(tree, root, chains)
    if frame is None and FRAME_LINK in tree.links:
        said.append(f"link {FRAME_LINK} does not stand still on the palm: the frame is a guess")
    try:
        check_hand(model)
        guessed = with_guesses(model)
        guessed = check_hand(guessed if frame is None else replace(guessed, grasp_frame=frame))
    except HandError as error:
        raise HandError(f"{file}: {error}") from None
    return guessed, (*said, *chains.notes, *fits, *([] if frame is None else [FRAMED]))


def _arm(tree: UrdfTree, tips: Sequence[str], held_rad: Mapping[str, float]
         ) -> tuple[UrdfJoint, ...]:
    """The moving joints before all fingers, if there are as many as an arm has, or else as far as
    one that floats or slides, which no hand has; none where one is to be held."""
    arm = tree.stem(tips)
    if len(arm) < _ARM:
        arm = arm[:max((n for n, joint in enumerate(arm, 1) if not joint.usable), default=0)]
    return () if held_rad.keys() & {joint.name for joint in arm} else arm


def _grasp_frame(tree: UrdfTree, root: str, chains: Chains) -> Place | None:
    """In the palm's frame, of the link that says it; None where none is fixed to the palm."""
    joints = tree.path(FRAME_LINK)
    moving = {joint.name for chain in chains.fingers for joint in chain}
    if root not in [joint.parent for joint in joints]:
        return None
    joints = joints[len(tree.path(root)):]
    if any(joint.name in moving for joint in joints):
        return None
    frame = np.eye(4)
    for joint in joints:
        frame = frame @ _still(joint, chains)
    return place_of(frame)


def _finger(
    tree: UrdfTree, root: str, name: str, chain: tuple[UrdfJoint, ...], chains: Chains
) -> Finger:
    made: list[HandJoint] = []
    before = np.eye(4)
    stiffness = HandTable().joint_stiffness_Nm_rad
    for joint in tree.path(chain[-1].child)[len(tree.path(root)):]:
        if joint not in chain:
            before = before @ _still(joint, chains)
            continue
        x, y, z = (float(v) for v in joint.axis)
        low, high = chains.limits_rad.get(joint.name, (joint.low_rad, joint.high_rad))
        made.append(HandJoint(
            joint.name, place_of(before @ joint.origin), (x, y, z), low, high,
            joint.effort_Nm, stiffness, chains.follows.get(joint.name),
            _rigid(tree, joint.child, chains)))
        before = np.eye(4)
    x, y, z = (float(v) for v in _tip(tree, chain[-1].child, made[-1], chains))
    return Finger(name, tuple(made), (x, y, z), (made[-1].name,))


def _still(joint: UrdfJoint, chains: Chains) -> np.ndarray:
    """The frame (4, 4), in its parent's, of a link that stands still."""
    turn = np.eye(4)
    if joint.turns:
        turn[:3, :3] = Rotation.from_rotvec(chains.held_rad[joint.name] * joint.axis).as_matrix()
    return joint.origin @ turn


def _rigid(tree: UrdfTree, link: str, chains: Chains) -> tuple[Shape, ...]:
    """Shapes of a link and of all that stand still on it."""
    bodies = [(link, np.eye(4))]
    for name, frame in bodies:
        bodies += [(joint.child, frame @ _still(joint, chains)) for joint in tree.children(name)
                   if all(joint not in chain for chain in chains.fingers)
                   and joint.name not in chains.bars]
    return with_capsules([shape for name, frame in bodies
                          for shape in shapes_of(tree.file, tree.links[name], frame)])


def _tip(tree: UrdfTree, link: str, last: HandJoint, chains: Chains) -> np.ndarray:
    """In the last joint's frame (3,): the origin of a fixed link named tip, or else the point of
    the link's shapes that lies farthest out. A guess."""
    frames = [(link, np.eye(4))]
    for name, frame in frames:
        if re.search(_TIP, name.lower()) and np.linalg.norm(frame[:3, 3]) > 1e-6:
            return frame[:3, 3]
        frames += [(joint.child, frame @ _still(joint, chains)) for joint in tree.children(name)]
    if last.shapes:
        return farthest_point(last.shapes, matrix_of(last.place)[:3, :3].T @ last.place[:3])
    return max((frame[:3, 3] for _, frame in frames), key=lambda point: float(point @ point))


def farthest_point(shapes: tuple[Shape, ...], ahead: np.ndarray) -> np.ndarray:
    """The middle of the far end of shapes, seen from their frame's origin (3,) [m].

    Shapes about that origin have no end that is farther than the other: theirs is the one towards
    `ahead` (3,), where the link before leads; if that has no length, their farthest point's.
    """
    points = np.concatenate([_outline(shape) for shape in shapes])
    way, sizes = points.mean(0), np.linalg.norm(points, axis=1)
    if np.linalg.norm(way) < _CENTRED * sizes.max():
        way = ahead if np.linalg.norm(ahead) > 1e-9 else points[int(np.argmax(sizes))]
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


def _names(chains: Chains) -> list[str]:
    """A finger is called by the word in the names of its joints and links, or numbered."""
    found: list[str] = []
    for number, chain in enumerate(chains.fingers, 1):
        words = [word for joint in chain for word in (joint.child.lower(), joint.name.lower())]
        named = {name: sum(re.search(pattern, w) is not None for w in words)
                 for name, pattern in _WORDS}
        name = max(named, key=lambda name: named[name])
        name = name if named[name] else f"finger{number}"
        found.append(name if name not in found else f"finger{number}")
    return found
