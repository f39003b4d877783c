"""First guesses of what no URDF says: thumb, frame of the grasp, postures, closing path."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import product

import numpy as np

from warpgrasp.hands.hand_frames import (
    finger_tips,
    link_frames,
    matrix_of,
    place_of,
    posture_angles,
)
from warpgrasp.hands.hand_model import (
    Finger,
    HandClosing,
    HandJoint,
    HandModel,
    Place,
    Posture,
)

FLEXES = 1.25
"""A joint whose range is by this factor longer on one side of zero bends to that side."""
PARALLEL = 0.8
"""Cosine between the axes of a joint and of its finger's last one from which on it bends the
finger; others spread it, or turn a thumb [est]."""
OPEN, CLOSED, CURLED = 0.1, 1.0, 0.5
"""How far a finger's first bending joint is turned in the open hand and in the closed one, and the
others in the closed one: shares of the way from its rest to its limit [est]."""
OPENED_RAD = 0.7
"""How far the joints that bend a gripper's finger open it beyond its rest, all together at most
[est]."""
WIDER_RAD = (0.17, 0.35, 0.7)
"""As far are opened, in guesses to be tried, also joints whose ranges do not say which side is open
[est]."""
ALIKE = 0.7
"""Fingers go one way where the mean of their unit ways is longer than this [est]."""
_ACROSS = 0.01
"""Cosine between where a joint moves its tip and where the hand's middle lies, below which that
does not tell to which side it bends."""
_TRIED = 2000
"""Places of a thumb that are tried, at most."""
_STEPS = 13
"""Angles of one of its joints, at most."""
_PLACES = (6, 4, 3, 2)
"""Angles of each joint of a thumb that may be tried, by how many such joints it has."""
_EASE = 0.1
"""A radian from its rest is worth this cosine between axes [est]."""
_FIRST = 1e-3
"""Share of a closing that shows where tips go first."""
_OPPOSED = -0.5
"""Cosine between the ways of two fingers below which they go against each other."""
APART = 0.25
"""How far apart fingers stand across the hand, of their mean length, from which on they close on
what is between them [est]."""
_EVEN = 0.03
"""Fingers stand evenly about an axis if a turn takes each to the next but for this share of how far
off the axis they reach [est]."""

Bending = tuple[tuple[tuple[HandJoint, float], ...], ...]
"""The joints that bend each finger, and the limits [rad] that they close to."""


def with_guesses(model: HandModel) -> HandModel:
    """The hand with a thumb, a frame, the postures open and closed, and a path between them."""
    bending, model = _with_thumb(model)
    return max(_framed(model, bending, _against_fingers(model, bending)), key=_opening_m)


def other_guesses(model: HandModel) -> tuple[HandModel, ...]:
    """The hand as `with_guesses` makes it but for where its thumb stands, for its frame, or for how
    far it opens; none where there is nothing else to try."""
    first, (bending, model) = with_guesses(model), _with_thumb(model)
    against = _against_fingers(model, bending)
    turning, places = _turning(model, bending), [against]
    if turning:
        grid = _grid(turning, _PLACES[min(len(turning), len(_PLACES)) - 1])
        places += [dict(zip((joint.name for joint in turning), angles, strict=True))
                   for angles in grid.tolist()]
    found = [hand for turned in places for hand in _framed(model, bending, turned, both=True)]
    found += [_about(model, bending, against, _wide(bending, opened, whatever=True))
              for opened in WIDER_RAD]
    return tuple(hand for n, hand in enumerate(found) if hand not in [first, *found[:n]])


def _with_thumb(model: HandModel) -> tuple[Bending, HandModel]:
    bending = _bending(model)
    return bending, replace(model, thumb=guessed_thumb(_closing(model, bending)))


def _framed(model: HandModel, bending: Bending, turned: Mapping[str, float], *, both: bool = False
            ) -> list[HandModel]:
    """The hand facing the object, or with it between its fingers, or `both`; some joints of the
    thumb stand at `turned` [rad]."""
    rest = _closing(model, bending, turned)
    gripper = _is_gripper(rest)
    found = []
    if not gripper and _go_one_way(rest) and _even_axis(rest) is None:
        facing = _closing(model, bending, turned, _bent(model, bending))
        found.append(replace(facing, grasp_frame=_frame_before_palm(facing)))
    if both or not found or _is_opposed(rest):
        found.append(_about(model, bending, turned, _wide(bending)))
    return found


def _about(model: HandModel, bending: Bending, turned: Mapping[str, float],
           opened: Mapping[str, float]) -> HandModel:
    """The hand with the object between its fingers, whose joints are `opened` [rad]."""
    about = _closing(model, bending, turned, opened)
    gripper = _is_gripper(_closing(model, bending, turned))
    return replace(about, grasp_frame=_frame_between(about, gripper))


def _bending(model: HandModel) -> Bending:
    """Of each finger the driven joints that turn about the axis of its last one, and of these only
    those whose range says to which side they bend, if there are any. Where no range says so they
    bend to the side on which the hand's other fingers are."""
    found = []
    for finger, axes in zip(model.fingers, _axes(model, _angles(model)[None]), strict=True):
        driven = [j for j in finger.joints if j.follows is None]
        level = [j for j, axis in zip(finger.joints, axes[0], strict=True)
                 if j in driven and abs(axis @ axes[0, -1]) > PARALLEL]
        sided = [(j, _farther(j)) for j in level if _bends(j)]
        found.append(tuple(sided or [(j, _inward(model, finger, j)) for j in level or driven]))
    return tuple(found)


def _inward(model: HandModel, finger: Finger, joint: HandJoint) -> float:
    """The limit [rad] to which a joint takes its finger's tip towards the middle of all bases."""
    rest = _angles(model)
    turned = rest + _FIRST * (np.arange(len(rest)) == model.driven.index(joint))
    tips = finger_tips(model, np.stack([rest, turned]))[:, model.fingers.index(finger)]
    middle = _bases(model).mean(0)
    towards = _unit(tips[1] - tips[0]) @ _unit(middle - tips[0])
    if abs(towards) < _ACROSS:
        return _farther(joint)
    return joint.high_rad if towards > 0.0 else joint.low_rad


def _closing(model: HandModel, bending: Bending, turned_rad: Mapping[str, float] | None = None,
             opened_rad: Mapping[str, float] | None = None) -> HandModel:
    """The hand with a path that bends its fingers. Some joints stay at `turned_rad`; the open
    hand's joints stand at `opened_rad`."""
    open_, closed = {**(turned_rad or {}), **(opened_rad or {})}, dict(turned_rad or {})
    for joints in bending:
        for n, (joint, end) in enumerate(joints):
            closed[joint.name] = _part_way(joint, end, CURLED if n else CLOSED)
    return replace(
        model, postures=(Posture("open", (*open_.items(),)), Posture("closed", (*closed.items(),))),
        closings=(HandClosing("grasp", "open", "closed",
                              tuple(joint.name for joints in bending for joint, _ in joints)),))


def _bent(model: HandModel, bending: Bending) -> dict[str, float]:
    """Angles [rad] of an open hand whose fingers, but for the thumb, have begun to bend."""
    return {joints[0][0].name: _part_way(*joints[0], OPEN)
            for finger, joints in zip(model.fingers, bending, strict=True)
            if joints and finger.name != model.thumb}


def _wide(bending: Bending, opened_rad: float = OPENED_RAD, *, whatever: bool = False
          ) -> dict[str, float]:
    """Angles [rad] of a gripper that opens as far as the ranges of its joints say, those next to
    the palm first. A joint whose range is alike on both sides says nothing of that, and is opened
    only if asked to, `whatever` it says."""
    opened = {}
    for joints in bending:
        left = opened_rad
        for joint, end in joints:
            rest = _rest(joint)
            other = joint.low_rad if end == joint.high_rad else joint.high_rad
            turn = min(abs(other - rest), left) if whatever or _bends(joint) else 0.0
            if turn > 0.0:
                opened[joint.name] = rest + turn * float(np.sign(other - rest))
                left -= turn
    return opened


def _is_gripper(model: HandModel) -> bool:
    """Whether two fingers begin to close against each other from places across the hand, unlike a
    thumb that stands beside the fingers."""
    open_ = _open(model)
    ways, base = _first_ways(model, open_), _bases(model)
    length = np.linalg.norm(finger_tips(model, _angles(model)[None])[0] - base, axis=1).mean()
    ahead = np.einsum("ijx,ix->ij", base[None] - base[:, None], ways)  # of i lies j
    across = np.minimum(ahead, ahead.T) > APART * length
    return bool((across & (ways @ ways.T < _OPPOSED)).any())


def _even_axis(model: HandModel) -> np.ndarray | None:
    """The axis, a unit vector (3,), about which three fingers or more stand evenly, at rest and
    closed; it points from their bases to their tips. None of other hands."""
    base = _bases(model)
    if len(base) < 3:
        return None
    ends = np.stack([_angles(model), posture_angles(model, model.posture("closed"))])
    points = np.concatenate([base[None], finger_tips(model, ends)]) - base.mean(0)
    u, v, axis = np.linalg.svd(points[0])[2]
    v *= np.linalg.det([u, v, axis])  # right-handed
    across, along = points @ u + 1j * (points @ v), points @ axis
    across = across[:, np.argsort(np.angle(across[0]))]
    off = np.abs(across * np.exp(2j * np.pi / len(base)) - np.roll(across, -1, axis=1))
    if max(off.max(), np.ptp(along, axis=1).max()) >= _EVEN * np.abs(across).max():
        return None
    return axis if along.sum() > 0.0 else -axis


def _first_ways(model: HandModel, q_rad: np.ndarray) -> np.ndarray:
    """Where tips go first as the hand closes, from driven joints (driven,) [rad]: unit vectors in
    the palm's frame, (finger, 3)."""
    closing = posture_angles(model, model.posture("closed")) - _open(model)
    tip, after = finger_tips(model, np.stack([q_rad, q_rad + _FIRST * closing]))
    return np.array([_unit(way) for way in after - tip])


def _open(model: HandModel) -> np.ndarray:
    """Angles of the driven joints of the open hand [rad], (driven,)."""
    return posture_angles(model, model.posture("open"))


def _against_fingers(model: HandModel, bending: Bending) -> dict[str, float]:
    """Angles [rad] of those joints of the thumb that do not bend it, at which it bends most against
    the other fingers, and not far from their rest; none of a hand without a thumb."""
    names = [finger.name for finger in model.fingers]
    if model.thumb not in names or len(names) < 2:
        return {}
    own = names.index(model.thumb)
    bent = {joint.name: end for joints in bending for joint, end in joints}
    turning = _turning(model, bending)
    tried = _grid(turning, min(_STEPS, int(_TRIED ** (1.0 / max(len(turning), 1)))))
    q = np.tile(_angles(model), (len(tried), 1))
    at = [model.driven.index(joint) for joint in turning]
    far = np.abs(tried - q[:, at]).sum(1)
    q[:, at] = tried
    last = [finger.joints[-1] for finger in model.fingers]
    ways = [axes[:, -1] * np.sign(bent.get(joint.name, _farther(joint)))
            for joint, axes in zip(last, _axes(model, q), strict=True)]
    fingers = _unit(np.mean([way[0] for n, way in enumerate(ways) if n != own], axis=0))
    best = int(np.argmin(ways[own] @ fingers + _EASE * far))
    return {joint.name: float(angle) for joint, angle in zip(turning, tried[best], strict=True)}


def _turning(model: HandModel, bending: Bending) -> list[HandJoint]:
    """The driven joints of the thumb that do not bend it."""
    bent = {joint.name for joints in bending for joint, _ in joints}
    return [joint for finger in model.fingers if finger.name == model.thumb and len(bending) > 1
            for joint in finger.joints if joint.follows is None and joint.name not in bent]


def _grid(joints: list[HandJoint], steps: int) -> np.ndarray:
    """Angles of joints [rad], evenly over their ranges, (place, joint)."""
    return np.array([*product(*(np.linspace(j.low_rad, j.high_rad, steps) for j in joints))])


def _bases(model: HandModel) -> np.ndarray:
    """Of the fingers, (finger, 3) [m], in the palm's frame."""
    return np.array([finger.joints[0].place[:3] for finger in model.fingers])


def _angles(model: HandModel) -> np.ndarray:
    """Of the driven joints at rest [rad], (driven,)."""
    return posture_angles(model, Posture("", ()))


def _axes(model: HandModel, q_rad: np.ndarray) -> list[np.ndarray]:
    """Of each finger's joints, (pose, joint, 3), in the palm's frame."""
    return [np.einsum("pjxy,jy->pjx", frames[..., :3, :3], [j.axis for j in finger.joints])
            for finger, frames in zip(model.fingers, link_frames(model, q_rad), strict=True)]


def _rest(joint: HandJoint) -> float:
    """As near to zero as a joint can stand [rad]."""
    return min(max(0.0, joint.low_rad), joint.high_rad)


def _part_way(joint: HandJoint, end_rad: float, share: float) -> float:
    """A joint's angle [rad] at a share of the way from its rest to where it closes."""
    return _rest(joint) + share * (end_rad - _rest(joint))


def guessed_thumb(model: HandModel) -> str:
    """The finger of that name, or the one whose tip goes most against the others': first, of a hand
    whose fingers begin to close against each other, or else until it has closed. One finger is no
    thumb, and of two only the one of that name."""
    names = [finger.name for finger in model.fingers]
    if "thumb" in names or len(names) < 3:
        return "thumb" if "thumb" in names and len(names) > 1 else ""
    if _is_gripper(model):
        way = _first_ways(model, _open(model))
    else:
        open_, closed = (finger_tips(model, posture_angles(model, model.posture(name))[None])[0]
                         for name in ("open", "closed"))
        way = np.array([_unit(gone) for gone in closed - open_])
    along = [way[n] @ np.delete(way, n, 0).mean(0) for n in range(len(way))]
    return names[int(np.argmin(along))]


def _frame_before_palm(model: HandModel) -> Place:
    """In the palm's frame: z is where the tips of straight fingers go first when the hand closes,
    and x leads from the fingers' bases to the thumb's; the origin is the middle between them."""
    is_thumb = _is_thumb(model)
    base = _bases(model)
    fingers = middle = base[~is_thumb].mean(0)
    x = np.zeros(3)
    if is_thumb.any():
        middle, x = (fingers + base[is_thumb][0]) / 2, base[is_thumb][0] - fingers
    # Tips of fingers that are bent go towards the wrist, too; those of straight ones not.
    return _frame(_first_ways(model, _angles(model))[~is_thumb].mean(0), x, middle)


def _frame_between(model: HandModel, gripper: bool) -> Place:
    """In the palm's frame: z is where fingers at rest point, and a gripper's thumb, too; x is the
    way on which the hand closes, and the origin the middle between the bases of fingers and thumb.
    Of fingers that stand evenly about an axis z is that axis, and the origin the middle of all
    bases."""
    is_thumb = _is_thumb(model)
    base = _bases(model)
    pointing = finger_tips(model, _angles(model)[None])[0] - base
    z = _unit(pointing[~is_thumb].mean(0))
    middle = base[~is_thumb].mean(0)
    if is_thumb.any():
        middle = (middle + base[is_thumb][0]) / 2
        z = z + _unit(pointing[is_thumb][0]) if gripper else z
    if (axis := _even_axis(model)) is not None:
        z, middle = axis, base.mean(0)
    return _frame(z, _way_across(_first_ways(model, _open(model)), is_thumb), middle)


def _frame(z: np.ndarray, x: np.ndarray, middle: np.ndarray) -> Place:
    """Of an axis, a way that need not be square to it, and an origin, (3,) each."""
    z = _unit(z) if z.any() else np.array([0.0, 0.0, 1.0])
    x = _unit(x - z * (x @ z))
    if not x.any():
        x = np.eye(3)[int(np.argmin(np.abs(z)))]
        x = _unit(x - z * (x @ z))
    return place_of(np.block([[np.stack([x, np.cross(z, x), z], 1), middle[:, None]],
                              [np.array([[0.0, 0.0, 0.0, 1.0]])]]))


def _opening_m(model: HandModel) -> float:
    """How far the tip of the open thumb is from the nearest of the fingers' along x; 0 of a hand
    without a thumb."""
    is_thumb = _is_thumb(model)
    if not is_thumb.any():
        return 0.0
    along = finger_tips(model, _open(model)[None])[0] @ matrix_of(model.grasp_frame)[:3, 0]
    return float((along[is_thumb] - along[~is_thumb]).min())


def _is_thumb(model: HandModel) -> np.ndarray:
    """Which finger is the thumb, (finger,) bool."""
    return np.array([finger.name == model.thumb for finger in model.fingers])


def _is_opposed(model: HandModel) -> bool:
    """Whether the open thumb's tip goes first against the others'."""
    ways, is_thumb = _first_ways(model, _open(model)), _is_thumb(model)
    return bool((ways[is_thumb] @ _unit(ways[~is_thumb].mean(0)) <= _OPPOSED).any())


def _go_one_way(model: HandModel) -> bool:
    """Whether the tips of straight fingers, but for the thumb's, go alike at first."""
    ways = _first_ways(model, _angles(model))[~_is_thumb(model)]
    return float(np.linalg.norm(ways.mean(0))) > ALIKE


def _way_across(ways: np.ndarray, is_thumb: np.ndarray) -> np.ndarray:
    """The way (3,) on which fingers close, from the others to the thumb, by where tips go first,
    (finger, 3). Without a thumb the line along which they go most."""
    if is_thumb.any():
        return ways[~is_thumb].mean(0) - ways[is_thumb][0]
    line = np.linalg.svd(ways)[2][0]
    return line if line @ ways[0] > 0.0 else -line


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
