"""Which joints of a URDF make fingers, and which stand still."""

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from warpgrasp.hands.hand_checks import NEAR
from warpgrasp.hands.hand_model import UNITS_OF_FILES, Follow, HandError
from warpgrasp.hands.urdf_tree import UrdfJoint, UrdfTree

_MOST_OFFSET_RAD = 6.3
"""Of a joint from the one that it follows."""
_LEAST_RAD = 1e-6
"""Between a joint's limits, where one that leads it does not turn it."""
_PIN_M = 2e-4
"""Two links turn about a pin where they share a point to within this on all of their way [est]."""
_WAY_M = 5e-3
"""A pin goes farther than this; what stands still is an axis that both turn about [est]."""
_PLACES = 7
"""On that way, at which the two are compared."""


@dataclass(frozen=True)
class Chains:
    """The moving joints of each finger from the palm outwards; the angles of those that stand
    still; the joints that follow others; and what was decided, a sentence each."""

    fingers: tuple[tuple[UrdfJoint, ...], ...]
    limits_rad: Mapping[str, tuple[float, float]]
    """Where they are not the file's, so that joints and those that follow them agree."""
    held_rad: Mapping[str, float]
    follows: Mapping[str, Follow]
    bars: frozenset[str]
    """Joints that move a bar of a linkage, which is left out with all on it."""
    notes: tuple[str, ...]


def finger_chains(
    tree: UrdfTree, palm: str, tips: Sequence[str], held_rad: Mapping[str, float]
) -> Chains:
    """A finger is a chain from the palm to a link of `tips`, or, without, to a joint that moves no
    other. Joints that move several fingers, as a wrist's, are held, and so are all others. A URDF
    cannot close a loop: a bar that ends at a pin on a finger is none itself, and is left out. A
    joint that others follow and that moves no collision shape, as a motor's crank, is none either.
    Where what fingers follow is in none of them, a joint of theirs drives in its place.

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
    known = {joint.name: joint for joint in tree.joint_to.values()}
    inner = {joint.name for path in moving.values() for joint in path[:-1]}
    leaves = [path for path in moving.values() if path and path[-1].name not in inner]
    pinned = _pinned(tree, known, held, leaves, paths)
    bars = frozenset(name for name in pinned if name not in
                     [joint.name for tip in tips for joint in moving.get(tip, [])])
    no_fingers = inner | bars | _cranks(tree, known, held, leaves)
    ends = {path[-1].name: path for link, path in moving.items() if path
            and (link in tips if tips else path[-1].name not in no_fingers)}
    notes += [f"joint {name} moves a bar of a linkage, which ends at a pin on what joint "
              f"{pinned[name]} moves: it is left out" for name in sorted(bars)]
    if not ends:
        named = " leads to a tip that is named" if tips else ""
        raise HandError(f"{tree.file}: no moving joint beyond link {palm}{named}; a hand should "
                        "have a finger")
    count = [joint.name for path in ends.values() for joint in path]
    all_moving = {joint.name: joint for path in moving.values() for joint in path
                  if joint.name not in bars}
    outside = bars | {name for name in all_moving if name not in count
                      and name not in held and name not in inner}
    known, said = _driven_anew(tree, known, count, outside)
    notes += said

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
                     + (f", as it follows {follow.joint}" if follow.joint != name else "")
                     + _beyond(known[name], held[name]))
    follows = {name: _followed(tree, known, known[name], held) for name in count
               if known[name].follows is not None and name not in held}
    for name, follow in list(follows.items()):
        if follow.joint in held or follow.joint not in count:
            held[name] = follow.factor * stands(follow.joint) + follow.offset_rad
            notes.append(f"joint {name} follows {follow.joint}, which stands still: so does it, at "
                         f"{_degrees(held[name])} deg{_beyond(known[name], held[name])}")
            del follows[name]
    limits, said = _narrowed(known, follows)
    limits = {name: (known[name].low_rad, known[name].high_rad) for name in count
              if known[name] is not tree.joint_to[known[name].child]} | limits
    fingers = [tuple(joint for joint in path if joint.name not in held) for path in ends.values()]
    if not any(fingers):
        raise HandError(f"{tree.file}: every joint beyond link {palm} is held; a hand should have "
                        "a finger that moves")
    return Chains(tuple(finger for finger in fingers if finger), limits, held, follows, bars,
                  (*notes, *said))


def _pinned(
    tree: UrdfTree, known: Mapping[str, UrdfJoint], held_rad: Mapping[str, float],
    leaves: Sequence[Sequence[UrdfJoint]], paths: Mapping[str, Sequence[UrdfJoint]],
) -> dict[str, str]:
    """Joints that move bars, each with the joint of a longer chain on which its bar ends: one drive
    moves both, so that a point of the bar's last link stands still in the other's link."""
    found: dict[str, str] = {}
    for bar in leaves:
        drives = {_followed(tree, known, joint, held_rad).joint for joint in bar}
        for chain in leaves:
            if len(drives) != 1 or len(chain) <= len(bar) or {
                    joint.name for joint in bar} & {joint.name for joint in chain}:
                continue
            drive = known[next(iter(drives))]
            turns = np.linspace(drive.low_rad, drive.high_rad, _PLACES)
            own = _frames(tree, known, held_rad, paths[bar[-1].child], turns)
            for n, joint in enumerate(chain):
                if _followed(tree, known, joint, held_rad).joint != drive.name:
                    break
                if n and _share_a_pin(own, _frames(tree, known, held_rad, paths[joint.child],
                                                   turns)):
                    found |= {moved.name: joint.name for moved in bar}
                    break
    return found


def _cranks(
    tree: UrdfTree, known: Mapping[str, UrdfJoint], held_rad: Mapping[str, float],
    leaves: Sequence[Sequence[UrdfJoint]],
) -> frozenset[str]:
    """Joints at the end of a chain that others follow, and that move no collision shape."""
    ends = {path[-1].name for path in leaves}
    leading = {_followed(tree, known, joint, held_rad).joint
               for path in leaves for joint in path if joint.follows is not None}
    shaped = {joint.name for link in tree.links.values() if link.collisions
              for joint in tree.path(link.name)}
    return frozenset(leading & ends - shaped)


def _frames(tree: UrdfTree, known: Mapping[str, UrdfJoint], held_rad: Mapping[str, float],
            path: Sequence[UrdfJoint], drive_rad: np.ndarray) -> np.ndarray:
    """Of the link at the end of a path, (turn, 4, 4), in the palm's frame."""
    frames = np.tile(np.eye(4), (len(drive_rad), 1, 1))
    for joint in path:
        turn = np.tile(np.eye(4), (len(drive_rad), 1, 1))
        if joint.turns:
            if joint.name in held_rad:
                angle = np.full(len(drive_rad), held_rad[joint.name])
            else:
                follow = _followed(tree, known, joint, held_rad)
                angle = follow.factor * drive_rad + follow.offset_rad
            turn[:, :3, :3] = Rotation.from_rotvec(np.outer(angle, joint.axis)).as_matrix()
        frames = frames @ joint.origin @ turn
    return frames


def _share_a_pin(one: np.ndarray, two: np.ndarray) -> bool:
    """Whether a point stands still in two links, (turn, 4, 4) each, while it moves itself."""
    between = np.linalg.inv(two) @ one
    to, at = between[:, :3, :3], between[:, :3, 3]
    both = np.concatenate([to, np.tile(-np.eye(3), (len(to), 1, 1))], 2).reshape(-1, 6)
    pin = np.linalg.lstsq(both, -at.reshape(-1))[0]
    off = np.linalg.norm(to @ pin[:3] + at - pin[3:], axis=1).max()
    way = one[:, :3, :3] @ pin[:3] + one[:, :3, 3]
    return bool(off < _PIN_M and np.ptp(way, axis=0).max() > _WAY_M)


def _driven_anew(
    tree: UrdfTree, known: Mapping[str, UrdfJoint], count: Sequence[str], outside: Set[str]
) -> tuple[dict[str, UrdfJoint], list[str]]:
    """The joints by name, and what was changed, a sentence each. Where the drive is one of
    `outside`, which is in no finger, the first joint of a finger that follows it drives in its
    place, within the limits of both."""
    changed, notes = dict(known), []
    led = {name: _followed(tree, known, known[name], {}) for name in count
           if outside and known[name].follows is not None}
    for drive in sorted(name for name in outside if known[name].follows is None):
        first = next((name for name in led if led[name].joint == drive and led[name].factor), None)
        if first is None:
            continue
        own = led[first]
        low, high = sorted(own.factor * end + own.offset_rad
                           for end in (known[drive].low_rad, known[drive].high_rad))
        within = max(low, known[first].low_rad), min(high, known[first].high_rad)
        low, high = within if within[0] < within[1] else (low, high)
        notes.append(f"joint {first} drives in place of {drive}, which is in no finger")
        changed[first] = replace(known[first], follows=None, kind="revolute", low_rad=low,
                                 high_rad=high)
        for name, follow in led.items():
            if follow.joint == drive and name != first:
                factor = follow.factor / own.factor
                changed[name] = replace(known[name], follows=(
                    first, factor, follow.offset_rad - factor * own.offset_rad))
    return changed, notes


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


def _beyond(joint: UrdfJoint, angle_rad: float) -> str:
    """What is said of an angle that the joint's own limits do not allow."""
    if joint.kind != "revolute" or joint.low_rad - NEAR <= angle_rad <= joint.high_rad + NEAR:
        return ""
    return (f", beyond its limits of {_degrees(joint.low_rad)} to {_degrees(joint.high_rad)}: hold "
            "what leads it elsewhere")


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
