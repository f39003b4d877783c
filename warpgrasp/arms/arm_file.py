"""Arms from files: those that ship, by name, and a user's own TOML."""

import math
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from warpgrasp.arms.arm_model import ARM_JOINTS, ArmError, ArmJoint, ArmModel, Vector
from warpgrasp.hands.hand_model import UNITS_OF_FILES
from warpgrasp.hands.strict_toml import read_strict

_DATA = Path(__file__).parent / "data"
SHIPPED_ARMS = ("ur5e", "panda")
_FARTHEST_M, _SHORTEST_M = 5.0, 0.1
"""Of a joint, base and flange from what is before; of all ways from joint to joint together."""
_MOST_DEG, _LEAST_DEG, _FASTEST_DEG_S, _SLOWEST_DEG_S = 720.5, 12.6, 3600.0, 6.3
"""Of a joint either way; one at least turns farther than the second, two turns in radians, and
faster than the last, a turn a second in radians."""
_Word = Annotated[str, Field(min_length=1, max_length=80)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class _Place(_Strict):
    xyz_mm: Vector
    rpy_deg: Vector


class _Joint(_Place):
    name: _Word
    axis: Vector
    limits_deg: tuple[float, float]
    speed_deg_s: float


class _Arm(_Strict):
    name: _Word
    source: str = ""
    base: _Place
    flange: _Place
    home_deg: list[float]
    joint: list[_Joint]


@lru_cache(maxsize=len(SHIPPED_ARMS))
def arm_named(name: str) -> ArmModel:
    """An arm that ships. Raises ArmError for another name."""
    if name not in SHIPPED_ARMS:
        raise ArmError(f"arm {name!r}; should be one of {', '.join(SHIPPED_ARMS)}, puma560, none, "
                       "or a TOML file, whose name ends in .toml")
    return arm_from_file(_DATA / f"{name}.toml")


def arm_from_file(file: Path) -> ArmModel:
    """An arm from a TOML file. Raises ArmError with the file, the element, and what would be right.
    """
    given = read_strict(file, _Arm, ArmError, "warpgrasp arm URDF -o FILE")
    return check_arm(str(file), ArmModel(
        given.name, tuple(_joint(joint) for joint in given.joint), _m(given.base.xyz_mm),
        _rad(given.base.rpy_deg), _m(given.flange.xyz_mm), _rad(given.flange.rpy_deg),
        tuple(math.radians(v) for v in given.home_deg), given.source))


def check_arm(file: str, arm: ArmModel) -> ArmModel:
    """The arm, its axes made unit vectors. Raises ArmError for one that cannot move."""
    joints = arm.joints
    if not 6 <= len(joints) <= ARM_JOINTS:
        raise ArmError(f"{file}: joint: {len(joints)} joints; should be 6 or {ARM_JOINTS}")
    if len(arm.home_rad) != len(joints):
        raise ArmError(f"{file}: home_deg: {len(arm.home_rad)} angles; should be one for each of "
                       f"the {len(joints)} joints")
    if len({joint.name for joint in joints}) < len(joints):
        raise ArmError(f"{file}: joint: two have the same name; names should differ")
    places = (*arm.base_xyz_m, *arm.base_rpy_rad, *arm.flange_xyz_m, *arm.flange_rpy_rad)
    if not all(map(math.isfinite, places)):
        raise ArmError(f"{file}: base or flange: a number that is not finite; should be finite")
    _check_lengths(file, arm)
    made = []
    for joint, home in zip(joints, arm.home_rad, strict=True):
        where = f"{file}: joint {joint.name}"
        numbers = (*joint.xyz_m, *joint.rpy_rad, *joint.axis, joint.low_rad, joint.high_rad,
                   joint.speed_rad_s)
        if not all(map(math.isfinite, numbers)):
            raise ArmError(f"{where}: a number that is not finite; should be finite")
        size = math.hypot(*joint.axis)
        if size < 1e-9:
            raise ArmError(f"{where}: axis: has no length; should be a direction")
        if not joint.low_rad < joint.high_rad:
            raise ArmError(f"{where}: limits_deg: from {math.degrees(joint.low_rad):g} to "
                           f"{math.degrees(joint.high_rad):g}; the first should be less")
        if not joint.low_rad <= home <= joint.high_rad:
            raise ArmError(f"{file}: home_deg: {math.degrees(home):g} of joint {joint.name} is not "
                           "within its limits")
        if joint.speed_rad_s <= 0.0:
            raise ArmError(f"{where}: speed_deg_s: should be above 0")
        if joint.speed_rad_s > math.radians(_FASTEST_DEG_S):
            raise ArmError(f"{where}: speed {math.degrees(joint.speed_rad_s):.4g} deg/s "
                           f"({joint.speed_rad_s:.4g} rad/s); should be at most "
                           f"{_FASTEST_DEG_S:g} deg/s: {UNITS_OF_FILES}")
        if max(-joint.low_rad, joint.high_rad) > math.radians(_MOST_DEG):
            raise ArmError(f"{where}: limits {math.degrees(joint.low_rad):.4g} to "
                           f"{math.degrees(joint.high_rad):.4g} deg ({joint.low_rad:.4g} to "
                           f"{joint.high_rad:.4g} rad); should be at most 720 deg either way, or "
                           f"the URDF's joint continuous: {UNITS_OF_FILES}")
        made.append(ArmJoint(joint.name, joint.xyz_m, joint.rpy_rad,
                             (joint.axis[0] / size, joint.axis[1] / size, joint.axis[2] / size),
                             joint.low_rad, joint.high_rad, joint.speed_rad_s))
    return ArmModel(arm.name, tuple(made), arm.base_xyz_m, arm.base_rpy_rad, arm.flange_xyz_m,
                    arm.flange_rpy_rad, arm.home_rad, arm.source)


def _check_lengths(file: str, arm: ArmModel) -> None:
    named = [(f"joint {joint.name}", joint.xyz_m) for joint in arm.joints]
    for name, xyz in (*named, ("base", arm.base_xyz_m), ("flange", arm.flange_xyz_m)):
        if (off := math.hypot(*xyz)) > _FARTHEST_M:
            raise ArmError(f"{file}: {name} stands {off:.4g} m ({off * 1e3:,.6g} mm) from what is "
                           f"before it; should be at most {_FARTHEST_M:g} m: {UNITS_OF_FILES}")
    length = sum(math.hypot(*xyz) for _, xyz in named)
    if length < _SHORTEST_M:  # false where a number is not finite, which is said of its joint
        raise ArmError(f"{file}: joint: the ways from joint to joint are {length * 1e3:.4g} mm "
                       f"together; should be {_SHORTEST_M * 1e3:g} mm at least: {UNITS_OF_FILES}")
    fastest = max(math.degrees(joint.speed_rad_s) for joint in arm.joints)
    if 0.0 < fastest < _SLOWEST_DEG_S:
        raise ArmError(f"{file}: joint: the fastest turns by {fastest:.4g} deg/s; should be "
                       f"{_SLOWEST_DEG_S:g} at least: {UNITS_OF_FILES}")
    widest = max(math.degrees(joint.high_rad - joint.low_rad) for joint in arm.joints)
    if 0.0 < widest < _LEAST_DEG:
        raise ArmError(f"{file}: joint: the one with the widest limits turns by {widest:.4g} deg; "
                       f"should be {_LEAST_DEG:g} at least: {UNITS_OF_FILES}")


def arm_text(arm: ArmModel) -> str:
    """The TOML file that `arm_from_file` reads as this arm."""
    lines = ["# An arm: joints in a row. Lengths are in mm, angles in degrees; a joint's frame",
             "# stands in that of the joint before it, turned about fixed x, y and z axes (rpy).",
             "", f"name = {_quoted(arm.name)}", f"source = {_quoted(arm.source)}",
             f"home_deg = {_list(map(math.degrees, arm.home_rad))}", "",
             "[base]  # where the arm stands; the table's top is z = 0",
             f"xyz_mm = {_list(1e3 * v for v in arm.base_xyz_m)}",
             f"rpy_deg = {_list(map(math.degrees, arm.base_rpy_rad))}", "",
             "[flange]  # in the last joint's frame; its z axis points to the hand",
             f"xyz_mm = {_list(1e3 * v for v in arm.flange_xyz_m)}",
             f"rpy_deg = {_list(map(math.degrees, arm.flange_rpy_rad))}"]
    for joint in arm.joints:
        limits = map(math.degrees, (joint.low_rad, joint.high_rad))
        lines += ["", "[[joint]]", f"name = {_quoted(joint.name)}",
                  f"xyz_mm = {_list(1e3 * v for v in joint.xyz_m)}",
                  f"rpy_deg = {_list(map(math.degrees, joint.rpy_rad))}",
                  f"axis = {_list(joint.axis)}", f"limits_deg = {_list(limits)}",
                  f"speed_deg_s = {math.degrees(joint.speed_rad_s):.10g}"]
    return "\n".join(lines) + "\n"


def _joint(given: _Joint) -> ArmJoint:
    low, high = given.limits_deg
    return ArmJoint(given.name, _m(given.xyz_mm), _rad(given.rpy_deg), given.axis,
                    math.radians(low), math.radians(high), math.radians(given.speed_deg_s))


def _m(mm: Vector) -> Vector:
    return mm[0] / 1e3, mm[1] / 1e3, mm[2] / 1e3


def _rad(deg: Vector) -> Vector:
    return math.radians(deg[0]), math.radians(deg[1]), math.radians(deg[2])


def _quoted(text: str) -> str:
    escaped = "".join(c if c.isprintable() else " " for c in text)
    return '"' + escaped.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _list(values: Iterable[float]) -> str:
    return "[" + ", ".join(f"{round(v, 9) + 0.0:.12g}" for v in values) + "]"
