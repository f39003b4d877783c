"""A URDF as a tree of links and joints, read by yourdfpy.

Raises HandError naming the file, the element, and what would be right.
"""

import difflib
import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from warpgrasp.hands.hand_model import HandError

LARGEST_BYTES = 8 * 2**20
FRAME_LINK = "grasp_frame"
"""A link without shapes, fixed to the palm, that stands in the frame of the grasp."""
NO_LIMIT_NM = 1000.0
"""Written where a joint's effort is not known, since URDF requires one, and read as such [est]."""
_NUMBERS = {"origin": ("xyz", "rpy"), "axis": ("xyz",), "mimic": ("multiplier", "offset"),
            "limit": ("lower", "upper", "effort", "velocity"), "box": ("size",),
            "cylinder": ("radius", "length"), "sphere": ("radius",), "mesh": ("scale",),
            "mass": ("value",), "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
            "dynamics": ("damping", "friction")}
"""Elements of links and joints, and which of their attributes are numbers."""
_READ = ("visual", "collision", "inertial", "origin", "axis", "limit", "mimic", "parent", "child",
         "dynamics")
"""Elements within them that are read; others are of other programs."""
_WORDS = {"link": ("collision",), "joint": ("origin", "axis", "limit", "mimic", "parent", "child"),
          "collision": ("origin", "geometry"), "limit": ("lower", "upper", "effort", "velocity"),
          "mimic": ("joint", "multiplier", "offset"), "origin": ("xyz", "rpy"), "axis": ("xyz",),
          "mesh": ("filename", "scale")}
"""What is read within elements, if it is there: elements or attributes that may be misspelt."""
_ALIKE = 0.8
"""How alike (`difflib`) a word is to one of them that it is taken to stand for."""
_COUNTS = {"xyz": (3,), "rpy": (3,), "size": (3,), "scale": (1, 3)}
"""How many numbers an attribute has, if not one."""
_SAMPLES = {"robot": {"name": "my_hand"}, "link": {"name": "palm"},
            "joint": {"name": "joint1", "type": "revolute"}, "parent": {"link": "palm"},
            "child": {"link": "link1"}, "mimic": {"joint": "joint1"},
            "box": {"size": "0.02 0.02 0.04"}, "sphere": {"radius": "0.01"},
            "cylinder": {"radius": "0.01", "length": "0.04"}, "mesh": {"filename": "link1.stl"}}
"""Attributes that elements must have, for instance."""
_SHAPES = ("box", "cylinder", "sphere", "mesh")
_LONGEST = 80
"""Characters of a name, as in a hand's file."""
_TURNING = ("revolute", "continuous")
_SLIDING = "prismatic"


@dataclass(frozen=True)
class UrdfJoint:
    """A joint between two links; `origin` (4, 4) in the parent's frame."""

    name: str
    parent: str
    child: str
    origin: np.ndarray
    kind: str
    """The file's word: revolute, continuous, fixed, or one that no hand and no arm has. A joint
    that follows another and has limits of zero, as of a form not filled in, is continuous."""
    axis: np.ndarray
    low_rad: float
    """Of a joint that slides [m]; infinite where the file does not say it."""
    high_rad: float
    effort_Nm: float
    """0 where it is not known, as `speed_rad_s`."""
    speed_rad_s: float
    follows: tuple[str, float, float] | None
    """Another joint's name, a factor, and an offset [rad]."""

    @property
    def turns(self) -> bool:
        """Whether it moves as joints of hands and arms do."""
        return self.kind in _TURNING

    @property
    def slides(self) -> bool:
        """Whether it moves along its axis; no hand has such a joint, but a robot before its arm."""
        return self.kind == _SLIDING

    @property
    def usable(self) -> bool:
        """Whether it turns or stands still."""
        return self.turns or self.kind == "fixed"


@dataclass(frozen=True)
class UrdfTree:
    """Links by name as yourdfpy has them, and the joint that leads to each but the root."""

    file: Path
    name: str
    root: str
    links: dict[str, Any]
    joint_to: dict[str, UrdfJoint]

    def children(self, link: str) -> list[UrdfJoint]:
        """The joints that start from a link, in the order of the file."""
        return [joint for joint in self.joint_to.values() if joint.parent == link]

    def path(self, link: str) -> list[UrdfJoint]:
        """The joints from the root to a link."""
        found = []
        while link in self.joint_to:
            found.append(self.joint_to[link])
            link = found[-1].parent
        return found[::-1]

    def stem(self, links: Sequence[str] = ()) -> tuple[UrdfJoint, ...]:
        """The moving joints before all `links`, by default before the last joint of every chain;
        none where only one chain moves."""
        moving = [[joint for joint in self.path(link) if joint.kind != "fixed"]
                  for link in (links or self.links)]
        inner = {joint.name for path in moving for joint in path[:-1]}
        ends = {path[-1].name: path for path in moving
                if path and (links or path[-1].name not in inner)}
        if len(ends) < 2:
            return ()
        return tuple(joints[0] for joints in zip(*ends.values(), strict=False)
                     if len({joint.name for joint in joints}) == 1)


def read_urdf(file: Path) -> UrdfTree:
    """The tree of a URDF file; meshes are not read."""
    robot = _parsed(file)
    links = {link.name: link for link in robot.links}
    if len(links) < len(robot.links):
        names = [link.name for link in robot.links]
        twice = next(name for name in names if names.count(name) > 1)
        raise HandError(f"{file}: link {twice}: the name stands for two links; names should differ")
    joint_to: dict[str, UrdfJoint] = {}
    names = set()
    for given in robot.joints:
        joint = _joint(file, given)
        if joint.name in names:
            raise HandError(f"{file}: joint {joint.name}: the name stands for two joints; names "
                            "should differ")
        names.add(joint.name)
        for end in (joint.parent, joint.child):
            if end not in links:
                raise HandError(f"{file}: joint {joint.name}: there is no link {end!r}; should be "
                                "one of the file's links")
        if joint.child in joint_to:
            raise HandError(f"{file}: joint {joint.name}: link {joint.child} is moved by joint "
                            f"{joint_to[joint.child].name} as well, a loop; a hand should be a "
                            "tree")
        joint_to[joint.child] = joint
    name = str(robot.name) or file.stem[:_LONGEST]  # a robot may have no name, a hand's file not
    return UrdfTree(file, name, _root(file, links, joint_to), links, joint_to)


def _parsed(file: Path) -> Any:
    try:
        size = file.stat().st_size
        if size > LARGEST_BYTES:
            raise HandError(f"{file}: {size / 2**20:.0f} MiB; should be at most "
                            f"{LARGEST_BYTES >> 20} MiB")
        root = ET.parse(file).getroot()
    except OSError as error:
        raise HandError(f"{file}: cannot be read: {error.strerror or error}; should be a URDF "
                        "file") from None
    except ET.ParseError as error:
        raise HandError(f"{file}: is not XML: {error}; should be a URDF file (a xacro file is made "
                        "one by `xacro FILE`)") from None
    for element in root.iter():
        if "xacro" in element.tag.partition("}")[0]:
            raise HandError(f"{file}: has a <xacro:{element.tag.rpartition('}')[2]}>; should be a "
                            "URDF, which `xacro FILE` makes of it")
    if root.tag != "robot":
        raise HandError(f"{file}: begins with <{root.tag}>; should be a URDF, which begins with "
                        "<robot>")
    try:
        from yourdfpy import URDF
    except ImportError:
        raise HandError(f"{file}: reading a URDF needs yourdfpy: run `pip install '.[hands]'` in "
                        "the clone") from None
    # The reader's own messages name no element.
    _check_element(f"{file}: the robot", root)
    for kind in ("link", "joint"):
        for n, element in enumerate(root.findall(kind), 1):
            name = element.get("name", "")
            where = f"{file}: {kind} {name if name.isprintable() and name else f'number {n}'}"
            if kind == "joint" and None in (element.find("parent"), element.find("child")):
                raise HandError(f"{where}: has no parent or no child; should have both")
            _check_element(where, element)
            for part in (inner for own in element if own.tag in _READ for inner in own.iter()):
                _check_element(where, part)
    try:
        with np.errstate(all="ignore"):  # numbers that are not finite are refused later, by name
            return URDF.load(str(file), build_scene_graph=False, load_meshes=False).robot
    except Exception as error:  # whatever the reader comes upon in a file of anyone's
        raise HandError(f"{file}: cannot be read as a URDF: {type(error).__name__}: {error}; "
                        "should be as wiki.ros.org/urdf/XML says") from None


def _check_element(where: str, part: ET.Element) -> None:
    """Raises HandError where an attribute is missing, or is not the numbers that it should be."""
    for key in (sample := _SAMPLES.get(part.tag, {})):
        value = part.get(key)
        if value is None or (value == "" and part.tag != "robot"):  # a robot may have no name
            like = " ".join(f'{k}="{v}"' for k, v in sample.items())
            raise HandError(f"{where}: <{part.tag}> without {key}; should have it, as in "
                            f"<{part.tag} {like}>")
    known = _WORDS.get(part.tag, ())
    for word in [*part.keys(), *(inner.tag for inner in part)]:
        meant = difflib.get_close_matches(word, known, 1, _ALIKE)
        if meant and word not in known:
            raise HandError(f"{where}: <{part.tag}> with {word}; did you mean {meant[0]}?")
    name = part.get("name", "") if part.tag in ("robot", "joint") else ""
    if len(name) > _LONGEST or not name.isprintable():
        raise HandError(f"{where}: its name has {len(name)} characters; should have at most "
                        f"{_LONGEST}, without line breaks")
    for key in _NUMBERS.get(part.tag, ()):
        if (text := part.get(key)) is None:
            continue
        counts = _COUNTS.get(key, (1,))
        wanted = "a number" if counts == (1,) else " or ".join(map(str, counts)) + " numbers"
        try:
            right = len([float(word) for word in text.split()]) in counts
        except ValueError:
            right = False
        if not right:
            raise HandError(f'{where}: {key}="{text}" of <{part.tag}>; should be {wanted}, with '
                            "points in them and blanks between them")
    if part.tag in ("collision", "visual") and part.find("geometry") is None:
        raise HandError(f"{where}: <{part.tag}> without geometry; should have a shape")
    if part.tag == "geometry" and [shape.tag for shape in part][:1] not in [[s] for s in _SHAPES]:
        what = f"a <{part[0].tag}>" if len(part) else "no shape"
        remedy = ("a cylinder and a sphere as thick at each of its ends"
                  if len(part) and part[0].tag == "capsule" else f"one of {', '.join(_SHAPES)}")
        raise HandError(f"{where}: <geometry> with {what}; should have {remedy}")


def _joint(file: Path, given: Any) -> UrdfJoint:
    where = f"{file}: joint {given.name}"
    origin = np.eye(4) if given.origin is None else np.asarray(given.origin, float)
    axis = np.asarray(given.axis, float)
    if origin.shape != (4, 4) or axis.shape != (3,) or not (
            np.isfinite(origin).all() and np.isfinite(axis).all()):
        raise HandError(f"{where}: origin or axis is not of three finite numbers; should be, as in "
                        '<axis xyz="0 0 1"/>')
    kind = str(given.type)
    turns = kind in _TURNING
    low, high, effort, speed = -math.pi, math.pi, 0.0, 0.0
    size = float(np.linalg.norm(axis))
    if turns and size < 1e-9:
        raise HandError(f"{where}: its axis has no length; should be a direction")
    axis = axis / max(size, 1e-9)
    if turns:
        limit = given.limit
        if limit is not None:
            effort, speed = float(limit.effort or 0.0), float(limit.velocity or 0.0)
            effort = effort if effort < NO_LIMIT_NM else 0.0
        if kind == "revolute":
            if limit is None:
                raise HandError(f"{where}: has no limit; should have lower and upper [rad]")
            low, high = float(limit.lower or 0.0), float(limit.upper or 0.0)
            if low == high == 0.0 and given.mimic is not None:  # not filled in: as far as it is led
                kind, low, high = "continuous", -math.pi, math.pi
            if not low < high:
                raise HandError(f"{where}: limits from {low:g} to {high:g} rad; lower should be "
                                "less than upper, or the joint fixed")
    elif kind == _SLIDING:
        known = given.limit is not None
        low = float(given.limit.lower or 0.0) if known else -math.inf
        high = float(given.limit.upper or 0.0) if known else math.inf
    follows = None
    if turns and given.mimic is not None:
        mimic = given.mimic
        follows = (str(mimic.joint), float(mimic.multiplier), float(mimic.offset))
        if not np.isfinite(follows[1:]).all():
            raise HandError(f"{where}: multiplier or offset of its mimic is not finite; should be")
    return UrdfJoint(given.name, given.parent, given.child, origin, kind, axis, low, high, effort,
                     speed, follows)


def _root(file: Path, links: dict[str, Any], joint_to: dict[str, UrdfJoint]) -> str:
    if not links:
        raise HandError(f"{file}: has no links; should be a tree of links and joints")
    roots = [name for name in links if name not in joint_to]
    if not roots:
        raise HandError(f"{file}: every link is moved by a joint, a loop; a hand should be a tree")
    if len(roots) > 1:
        raise HandError(f"{file}: links {', '.join(roots[:4])} are moved by no joint; all but "
                        "one should be joined to the hand")
    for name in links:
        seen = set()
        while name in joint_to:
            if name in seen:
                raise HandError(f"{file}: joint {joint_to[name].name}: is part of a loop; a hand "
                                "should be a tree")
            seen.add(name)
            name = joint_to[name].parent
    return roots[0]
