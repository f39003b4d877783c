"""Hands from files: those that ship, by name, and a user's own TOML.

`hand_text` writes what is read here.
"""

import math
from functools import lru_cache
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from warpgrasp.hands.hand_checks import NEAR, check_closings, check_hand
from warpgrasp.hands.hand_model import (
    STILL,
    Box,
    Capsule,
    Extended,
    Finger,
    Follow,
    HandClosing,
    HandError,
    HandJoint,
    HandModel,
    Opposed,
    PadPlace,
    PadSize,
    Place,
    Posture,
    Shape,
)
from warpgrasp.hands.strict_toml import read_strict

_DATA = Path(__file__).parent / "data"
SHIPPED = ("utah_mit", "allegro", "leap", "barrett")
ACROSS = 0.5
"""Share of a pad's side across its axis, least."""
_IDLE = {"box": (("radius_mm",), "box_mm, at_mm and turn are all of it"),
         "capsule": (("at_mm", "turn"), "capsule_mm says where its ends are")}
"""Of each kind of shape the keys that would say nothing, and why."""
_Three = tuple[float, float, float]
_Word = Annotated[str, Field(min_length=1, max_length=80)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class _Place(_Strict):
    at_mm: _Three
    turn: tuple[float, float, float, float]


class _Shape(_Strict):
    box_mm: _Three | None = None
    at_mm: _Three = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    capsule_mm: tuple[_Three, _Three] | None = None
    radius_mm: float = 0.0
    fit_error_mm: float = 0.0


class _Follow(_Strict):
    joint: _Word
    factor: float
    offset_deg: float


class _Joint(_Place):
    name: _Word
    axis: _Three
    limits_deg: tuple[float, float]
    effort_Nm: float
    stiffness_Nm_rad: float
    follows: _Follow | None = None
    shape: list[_Shape] = []


class _Pad(_Strict):
    link: _Word
    axis_mm: tuple[_Three, _Three]
    radius_mm: float = Field(gt=0.0)
    side: _Three


class _PadSize(_Strict):
    width_mm: float = Field(ge=0.5)
    length_mm: float = Field(ge=0.5)
    wrap_deg: float = Field(ge=0.0, le=90.0)
    thickness_mm: float = Field(ge=0.01, le=50.0)


class _Extended(_Strict):
    finger: _Word
    posture: _Word
    lean_deg: float | None = Field(default=None, ge=0.0, le=90.0)


class _Opposed(_Strict):
    fingers: tuple[_Word, _Word]
    start: _Word
    end: _Word


class _Finger(_Strict):
    name: _Word
    tip_mm: _Three
    pads: list[str] = []
    joint: list[_Joint]
    pad: list[_Pad] = []


class _Closing(_Strict):
    start: _Word
    end: _Word
    moves: list[str]


class _Hand(_Strict):
    name: _Word
    source: str = ""
    licence: str = ""
    thumb: str = ""
    senses: str
    grasp_frame: _Place
    postures: dict[_Word, dict[str, float]]
    closings: dict[_Word, _Closing]
    palm: list[_Shape] = []
    finger: list[_Finger]
    pads: _PadSize | None = None
    extended: _Extended | None = None
    opposed: _Opposed | None = None


@lru_cache(maxsize=len(SHIPPED))
def hand_named(name: str) -> HandModel:
    """A hand that ships. Raises HandError for another name."""
    if name not in SHIPPED:
        of_file = " (in Python, hand_from_file reads one)" if name.endswith(".toml") else (
            ", whose name ends in .toml")
        raise HandError(f"hand {name!r}; should be one of {', '.join(SHIPPED)}, or a TOML file"
                        f"{of_file}")
    return hand_from_file(_DATA / f"{name}.toml")


def hand_from_file(file: Path) -> HandModel:
    """A hand from a TOML file. Raises HandError with the file, the element, and what would be
    right."""
    given = read_strict(file, _Hand, HandError, "warpgrasp hand URDF -o FILE")
    try:
        model = check_hand(_model(given))
        check_closings(model)
    except HandError as error:
        raise HandError(f"{file}: {error}") from None
    return model


def _model(given: _Hand) -> HandModel:
    return HandModel(
        given.name, given.source, given.licence, _place(given.grasp_frame, "grasp_frame"),
        tuple(_shape(shape, f"palm[{n}]") for n, shape in enumerate(given.palm)),
        tuple(_finger(finger) for finger in given.finger), given.thumb, given.senses,
        tuple(Posture(name, tuple((joint, math.radians(v)) for joint, v in angles.items()))
              for name, angles in given.postures.items()),
        tuple(HandClosing(name, path.start, path.end, tuple(path.moves))
              for name, path in given.closings.items()),
        given.pads and PadSize(given.pads.width_mm / 1e3, given.pads.length_mm / 1e3,
                               math.radians(given.pads.wrap_deg), given.pads.thickness_mm / 1e3),
        given.extended and Extended(
            given.extended.finger, given.extended.posture,
            None if given.extended.lean_deg is None else math.radians(given.extended.lean_deg)),
        given.opposed and Opposed(given.opposed.fingers, given.opposed.start, given.opposed.end))


def _finger(given: _Finger) -> Finger:
    return Finger(given.name, tuple(_joint(joint) for joint in given.joint), _metres(given.tip_mm),
                  tuple(given.pads), tuple(_pad(pad, given.name) for pad in given.pad))


def _pad(given: _Pad, finger: str) -> PadPlace:
    start, end = (_metres(at) for at in given.axis_mm)
    along = [b - a for a, b in zip(start, end, strict=True)]
    length, size = math.hypot(*along), math.hypot(*given.side)
    if length < NEAR or size < NEAR:
        raise HandError(f"finger {finger}: pad on {given.link}: an axis or a side without length; "
                        "should be two places apart, and a direction across them")
    lean = sum(a * b for a, b in zip(along, given.side, strict=True)) / length
    x, y, z = (s - lean * a / length for s, a in zip(given.side, along, strict=True))
    across = math.hypot(x, y, z)
    if across < ACROSS * size:
        raise HandError(f"finger {finger}: pad on {given.link}: its side points along its axis; "
                        "should point across it")
    return PadPlace(given.link, start, end, given.radius_mm / 1e3,
                    (x / across, y / across, z / across))


def _joint(given: _Joint) -> HandJoint:
    where = f"joint {given.name}"
    follows = given.follows and Follow(given.follows.joint, given.follows.factor,
                                       math.radians(given.follows.offset_deg))
    low, high = (math.radians(v) for v in given.limits_deg)
    return HandJoint(given.name, _place(given, where), given.axis, low, high, given.effort_Nm,
                     given.stiffness_Nm_rad, follows,
                     tuple(_shape(shape, where) for shape in given.shape))


def _shape(given: _Shape, where: str) -> Shape:
    if (given.box_mm is None) == (given.capsule_mm is None):
        raise HandError(f"{where}: a shape without box_mm or capsule_mm, or with both; should have "
                        "one of them")
    kind = "capsule" if given.box_mm is None else "box"
    idle, why = _IDLE[kind]
    for key in idle:
        if key in given.model_fields_set:
            raise HandError(f"{where}: a {kind} with {key}; should be without, for {why}")
    if given.box_mm is not None:
        return Box(_place(given, where), _metres(given.box_mm), given.fit_error_mm / 1e3)
    start, end = given.capsule_mm or (STILL[:3], STILL[:3])
    return Capsule(_metres(start), _metres(end), given.radius_mm / 1e3, given.fit_error_mm / 1e3)


def _place(given: _Place | _Shape, where: str) -> Place:
    size = math.hypot(*given.turn)
    if not abs(size - 1.0) < 1e-6:
        raise HandError(f"{where}: turn is of length {size:.6g}; should be a quaternion of length "
                        "1")
    a, b, c, d = (v / size for v in given.turn)
    return (*_metres(given.at_mm), a, b, c, d)


def _metres(given: _Three) -> _Three:
    x, y, z = given
    return x / 1e3, y / 1e3, z / 1e3
