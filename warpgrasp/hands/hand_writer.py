"""A hand as TOML: lengths in mm, angles in degrees, so many digits that nothing is lost."""

import math
from collections.abc import Iterable, Sequence

from warpgrasp.core.plain_text import on_one_line
from warpgrasp.hands.hand_model import SENSES, Box, Finger, HandJoint, HandModel, Place, Shape


def hand_text(model: HandModel, notes: Sequence[str] = (), *, guessed: bool = False,
              framed: bool = False) -> str:
    """The file of a hand, which `hand_file` reads. `notes` are said at its head; with `guessed`
    what no URDF says is marked as a guess, but not the grasp frame of one that is `framed`."""
    mark = "  # GUESS" if guessed else ""
    says = f"{mark};" if guessed else "  #"
    frame_mark = "  #" if framed or not guessed else f"{mark};"
    lines = [
        "# A hand: fingers as chains of joints. Lengths are in mm, angles in degrees; a turn is a",
        "# quaternion (x, y, z, w); a joint stands in the frame of the link before it.",
        *(["# Lines marked GUESS are guesses from the URDF: look at each, and at the picture."]
          if guessed else []),
        *(f"# Note: {on_one_line(note)}." for note in notes), "",
        f"name = {_text(model.name)}", f"source = {_text(model.source)}",
        f"licence = {_text(model.licence)}",
        f"thumb = {_text(model.thumb)}{mark}",
        f"senses = {_text(model.senses)}{says} one of {', '.join(SENSES)}", "",
        f"[grasp_frame]{frame_mark} of the palm's frame: z is the approach, x to the thumb",
        *_place(model.grasp_frame), "",
    ]
    for posture in model.postures:
        lines += [f"[postures.{_text(posture.name)}]{says} joints that are not named "
                  "stand as near to zero as they can"]
        lines += [f"{_text(joint)} = {_degrees(angle)}" for joint, angle in posture.angles_rad]
        lines.append("")
    for path in model.closings:
        lines += [f"[closings.{_text(path.name)}]{mark}",
                  f"start = {_text(path.start)}", f"end = {_text(path.end)}",
                  f"moves = [{', '.join(map(_text, path.moves))}]", ""]
    lines += _touching(model, mark)
    for shape in model.palm:
        lines += ["[[palm]]", *_shape(shape), ""]
    for finger in model.fingers:
        lines += _finger(finger, mark)
    return "\n".join(lines)


def _touching(model: HandModel, mark: str) -> list[str]:
    """Pads, the finger that is extended, and the pair that is opposed, as far as they are said."""
    lines = []
    if (size := model.pad_size) is not None:
        lines += [f"[pads]{f'{mark};' if mark else '  #'} of every finger's",
                  f"width_mm = {_number(size.width_m * 1e3)}",
                  f"length_mm = {_number(size.length_m * 1e3)}",
                  f"wrap_deg = {_degrees(size.wrap_rad)}",
                  f"thickness_mm = {_number(size.thickness_m * 1e3)}", ""]
    if (one := model.extended) is not None:
        lines += ["[extended]  # touches with one finger", f"finger = {_text(one.finger)}",
                  f"posture = {_text(one.posture)}",
                  *([] if one.lean_rad is None else [f"lean_deg = {_degrees(one.lean_rad)}"]), ""]
    if (pair := model.opposed) is not None:
        lines += ["[opposed]  # two fingers whose tips close towards each other",
                  f"fingers = [{', '.join(map(_text, pair.fingers))}]",
                  f"start = {_text(pair.start)}", f"end = {_text(pair.end)}", ""]
    return lines


def _finger(finger: Finger, mark: str) -> list[str]:
    lines = ["[[finger]]", f"name = {_text(finger.name)}", f"tip_mm = {_mm(finger.tip_m)}{mark}",
             f"pads = [{', '.join(map(_text, finger.pads))}]{mark}", ""]
    for place in finger.pad_places:
        lines += ["[[finger.pad]]", f"link = {_text(place.joint)}",
                  f"axis_mm = [{_mm(place.start)}, {_mm(place.end)}]",
                  f"radius_mm = {_number(place.radius * 1e3)}",
                  f"side = [{', '.join(map(_number, place.out))}]", ""]
    for joint in finger.joints:
        lines += _joint(joint, mark)
    return lines


def _joint(joint: HandJoint, mark: str) -> list[str]:
    lines = ["[[finger.joint]]", f"name = {_text(joint.name)}", *_place(joint.place),
             f"axis = [{', '.join(map(_number, joint.axis))}]",
             f"limits_deg = [{_degrees(joint.low_rad)}, {_degrees(joint.high_rad)}]",
             f"effort_Nm = {_number(joint.effort_Nm)}",
             f"stiffness_Nm_rad = {_number(joint.stiffness_Nm_rad)}{mark}"]
    if joint.follows is not None:
        f = joint.follows
        lines.append(f"follows = {{ joint = {_text(f.joint)}, factor = {_number(f.factor)}, "
                     f"offset_deg = {_degrees(f.offset_rad)} }}")
    lines.append("")
    for shape in joint.shapes:
        lines += ["[[finger.joint.shape]]", *_shape(shape), ""]
    return lines


def _shape(shape: Shape) -> list[str]:
    if isinstance(shape, Box):
        lines = [f"box_mm = {_mm(shape.size)}", *_place(shape.place)]
    else:
        lines = [f"capsule_mm = [{_mm(shape.start)}, {_mm(shape.end)}]",
                 f"radius_mm = {_number(shape.radius * 1e3)}"]
    if shape.fit_error_m:
        lines.append(f"fit_error_mm = {_number(shape.fit_error_m * 1e3)}")
    return lines


def _place(place: Place) -> list[str]:
    return [f"at_mm = {_mm(place[:3])}", f"turn = [{', '.join(map(_number, place[3:]))}]"]


def _mm(values: Iterable[float]) -> str:
    return f"[{', '.join(_number(v * 1e3) for v in values)}]"


def _degrees(value: float) -> str:
    return _number(math.degrees(value))


def _number(value: float) -> str:
    """Fourteen digits: lengths to 1e-14 m, angles to 1e-14 rad."""
    text = f"{value:.14g}"
    return "0.0" if float(text) == 0.0 else text if any(c in text for c in ".en") else f"{text}.0"


def _text(value: str) -> str:
    """A TOML string, also good as a quoted key."""
    escaped = "".join(
        {'"': r"\"", "\\": r"\\"}.get(c, c if c.isprintable() else f"\\U{ord(c):08x}")
        for c in value)
    return f'"{escaped}"'
