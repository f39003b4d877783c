"""Which joints of a URDF make fingers, and which stand still."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from warpgrasp.hands.hand_checks import NEAR
from warpgrasp.hands.hand_model import UNITS_OF_FILES, Follow, HandError
from warpgrasp.hands.urdf_tree import UrdfJoint, UrdfTree

_MOST_OFFSET_RAD = 6.3
"""Of a joint from the one that it follows."""
_LEAST_RAD = 1e-6
"""Between a joint's limits, where one that leads it does not turn it."""


@dataclass(frozen=True)
class Chains:
    """The moving joints of each finger from the palm outwards; the angles of those that stand
    still; the joints that follow others; and what was decided, a sentence each."""

    fingers: tuple[tuple[UrdfJoint, ...], ...]
    limits_rad: Mapping[str, tuple[float, float]]
    """Where they are not the file's, so that joints and those that follow them agree."""
    held_rad: Mapping[str, float]
    follows: Mapping[str, Follow]
    notes: tuple[str, ...]


def finger_chains(
    tree: UrdfTree, palm: str, tips: Sequence[str], held_rad: Mapping[str, float]
) -> Chains:
    """A finger is a chain from the palm to a link of `tips`, or, without, to a joint that moves no
    other. Joints that move several fingers, as a wrist's, are held, and so are all others.

    Raises HandError where there is no finger, where a joint follows one that there is not, and
    where one beyond the palm neither turns nor is fixed.
    """
    held, notes = dict(held_rad), []
    before = len(tree.path(palm))
    paths = {link: tree.path(link)[before:] for link in tree.links
             if palm == link or palm in [joint.parent for joint in tree.path(link)]}
    for joint in (joint for path in paths.values() for joint in path):
        if not joint.usable:
            raise HandError(f"{tree.file}: joint {joint.name}: is {joint.kind}; joints of a hand, "
                            f"beyond link {palm}, should be revolute, continuous or fixed")
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
    known = {joint.name: joint for joint in tree.joint_to.values()}

    def stands(name: str) -> float:
        """Where a joint is held, or else its angle nearest to zero [rad]."""
        return held.get(name, min(max(0.0, known[name].low_rad), known[name].high_rad))

    loose = [name for name in all_moving if count.count(name) != 1]
    led = {name: _followed(tree, known, known[name], held) for name in loose}
    held |= {name: follow.factor * stands(follow.joint) + follow.offset_rad
             for name, follow in led.items()}
    for name, follow in led.items():
        why = "moves several fingers" if name in count else "is in no finger"
        notes.append(f"joint {name} {why}: it is held at {_degrees(held[name])} deg"
                     + (f", as it follows {follow.joint}" if follow.joint != name else ""))
    follows = {name: _followed(tree, known, known[name], held) for name in count
               if known[name].follows is not None and name not in held}
    for name, follow in list(follows.items()):
        if follow.joint in held or follow.joint not in count:
            held[name] = follow.factor * stands(follow.joint) + follow.offset_rad
            notes.append(f"joint {name} follows {follow.joint}, which stands still: so does it, at "
                         f"{_degrees(held[name])} deg")
            del follows[name]
    limits, said = _narrowed(known, follows)
    fingers = [tuple(joint for joint in path if joint.name not in held) for path in ends.values()]
    if not any(fingers):
        raise HandError(f"{tree.file}: every joint beyond link {palm} is held; a hand should have "
                        "a finger that moves")
    return Chains(tuple(finger for finger in fingers if finger), limits, held, follows,
                  (*notes, *said))


def _narrowed(
    known: Mapping[str, UrdfJoint], follows: Mapping[str, Follow]
) -> tuple[dict[str, tuple[float, float]], list[str]]:
    """Limits [rad] of joints that would turn a follower beyond its own, and a sentence on each; of
    followers that have none, or would be beyond their own everywhere, as far as they are led."""
    found: dict[str, tuple[float, float]] = {}
    wrong, free = [], []
    for name, follow in follows.items():
        own, leader = known[name], known[follow.joint]
        low, high = found.get(leader.name, (leader.low_rad, leader.high_rad))
        led = sorted(follow.factor * end + follow.offset_rad for end in (low, high))
        if own.kind != "revolute":
            free.append(name)
            continue
        if led[0] >= own.low_rad - NEAR and led[1] <= own.high_rad + NEAR:
            continue
        first, last = sorted((end - follow.offset_rad) / follow.factor for end in (
            own.low_rad, own.high_rad)) if follow.factor else (high, low)
        if max(low, first) < min(high, last):
            found[leader.name] = max(low, first), min(high, last)
        else:
            wrong.append(name)
    notes = [f"joint {name} goes from {_degrees(low)} to {_degrees(high)} deg, as far as joints "
             "that follow it may" for name, (low, high) in found.items()]
    for name in wrong + free:
        follow = follows[name]
        leader = known[follow.joint]
        low, high = sorted(follow.factor * end + follow.offset_rad for end in found.get(
            leader.name, (leader.low_rad, leader.high_rad)))
        found[name] = low, max(high, low + _LEAST_RAD)
        if name in wrong:
            notes.append(f"joint {name} goes from {_degrees(low)} to {_degrees(high)} deg, as "
                         f"{follow.joint} leads it: by its own limits the two could not move")
    return found, notes


def _degrees(angle_rad: float) -> str:
    return f"{math.degrees(angle_rad):.4g}"


def _followed(tree: UrdfTree, known: Mapping[str, UrdfJoint], joint: UrdfJoint,
              held_rad: Mapping[str, float]) -> Follow:
    """The joint at the end of a row of joints that follow one another: one that is driven or held;
    of a joint that follows none, itself."""
    factor, offset, seen, now = 1.0, 0.0, {joint.name}, joint
    while now.follows is not None and now.name not in held_rad:
        name, times, plus = now.follows
        where = f"{tree.file}: joint {now.name}"
        if name not in known or not known[name].turns:
            raise HandError(f"{where}: follows {name!r}; mimic should name a joint that turns")
        if abs(plus) > _MOST_OFFSET_RAD:
            raise HandError(f"{where}: follows {name} with an offset of {plus:g} rad; should be at "
                            f"most a turn: {UNITS_OF_FILES}")
        if name in seen:
            raise HandError(f"{where}: follows itself by way of {name}; mimic should lead to a "
                            "driven joint")
        factor, offset, now = factor * times, offset + factor * plus, known[name]
        seen.add(name)
    return Follow(now.name, factor, offset)
