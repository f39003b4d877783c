"""What a hand must be, whatever file it comes from; the message names the element and the remedy.

The caller puts the file's name before it.
"""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from warpgrasp.hands.hand_frames import driven_angles, matrix_of, posture_angles
from warpgrasp.hands.hand_model import (
    CLOSING_WORDS,
    SENSES,
    UNITS_OF_FILES,
    Box,
    Finger,
    HandClosing,
    HandError,
    HandModel,
    Opposed,
    Posture,
    Shape,
)

MOST_JOINTS, MOST_FINGERS, MOST_PADS = 6, 6, 3
MOST_MEETING = 5
"""Fingers of a hand whose meetings with one another are found, at most."""
NEAR = 1e-9
"""Lengths [m] and angles [rad] that count as nothing."""
MOST_SHAPE_M, LEAST_SHAPE_M = 1.0, 1e-4
_MOST_PALM_M = 2.0
"""From the palm's frame to its shapes and fingers; an arm that stands still may be part of it."""
_MOST_LINK_M, _LEAST_LINK_M = 0.5, 5e-4
"""From a joint to the next, its shapes and its tip; between parallel axes and from joint to tip."""
_MOST_TIP_M = 0.05
"""From a finger's tip to the shapes of its last link."""
_MOST_DEG, _LEAST_DEG = 360.5, 6.3
"""Of a driven joint either way; a finger has one at least that turns farther than the latter, which
is a whole turn in radians."""
_ROUNDED_DEG = 0.01
"""By so much limits written by hand may be less than those that a leader leads its followers to."""


def check_hand(model: HandModel) -> HandModel:
    """The model itself. Raises HandError for the first thing that is wrong."""
    if not 1 <= len(model.fingers) <= MOST_FINGERS:
        raise HandError(f"{len(model.fingers)} fingers; should be 1 to {MOST_FINGERS}")
    _distinct("finger", [finger.name for finger in model.fingers])
    _distinct("joint", [joint.name for joint in model.joints])
    if model.senses not in SENSES:
        raise HandError(f"senses: is {model.senses!r}; should be one of {', '.join(SENSES)}")
    if model.thumb and model.thumb not in [finger.name for finger in model.fingers]:
        raise HandError(f"thumb: there is no finger {model.thumb!r}; should be one of "
                        f"{', '.join(f.name for f in model.fingers)}, or empty")
    _check_near("grasp_frame", model.grasp_frame[:3], "the palm's frame", _MOST_PALM_M)
    _check_shapes("palm", model.palm, _MOST_PALM_M)
    for finger in model.fingers:
        _check_finger(finger)
    _check_followers(model)
    names = {joint.name: joint for joint in model.driven}
    for posture in model.postures:
        for joint, angle in posture.angles_rad:
            if joint not in names:
                raise HandError(f"posture {posture.name}: there is no driven joint {joint!r}; "
                                f"should be one of {', '.join(names)}")
            low, high = names[joint].low_rad, names[joint].high_rad
            if not low - NEAR <= angle <= high + NEAR:
                raise HandError(
                    f"posture {posture.name}: joint {joint} at {math.degrees(angle):.4g} deg; "
                    f"should be {math.degrees(low):.4g} to {math.degrees(high):.4g}")
    for path in model.closings:
        _check_path(path, model.postures, list(names))
    _check_touching(model)
    return model


def check_closings(model: HandModel) -> None:
    """Raises HandError for a hand that cannot close: without a path, or with one along which
    nothing moves, or whose name is that of another way to close."""
    if not model.closings:
        raise HandError("closings: there is none; should have one at least, from a posture to "
                        "another")
    number = {joint.name: n for n, joint in enumerate(model.driven)}
    for path in model.closings:
        start, end = (posture_angles(model, model.posture(name)) for name in (path.start, path.end))
        if np.abs(end - start)[[number[name] for name in path.moves]].max() < NEAR:
            raise HandError(f"closing {path.name}: no joint that it moves is elsewhere in posture "
                            f"{path.end} than in {path.start}; one at least should be")
        if path.name in CLOSING_WORDS:
            raise HandError(f"closing {path.name}: is the name of a way in which every hand closes "
                            f"({', '.join(CLOSING_WORDS)}); should be another name")


def _check_touching(model: HandModel) -> None:
    """What touches with one finger, and with two."""
    fingers, postures = [f.name for f in model.fingers], [p.name for p in model.postures]

    def check(what: str, name: str, known: list[str], kind: str) -> None:
        if name not in known:
            raise HandError(f"{what}: there is no {kind} {name!r}; should be one of "
                            f"{', '.join(known)}")

    if model.extended is not None:
        check("extended.finger", model.extended.finger, fingers, "finger")
        check("extended.posture", model.extended.posture, postures, "posture")
        _check_tip_pad("extended.finger", model.extended.finger, model)
    if model.opposed is not None:
        for name in model.opposed.fingers:
            check("opposed.fingers", name, fingers, "finger")
            _check_tip_pad("opposed.fingers", name, model)
        if len(set(model.opposed.fingers)) < len(model.opposed.fingers):
            raise HandError(f"opposed.fingers: {model.opposed.fingers[0]!r} twice; should be two "
                            "fingers")
        check("opposed.start", model.opposed.start, postures, "posture")
        check("opposed.end", model.opposed.end, postures, "posture")
        _check_closes(model.opposed, model)


def _check_closes(pair: Opposed, model: HandModel) -> None:
    """Each of two opposed fingers goes somewhere as it closes."""
    start, end = (driven_angles(model, posture_angles(model, model.posture(name)))
                  for name in (pair.start, pair.end))
    moved = {joint.name for joint, way in zip(model.joints, np.abs(end - start), strict=True)
             if way > NEAR}
    for finger in model.fingers:
        if finger.name in pair.fingers and moved.isdisjoint(joint.name for joint in finger.joints):
            raise HandError(f"opposed: no joint of finger {finger.name} is elsewhere in posture "
                            f"{pair.end} than in {pair.start}; one at least should be")


def _check_tip_pad(what: str, name: str, model: HandModel) -> None:
    finger = next(finger for finger in model.fingers if finger.name == name)
    last = finger.joints[-1].name
    if last not in finger.pads:
        raise HandError(f"{what}: finger {name} has no pad on its last link; should have "
                        f"pads = [{last!r}]")


def _check_finger(finger: Finger) -> None:
    count = len(finger.joints)
    if not 1 <= count <= MOST_JOINTS:
        raise HandError(f"finger {finger.name}: {count} joints{_ends(finger)}; should be 1 to "
                        f"{MOST_JOINTS}: hold some of them at an angle, or name the link beyond "
                        "them as the palm")
    for joint in finger.joints:
        for what, numbers in (("place", joint.place), ("axis", joint.axis),
                              ("limits", (joint.low_rad, joint.high_rad)),
                              ("effort", (joint.effort_Nm,)),
                              ("stiffness", (joint.stiffness_Nm_rad,))):
            if not np.isfinite(numbers).all():
                raise HandError(f"joint {joint.name}: {what} {', '.join(map(str, numbers))}; "
                                "should be finite")
        if abs(np.linalg.norm(joint.axis) - 1.0) > 1e-6:
            raise HandError(f"joint {joint.name}: axis of length "
                            f"{np.linalg.norm(joint.axis):.4g}; should be 1")
        if not joint.low_rad < joint.high_rad:
            raise HandError(f"joint {joint.name}: limits {math.degrees(joint.low_rad):.4g} to "
                            f"{math.degrees(joint.high_rad):.4g} deg; the lower one should be "
                            "less than the upper one")
        if joint.stiffness_Nm_rad <= 0.0:
            raise HandError(f"joint {joint.name}: stiffness {joint.stiffness_Nm_rad:g}; should be "
                            "more than 0")
        if joint.effort_Nm < 0.0:
            raise HandError(f"joint {joint.name}: effort {joint.effort_Nm:g} N m; should be more "
                            "than 0, or 0 where it is not known")
    _check_limits(finger)
    _check_near(f"joint {finger.joints[0].name}", finger.joints[0].place[:3], "the palm's frame",
                _MOST_PALM_M)
    for joint, after in pairwise(finger.joints):
        _check_near(f"joint {after.name}", after.place[:3], f"joint {joint.name}", _MOST_LINK_M)
        ahead = matrix_of(after.place)
        same = np.linalg.norm(np.cross(joint.axis, ahead[:3, :3] @ after.axis)) < NEAR
        apart = np.linalg.norm(np.cross(joint.axis, ahead[:3, 3]))
        if same and apart < NEAR:
            raise HandError(f"joint {after.name}: turns about the axis of joint {joint.name}, the "
                            "link between them has no length; should stand apart from it, or be "
                            "fixed")
        if same and apart < _LEAST_LINK_M:
            raise HandError(f"joint {after.name}: its axis is {apart * 1e3:.3g} mm from that of "
                            f"joint {joint.name}, as both point the same way; should be "
                            f"{_LEAST_LINK_M * 1e3:g} mm from it at least: {UNITS_OF_FILES}")
    if not any(joint.shapes for joint in finger.joints):
        raise HandError(f"finger {finger.name}: none of its links{_ends(finger)} has a collision "
                        "shape; should have a capsule or a box at least on the last")
    off = float(np.linalg.norm(finger.tip_m))
    if off < _LEAST_LINK_M:
        raise HandError(f"finger {finger.name}: its tip lies on its last joint "
                        f"{finger.joints[-1].name}, {off * 1e3:.3g} mm from it: a link without "
                        "length, or no tip; should be named, apart from the joint")
    _check_near(f"finger {finger.name}: its tip", finger.tip_m, f"joint {finger.joints[-1].name}",
                _MOST_LINK_M)
    for joint in finger.joints:
        _check_shapes(f"joint {joint.name}", joint.shapes, _MOST_LINK_M)
    far = min((_distance(shape, finger.tip_m) for shape in finger.joints[-1].shapes), default=0.0)
    if far > _MOST_TIP_M:
        raise HandError(f"finger {finger.name}: its tip is {far * 1e3:.3g} mm off the shapes of "
                        f"its last link; should be at most {_MOST_TIP_M * 1e3:g} mm off: "
                        f"{UNITS_OF_FILES}")
    if len(finger.pads) > MOST_PADS:
        raise HandError(f"finger {finger.name}: {len(finger.pads)} pads; should be {MOST_PADS} at "
                        "most")
    for what, named in (("pads", finger.pads), ("pad", [p.joint for p in finger.pad_places])):
        if twice := [name for name in named if list(named).count(name) > 1]:
            raise HandError(f"finger {finger.name}: {what}: link {twice[0]} twice; a link should "
                            "bear one pad at most")
    for place in finger.pad_places:
        if place.joint not in finger.pads:
            raise HandError(f"finger {finger.name}: the place of a pad on {place.joint!r}, which "
                            f"is none of its pads; should be one of {', '.join(finger.pads)}")
    for pad in finger.pads:
        if pad not in [joint.name for joint in finger.joints]:
            raise HandError(f"finger {finger.name}: a pad on {pad!r}; should be on one of its "
                            f"joints: {', '.join(j.name for j in finger.joints)}")


def _ends(finger: Finger) -> str:
    """Its first and last joint, which a URDF names; it names no fingers."""
    names = [joint.name for joint in finger.joints]
    return f" ({names[0]} to {names[-1]})" if len(names) > 1 else "".join(f" ({n})" for n in names)


def _check_limits(finger: Finger) -> None:
    driven = [joint for joint in finger.joints if joint.follows is None]
    for joint in driven:
        low, high = math.degrees(joint.low_rad), math.degrees(joint.high_rad)
        if max(-low, high) > _MOST_DEG:
            raise HandError(f"joint {joint.name}: limits {low:.4g} to {high:.4g} deg "
                            f"({joint.low_rad:.4g} to {joint.high_rad:.4g} rad); should be at most "
                            f"360 deg either way: {UNITS_OF_FILES}")
    widest = max((math.degrees(j.high_rad - j.low_rad) for j in driven), default=math.inf)
    if widest < _LEAST_DEG:
        raise HandError(f"finger {finger.name}: its joint with the widest limits{_ends(finger)} "
                        f"turns by {widest:.3g} deg; should be {_LEAST_DEG:g} at least: "
                        f"{UNITS_OF_FILES}")


def _check_near(what: str, at: Sequence[float], where: str, most_m: float) -> None:
    if (off := math.hypot(*at)) > most_m:
        raise HandError(f"{what} stands {off:.4g} m ({off * 1e3:,.6g} mm) from {where}; should "
                        f"be at most {most_m:g} m from it: {UNITS_OF_FILES}")


def _check_shapes(where: str, shapes: tuple[Shape, ...], most_m: float) -> None:
    for shape in shapes:
        if isinstance(shape, Box):
            what, sizes, places = "a box", shape.size, [shape.place[:3]]
        else:
            what, sizes, places = "a capsule", (shape.radius,), [shape.start, shape.end]
        if not all(LEAST_SHAPE_M <= size <= MOST_SHAPE_M for size in sizes):
            raise HandError(f"{where}: {what} of {' x '.join(f'{v * 1e3:.4g}' for v in sizes)} mm; "
                            f"should be {LEAST_SHAPE_M * 1e3:g} to {MOST_SHAPE_M * 1e3:g} mm "
                            f"each way: {UNITS_OF_FILES}")
        for place in places:
            _check_near(f"{where}: {what}", place, "the frame of its link", most_m)


def _distance(shape: Shape, point: Sequence[float]) -> float:
    """From a point to a shape's surface or, where it is negative or 0, into it [m]."""
    if isinstance(shape, Box):
        frame = matrix_of(shape.place)
        own = frame[:3, :3].T @ (np.asarray(point) - frame[:3, 3])
        return float(np.linalg.norm(np.maximum(np.abs(own) - np.asarray(shape.size) / 2, 0.0)))
    start, along = np.asarray(shape.start), np.subtract(shape.end, shape.start)
    share = np.clip((point - start) @ along / max(along @ along, NEAR**2), 0.0, 1.0)
    return float(np.linalg.norm(point - start - share * along)) - shape.radius


def _check_followers(model: HandModel) -> None:
    driven = {joint.name: joint for joint in model.driven}
    for joint in model.joints:
        if joint.follows is None:
            continue
        if joint.follows.joint not in driven:
            raise HandError(f"joint {joint.name}: follows {joint.follows.joint!r}, which is no "
                            f"driven joint of a finger; should be one of "
                            f"{', '.join(sorted(driven))}")
        leader = driven[joint.follows.joint]
        low, high = sorted(math.degrees(joint.follows.factor * end + joint.follows.offset_rad)
                           for end in (leader.low_rad, leader.high_rad))
        own = math.degrees(joint.low_rad), math.degrees(joint.high_rad)
        if low < own[0] - _ROUNDED_DEG or high > own[1] + _ROUNDED_DEG:
            raise HandError(f"joint {joint.name}: {leader.name} leads it from {low:.4g} to "
                            f"{high:.4g} deg, but its limits are {own[0]:.4g} to {own[1]:.4g}; "
                            f"should be as wide, or those of {leader.name} narrower")


def _check_path(path: HandClosing, postures: tuple[Posture, ...], driven: list[str]) -> None:
    for name in (path.start, path.end):
        if name not in [posture.name for posture in postures]:
            raise HandError(f"closing {path.name}: there is no posture {name!r}; should be one of "
                            f"{', '.join(p.name for p in postures)}")
    for joint in path.moves:
        if joint not in driven:
            raise HandError(f"closing {path.name}: moves {joint!r}; should be driven joints: "
                            f"{', '.join(driven)}")
    if not path.moves:
        raise HandError(f"closing {path.name}: moves no joint; should move one at least")


def _distinct(what: str, names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise HandError(f"{what} {name!r}: the name stands for two; names should differ")
