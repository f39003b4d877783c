"""An arm from a URDF: the joints on the way from its root to a link that carries the hand."""

import math
from pathlib import Path

import numpy as np

from warpgrasp.arms.arm_file import check_arm
from warpgrasp.arms.arm_model import ARM_JOINTS, ArmError, ArmJoint, ArmModel, Vector
from warpgrasp.hands.hand_frames import fixed_angles
from warpgrasp.hands.urdf_tree import UrdfJoint, UrdfTree, read_urdf

_SPEED_RAD_S = math.pi / 2
"""Of a joint whose speed the file does not say [est]."""
_NAMED = 4
"""Links that a note names at most."""


def arm_from_urdf(file: Path, *, flange: str | None = None) -> tuple[ArmModel, tuple[str, ...]]:
    """An arm, and what was guessed, a sentence each.

    The hand is mounted on the link `flange`, along its z axis; by default the first link after the
    last joint of the only chain of 6 or 7 joints. Home is in the middle of the limits. Raises
    HandError for a file that is no tree of joints, ArmError for one that is no arm.
    """
    tree = read_urdf(file)
    link = _flange(tree) if flange is None else flange
    if link not in tree.links:
        raise ArmError(f"{file}: flange: there is no link {link!r}; should be one of "
                       f"{', '.join(tree.links)}")
    notes = []
    if flange is None:
        beyond = [name for name in tree.links if link in {j.parent for j in tree.path(name)}]
        more = f" and {len(beyond) - _NAMED} more" if len(beyond) > _NAMED else ""
        left = f"; {', '.join(beyond[:_NAMED])}{more} beyond it left out" if beyond else ""
        notes.append(f"link {link} carries the hand, the last of the only chain of 6 or "
                     f"{ARM_JOINTS} joints{left}; --flange names another link")
    joints, before = [], np.eye(4)
    for joint in tree.path(link):
        if not joint.usable:
            raise ArmError(f"{file}: joint {joint.name}: is {joint.kind}; joints of an arm, before "
                           f"link {link}, should be revolute, continuous or fixed")
        if joint.turns and joint.follows is None:
            xyz, rpy = _place(before @ joint.origin)
            if joint.speed_rad_s <= 0.0:
                notes.append(f"joint {joint.name}: no speed; {math.degrees(_SPEED_RAD_S):g} deg/s "
                             "is a guess")
            joints.append(_arm_joint(file, joint, xyz, rpy))
            before = np.eye(4)
        elif joint.turns:
            raise ArmError(f"{file}: joint {joint.name}: follows another joint; joints of an arm "
                           "should each be driven")
        else:
            before = before @ joint.origin
    if not 6 <= len(joints) <= ARM_JOINTS:
        raise ArmError(f"{file}: {len(joints)} joints lead to link {link}; should be 6 or "
                       f"{ARM_JOINTS}; --flange names another link")
    xyz, rpy = _place(before)
    notes.append("home is in the middle of the joints' limits, and the base stands at the origin")
    home = tuple(min(max(0.0, joint.low_rad), joint.high_rad)
                 if joint.high_rad - joint.low_rad > 2 * math.pi
                 else (joint.low_rad + joint.high_rad) / 2 for joint in joints)
    still = (0.0, 0.0, 0.0)
    return check_arm(str(file), ArmModel(tree.name, tuple(joints), still, still, xyz, rpy, home,
                                         file.name)), tuple(notes)


def _flange(tree: UrdfTree) -> str:
    """The link after the last joint of the only chain that is an arm."""
    found = {}
    for link in tree.links:
        path = [joint for joint in tree.path(link) if joint.turns]
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
