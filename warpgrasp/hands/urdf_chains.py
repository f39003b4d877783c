"""Which joints of a URDF make fingers, and which stand still."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from warpgrasp.hands.hand_model import Follow, HandError
from warpgrasp.hands.urdf_tree import UrdfJoint, UrdfTree


@dataclass(frozen=True)
class Chains:
    """The moving joints of each finger from the palm outwards; the angles of those that stand
    still; the joints that follow others; and what was decided, a sentence each."""

    fingers: tuple[tuple[UrdfJoint, ...], ...]
    held_rad: Mapping[str, float]
    follows: Mapping[str, Follow]
    notes: tuple[str, ...]


def finger_chains(
    tree: UrdfTree, palm: str, tips: Sequence[str], held_rad: Mapping[str, float]
) -> Chains:
    """A finger is a chain from the palm to a link of `tips`, or, without, to a joint that moves no
    other. Joints that move several fingers, as a wrist's, are held, and so are all others.

    Raises HandError where there is no finger, or a joint follows one that there is not.
    """
    held, notes = dict(held_rad), []
    before = len(tree.path(palm))
    paths = {link: tree.path(link)[before:] for link in tree.links
             if palm == link or palm in [joint.parent for joint in tree.path(link)]}
    moving = {link: [joint for joint in path if joint.turns and joint.name not in held]
              for link, path in paths.items()}
    inner = {joint.name for path in moving.values() for joint in path[:-1]}
    ends = {path[-1].name: path for link, path in moving.items()
            if path and (link in tips if tips else path[-1].name not in inner)}
    if not ends:
        named = " leads to a tip that is named" if tips else ""
        raise HandError(f"{tree.file}: no moving joint beyond link {palm}{named}; a hand should "
                        "have a finger")
    count = [joint.name for path in ends.values() for joint in path]
    all_moving = {joint.name: joint for path in moving.values() for joint in path}
    for name, joint in all_moving.items():
        if count.count(name) != 1:
            held[name] = min(max(0.0, joint.low_rad), joint.high_rad)
            why = "moves several fingers" if name in count else "is in no finger"
            notes.append(f"joint {name} {why}: it is held at {math.degrees(held[name]):.4g} deg")
    known = {joint.name: joint for joint in tree.joint_to.values()}
    follows = {name: _followed(tree, known, known[name]) for name in count
               if known[name].follows is not None and name not in held}
    for name, follow in list(follows.items()):
        if follow.joint in held or follow.joint not in count:
            held[name] = follow.factor * held.get(follow.joint, 0.0) + follow.offset_rad
            notes.append(f"joint {name} follows {follow.joint}, which stands still: so does it")
            del follows[name]
    fingers = [tuple(joint for joint in path if joint.name not in held) for path in ends.values()]
    if not any(fingers):
        raise HandError(f"{tree.file}: every joint beyond link {palm} is held; a hand should have "
                        "a finger that moves")
    return Chains(tuple(finger for finger in fingers if finger), held, follows, tuple(notes))


def _followed(tree: UrdfTree, known: Mapping[str, UrdfJoint], joint: UrdfJoint) -> Follow:
    """The driven joint at the end of a row of joints that follow one another."""
    factor, offset, seen, now = 1.0, 0.0, {joint.name}, joint
    while now.follows is not None:
        name, times, plus = now.follows
        where = f"{tree.file}: joint {now.name}"
        if name not in known or not known[name].turns:
            raise HandError(f"{where}: follows {name!r}; mimic should name a joint that turns")
        if name in seen:
            raise HandError(f"{where}: follows itself by way of {name}; mimic should lead to a "
                            "driven joint")
        factor, offset, now = factor * times, offset + factor * plus, known[name]
        seen.add(name)
    return Follow(now.name, factor, offset)
