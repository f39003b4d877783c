"""An arm from a URDF: the joints on the way from its root to a link that carries the hand."""

import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.arms.arm_file import check_arm
from warpgrasp.arms.arm_model import ARM_JOINTS, ArmError, ArmJoint, ArmModel, Vector
from warpgrasp.hands.hand_frames import fixed_angles, matrix_of
from warpgrasp.hands.hand_model import HandModel
from warpgrasp.hands.urdf_tree import UrdfJoint, UrdfTree, read_urdf
from warpgrasp.parameters import HandTable

_SPEED_RAD_S = math.pi / 2
"""Of a joint whose speed the file does not say [est]."""
_NAMED = 4
"""Links that a note names at most."""
_SLACK = 1e-9
"""By which a held joint may be beyond its limits [rad, m], as numbers are rounded."""
_ON_AXIS_M, _ALIKE = 0.001, 0.999
"""So near the last joint's axis a flange stands, and so near (cosine) its z axis is to it."""
_FLANGE_M = 0.13
"""A link farther out than this is no flange but the tip of a tool [est]."""
_GRIPPER = re.compile("grip|finger|thumb|jaw|claw|knuckle")
"""In the names of joints, or of links that they move, that are a gripper's and not the arm's."""


def arm_from_urdf(
    file: Path, *, flange: str | None = None, held_deg_mm: Mapping[str, float] | None = None,
    hand: HandModel | None = None,
) -> tuple[ArmModel, tuple[str, ...]]:
    """An arm, and what was guessed, a sentence each.

    The hand is mounted on the link `flange`, along its z axis; by default beyond the last joint
    that leads to all fingers, or the last joint of the only chain of 6 or 7 joints, a gripper's
    joints left out, where the hand looks out of the arm along that joint's axis (`_mounting`).
    Joints in `held_deg_mm` stand still there [deg; mm of one that slides]. `hand` is one whose
    palm's frame is that link's, as of a robot with arm and hand in one file: the flange then stands
    behind its grasp frame, by `HandTable`'s mount length.
    Home is in the middle of the limits. Raises HandError for a file that is no tree of joints,
    ArmError for one that is no arm.
    """
    tree = read_urdf(file)
    held = _held(tree, held_deg_mm or {})
    link = _flange(tree, held) if flange is None else flange
    if link not in tree.links:
        raise ArmError(f"{file}: flange: there is no link {link!r}; should be one of "
                       f"{', '.join(tree.links)}")
    if idle := held.keys() - {joint.name for joint in tree.path(link)}:
        raise ArmError(f"{file}: hold: joint {min(idle)} is not before link {link}, which carries "
                       "the hand: where it stands changes nothing; leave it out")
    notes, turned = [], ""
    mount = np.eye(4)
    if flange is None:
        if hand is None:
            link, mount, turned = _mounting(tree, link)
        beyond = [name for name in tree.links if link in {j.parent for j in tree.path(name)}]
        more = f" and {len(beyond) - _NAMED} more" if len(beyond) > _NAMED else ""
        left = f"; {', '.join(beyond[:_NAMED])}{more} beyond it left out" if beyond else ""
        left += turned
        notes.append(f"link {link} carries the hand, the last of the only chain of 6 or "
                     f"{ARM_JOINTS} joints{left}; --flange names another link")
    joints, before = [], np.eye(4)
    for joint in tree.path(link):
        before = before @ joint.origin
        if joint.name in held:
            before = before @ _moved(joint, held[joint.name])
        elif not joint.usable:
            raise ArmError(f"{file}: joint {joint.name}: is {joint.kind}; joints of an arm, before "
                           f"link {link}, should be revolute, continuous or fixed, or held by "
                           "--hold")
        elif joint.turns and joint.follows is None:
            xyz, rpy = _place(before)
            if joint.speed_rad_s <= 0.0:
                notes.append(f"joint {joint.name}: no speed; {math.degrees(_SPEED_RAD_S):g} deg/s "
                             "is a guess")
            joints.append(_arm_joint(file, joint, xyz, rpy))
            before = np.eye(4)
        elif joint.turns:
            raise ArmError(f"{file}: joint {joint.name}: follows another joint; joints of an arm "
                           "should each be driven, or held by --hold")
    if not 6 <= len(joints) <= ARM_JOINTS:
        raise ArmError(f"{file}: {len(joints)} joints lead to link {link}; should be 6 or "
                       f"{ARM_JOINTS}; --flange names another link, --hold holds a joint")
    before = before @ mount
    if hand is not None:
        behind = HandTable().mount_length_m
        before = before @ matrix_of(hand.grasp_frame) @ _along(np.array([0.0, 0.0, -behind]))
        notes.append(f"the palm's frame of hand {hand.name} is that of link {link}; the flange is "
                     f"{behind * 1e3:g} mm (hand.mount_length_mm) behind its grasp frame")
    xyz, rpy = _place(before)
    notes.append("home is in the middle of the joints' limits, and the base stands at the origin")
    home = tuple(min(max(0.0, joint.low_rad), joint.high_rad)
                 if joint.high_rad - joint.low_rad > 2 * math.pi
                 else (joint.low_rad + joint.high_rad) / 2 for joint in joints)
    still = (0.0, 0.0, 0.0)
    return check_arm(str(file), ArmModel(tree.name, tuple(joints), still, still, xyz, rpy, home,
                                         file.name)), tuple(notes)


def _flange(tree: UrdfTree, held: Mapping[str, float]) -> str:
    """The link after the last joint that leads to all fingers, or of the only chain that is an
    arm."""
    stem = _of_arm(tree.stem(), held)
    if len(stem) > ARM_JOINTS:
        raise ArmError(f"{tree.file}: {len(stem)} joints lead to all that move beyond them "
                       f"({', '.join(joint.name for joint in stem)}); should be 6 or {ARM_JOINTS}; "
                       "--flange should name the link that carries the hand, and --hold joints "
                       "before it that stand still, such as a hand's wrist")
    if len(stem) >= 6:
        return stem[-1].child
    found = {}
    for link in tree.links:
        path = _of_arm(tree.path(link), held)
        if len(path) in (6, ARM_JOINTS):
            found.setdefault(path[-1].name, path[-1].child)
    longest = [link for link in found.values() if not any(
        other != link and link in {joint.child for joint in tree.path(other)}
        for other in found.values())]
    if len(longest) != 1:
        what = "no chain" if not longest else f"several chains ({', '.join(sorted(longest)[:4])})"
        raise ArmError(f"{tree.file}: {what} of 6 or {ARM_JOINTS} joints; --flange should name the "
                       "link that carries the hand")
    return longest[0]


def _mounting(tree: UrdfTree, link: str) -> tuple[str, np.ndarray, str]:
    """The link that carries the hand of an arm whose last joint moves `link`, the flange's frame
    (4, 4) in that link's, and what a note says of it.

    A hand looks out of the arm along the axis of the last joint: to where what is beyond it lies,
    or away from the joint before. So it is carried by the first link fixed to `link` that stands on
    this axis farther out, with its z axis along it; else by `link` itself, turned that way.
    """
    path = [joint for joint in tree.path(link) if joint.turns]
    frames, fixed, beyond = {link: np.eye(4)}, [link], tree.children(link)
    for joint in beyond:
        frames[joint.child] = frames[joint.parent] @ joint.origin
        beyond += tree.children(joint.child)  # looked at in turn
        if joint.kind == "fixed" and joint.parent in fixed and not _GRIPPER.search(
                joint.child.lower()):
            fixed.append(joint.child)
    axis, before = path[-1].axis, np.eye(4)
    for joint in tree.path(link)[::-1]:
        if joint is path[-2]:
            break
        before = joint.origin @ before
    ways = [float(axis @ frame[:3, 3]) for frame in frames.values()]
    way = max(ways, key=abs)
    if abs(way) < _ON_AXIS_M:
        way = float(axis @ before[:3, :3].T @ before[:3, 3])
    if abs(way) < _ON_AXIS_M:
        return link, np.eye(4), ""
    out = math.copysign(1.0, way) * axis
    along = [name for name in fixed if frames[name][:3, 2] @ out > _ALIKE and np.linalg.norm(
        np.cross(frames[name][:3, 3], out)) < _ON_AXIS_M]
    farther = [name for name in along if _ON_AXIS_M < frames[name][:3, 3] @ out < _FLANGE_M]
    along = [name for name in along if abs(frames[name][:3, 3] @ out) < _ON_AXIS_M]
    for name in farther or along:
        return name, np.eye(4), ""
    turn = np.eye(4)
    turn[:3, :3] = Rotation.align_vectors(out[None], np.array([[0.0, 0.0, 1.0]]))[0].as_matrix()
    return link, turn, ("; its z axis does not lead out of the arm, and the flange is turned from "
                        "it: a guess")


def _of_arm(path: Sequence[UrdfJoint], held: Mapping[str, float]) -> list[UrdfJoint]:
    """The joints of a path that turn and are not held, up to the first of a gripper."""
    found = []
    for joint in path:
        if not joint.turns or joint.name in held:
            continue
        if _GRIPPER.search(f"{joint.name} {joint.child}".lower()):
            break
        found.append(joint)
    return found


def _held(tree: UrdfTree, held_deg_mm: Mapping[str, float]) -> dict[str, float]:
    """Where joints stand still [rad; m of one that slides], within their limits."""
    moving = {joint.name: joint for joint in tree.joint_to.values() if joint.turns or joint.slides}
    found = {}
    for name, at in held_deg_mm.items():
        if name not in moving:
            raise ArmError(f"{tree.file}: hold: no joint {name!r} turns or slides; should be one "
                           f"of {', '.join(moving)}")
        joint = moving[name]
        scale, unit = (1e3, "mm") if joint.slides else (180.0 / math.pi, "deg")
        found[name] = at / scale
        if not joint.low_rad - _SLACK <= found[name] <= joint.high_rad + _SLACK:
            raise ArmError(f"{tree.file}: hold: joint {name} at {at:.4g} {unit}; should be "
                           f"{joint.low_rad * scale:.4g} to {joint.high_rad * scale:.4g}")
    return found


def _moved(joint: UrdfJoint, at: float) -> np.ndarray:
    """What a joint that stands still at an angle [rad], or a way [m], does to its frame (4, 4)."""
    if joint.slides:
        return _along(at * joint.axis)
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_rotvec(at * joint.axis).as_matrix()
    return turn


def _along(way: np.ndarray) -> np.ndarray:
    moved = np.eye(4)
    moved[:3, 3] = way
    return moved


def _arm_joint(file: Path, joint: UrdfJoint, xyz: Vector, rpy: Vector) -> ArmJoint:
    if not (math.isfinite(joint.low_rad) and math.isfinite(joint.high_rad)):
        raise ArmError(f"{file}: joint {joint.name}: limits from {joint.low_rad:g} to "
                       f"{joint.high_rad:g} rad; should be finite, or the joint continuous")
    if not math.isfinite(joint.speed_rad_s):
        raise ArmError(f"{file}: joint {joint.name}: limit velocity is {joint.speed_rad_s:g}; "
                       "should be a finite number [rad/s], or 0 where it is not known")
    x, y, z = (float(v) for v in joint.axis)
    return ArmJoint(joint.name, xyz, rpy, (x, y, z), joint.low_rad, joint.high_rad,
                    joint.speed_rad_s or _SPEED_RAD_S)


def _place(matrix: np.ndarray) -> tuple[Vector, Vector]:
    x, y, z = (float(v) for v in matrix[:3, 3])
    return (x, y, z), fixed_angles(matrix[:3, :3])
