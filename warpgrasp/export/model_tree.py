"""Any hand as a tree of joints and links for other simulators, alone or on the arm.

The hand's frame is its `grasp_frame`; a link is called after the joint that moves it.
"""

from collections.abc import Sequence, Set
from dataclasses import replace
from xml.sax.saxutils import escape

import numpy as np

from warpgrasp.export.robot_tree import STILL, Joint, Link, arm_tree, flange_link
from warpgrasp.hands.hand_frames import matrix_of, place_of
from warpgrasp.hands.hand_model import Box, Capsule, Follow, HandJoint, HandModel, Shape
from warpgrasp.hands.urdf_tree import FRAME_LINK
from warpgrasp.parameters import ArmTable


def hand_model_tree(
    model: HandModel, *, parent: str = "", place: Sequence[float] = STILL
) -> list[Link]:
    """The palm, a link in the hand's frame, and every link and tip of the fingers; `place` of the
    hand's frame in `parent`.

    Names are escaped, ready to stand in an attribute of XML.
    """
    x, y, z, a, b, c, d = place
    palm = matrix_of((x, y, z, a, b, c, d)) @ np.linalg.inv(matrix_of(model.grasp_frame))
    links = [Link("palm", parent, place_of(palm), None, *_shapes(model.palm)),
             Link(FRAME_LINK, "palm", model.grasp_frame)]
    for finger in model.fingers:
        above = "palm"
        for joint in finger.joints:
            name = f"{_name(joint.name)}_link"
            links.append(Link(name, above, joint.place, _hinge(joint), *_shapes(joint.shapes)))
            above = name
        links.append(Link(f"{_name(finger.name)}_tip", above, (*finger.tip_m, *STILL[3:])))
    return links


def arm_model_tree(arm: ArmTable, model: HandModel, mount_length_m: float) -> list[Link]:
    """The arm in its base frame with a hand, the hand's frame `mount_length_m` from the flange.

    A joint of the arm that is called as one of the hand's gets `carrying_` before its name.
    """
    links, place = arm_tree(arm, mount_length_m)
    carried = [flange_link(links[-1].name, place, mount_length_m),
               *hand_model_tree(model, parent=links[-1].name, place=place)]
    taken = {link.joint.name for link in carried if link.joint is not None}
    return [_renamed(link, taken) for link in links] + carried


def _renamed(link: Link, taken: Set[str]) -> Link:
    """The link, its joint under a name that is none of `taken`."""
    if link.joint is None:
        return link
    name = link.joint.name
    while name in taken:
        name = f"carrying_{name}"
    return replace(link, joint=replace(link.joint, name=name))


def _hinge(joint: HandJoint) -> Joint:
    follows = joint.follows and Follow(_name(joint.follows.joint), joint.follows.factor,
                                       joint.follows.offset_rad)
    return Joint(_name(joint.name), joint.axis, joint.low_rad, joint.high_rad,
                 joint.stiffness_Nm_rad, joint.effort_Nm, follows)


def _shapes(shapes: tuple[Shape, ...]) -> tuple[tuple[Capsule, ...], tuple[Box, ...]]:
    return (tuple(shape for shape in shapes if isinstance(shape, Capsule)),
            tuple(shape for shape in shapes if isinstance(shape, Box)))


def _name(text: str) -> str:
    return escape(text, {'"': "&quot;"})
