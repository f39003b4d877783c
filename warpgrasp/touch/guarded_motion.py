"""The second guarded move: the arm or a finger along a line, in intervals, until a pad feels.

After each interval two checks are made (Allen and Michelman 1990, section IV-D): does a pad of the
finger feel, and did the finger move the whole distance by its measured joint angles? The hand moves
along a straight line, or the finger along its commands, or both. A pressed finger yields by the
energy of `pad_equilibrium`. The same move backwards ends when the pads feel nothing any more.
"""

from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from warpgrasp.core.dtypes import real, transform
from warpgrasp.core.kernel_launch import ShapeError, check_range, launch
from warpgrasp.core.struct_array import Records, record_type
from warpgrasp.geometry.scene import Scene
from warpgrasp.mechanism.arm import arm_of
from warpgrasp.mechanism.calibration import Calibration, true_arms, true_hands
from warpgrasp.mechanism.utah_mit_hand import FINGER_COUNT, LINK_COUNT, hand_of
from warpgrasp.motion_cost import line_time_s, was_made
from warpgrasp.parameters import (
    ArmTable,
    ContactTable,
    HandTable,
    PadTable,
    SensorTable,
    TrueTables,
)
from warpgrasp.touch.guarded_motion_kernel import line_kernel
from warpgrasp.touch.line_record import LineBegin, LineEnd
from warpgrasp.touch.pad import pad_of, pad_turns, true_pads
from warpgrasp.touch.pad_culling import BLOCKS
from warpgrasp.touch.pad_kernel import TAXELS


class Until(IntEnum):
    """What ends a guarded line."""

    CONTACT = 0
    RELEASE = 1
    """A pad that felt feels no more: status NO_CONTACT."""


@dataclass(frozen=True)
class LineTouch:
    """What the robots know of a guarded line. A row for each robot that moved."""

    status: np.ndarray
    """ProbeStatus, shape (row,): CONTACT, NO_CONTACT (spent, or released), BLOCKED, UNREACHABLE,
    COLLISION (the finger is pushed away, or hand strikes, already where the line starts)."""
    link: np.ndarray
    """Link whose pad felt (0 proximal to 2 distal), -1 without a touch."""
    point_m: np.ndarray
    """Believed contact, base frame [m], (row, 3); NaN without a touch."""
    normal: np.ndarray
    """Believed outward normal of the surface: against the pad's, (row, 3)."""
    tip_m: np.ndarray
    """Believed place of the fingertip's centre [m], (row, 3)."""
    hand_pose: np.ndarray
    """Believed hand pose at the end, [m] and quaternion xyzw, (row, 7)."""
    q_rad: np.ndarray
    """Joint angles of the finger as read, (row, 4)."""
    taxel_peak: np.ndarray
    """Largest count of the pad that felt, or that bore most where the line was blocked; else 0."""
    image: np.ndarray
    """Its counts, uint8, (row, 16, 16)."""
    steps: np.ndarray
    """Intervals made."""
    is_touch: np.ndarray
    """Whether it counts as a touch, felt or not (see `motion_cost`); never one until RELEASE."""
    time_s: np.ndarray
    """Move to the start, the intervals, and the finger's way back to its first command."""
    path_m: np.ndarray
    """Path of the hand's origin, straight to the start and along the intervals [m]."""


@dataclass(frozen=True)
class LineTruth:
    """The true outcome, for the scorer alone."""

    rows: np.ndarray
    """World of each row."""
    q_rad: np.ndarray
    """(row, 4)."""
    point_m: np.ndarray
    """Surface point at the pad's centre of force, base frame [m], (row, 3); NaN without load."""
    normal: np.ndarray
    """Outward surface normal there, (row, 3)."""
    force_N: np.ndarray
    """On all taxels together, (row,)."""
    on_table: np.ndarray
    """Whether the table, not the object, was touched."""
    hand_pose: np.ndarray
    """(row, 7)."""


@dataclass(frozen=True)
class LineMove:
    """One guarded line for some of the worlds, row by row."""

    rows: np.ndarray
    """Worlds that move, (row,)."""
    number: np.ndarray
    """How many lines each of them has made before, (row,): seeds the noise."""
    hand_pose: np.ndarray
    """Where the line starts, as believed, [m] and quaternion xyzw, (row, 7)."""
    direction: np.ndarray
    """Way of the arm in one interval, in units of it, base frame, (row, 3): a unit vector, a
    shorter one for shorter intervals, zero where the arm stays."""
    interval_m: float
    steps: int
    finger: int
    """Whose pads count: 0 to 2, 3 the thumb."""
    commands_rad: np.ndarray
    """Joint commands of all fingers at each interval, (finger 4, step, 4), the last one held; the
    fingers that do not probe stay at their first."""
    until: Until = Until.CONTACT
    checked: bool = False
    """Whether the way to the start is looked at: see `Robot.guarded_line`."""


@lru_cache(maxsize=8)
def _robot(
    arm: ArmTable, hand: HandTable, true_hand: HandTable, pads: PadTable, contact: ContactTable,
    errors: Calibration, device: str
) -> dict[str, Any]:
    """The robots, believed and true, on a device; kept for the next line."""
    return {"arm": arm_of(arm, hand.mount_length_m), "hand": hand_of(hand),
            "pad": pad_of(pads, hand), "turns": pad_turns(pads, hand, device),
            "true_arms": true_arms(arm, hand.mount_length_m, errors, device),
            "true_hands": true_hands(true_hand, contact, errors, device),
            "true_pads": true_pads(pads, true_hand, errors, device),
            "mount": wp.array(errors.mount, dtype=transform, device=device)}


@lru_cache(maxsize=32)
def _commands(
    shape: tuple[int, ...], commands: bytes, finger: int, device: str
) -> tuple[wp.array, float]:
    """Commands on a device, and the most that a finger's joints turn in one of them [rad]; kept for
    the next line along them."""
    there = np.frombuffer(commands).reshape(shape)
    turned = np.abs(np.diff(there[finger], axis=0)).sum(-1).max(initial=0.0)
    return wp.array(there, dtype=real, device=device), turned


def guarded_line(
    scene: Scene,
    body: np.ndarray,
    body_pose: np.ndarray,
    arm: ArmTable,
    hand: HandTable,
    sensors: SensorTable,
    pads: PadTable,
    key: np.ndarray,
    errors: Calibration,
    arm_q_rad: np.ndarray,
    move: LineMove,
    *,
    true: TrueTables | None = None,
    contact: ContactTable | None = None,
    march_scale: float = 1.0,
    device: str = "cpu",
) -> tuple[LineTouch, LineTruth, np.ndarray]:
    """Make one guarded line; also returns the arms' joints after it (row, 6).

    `body` (world or 1,), `body_pose` (world, 7), `key` (world,) uint64, `errors` of the true
    robots, whose tables are `true` (those believed unless given), `arm_q_rad` (row, 6) where the
    arms stand. Worlds not among `move.rows` cost
    nothing. Raises ShapeError, and ValueError for a body or a finger that there is not.
    """
    check_range("body", body, 0, scene.bodies - 1)
    check_range("finger", move.finger, 0, FINGER_COUNT - 1)
    n = len(move.rows)
    true_hand, true_sensors = (hand, sensors) if true is None else (true.hand, true.sensors)
    begin = np.zeros(n, record_type(LineBegin))
    for name, value in {
            "body": np.broadcast_to(body, len(key))[move.rows], "body_pose": body_pose[move.rows],
            "world": move.rows, "key": key[move.rows], "number": move.number,
            "start": move.hand_pose, "direction": move.direction, "arm_q": arm_q_rad}.items():
        column = begin[name]
        if np.shape(value) != column.shape:
            raise ShapeError(f"guarded line: {name!r} has shape {np.shape(value)}, "
                             f"wants {column.shape}")
        column[...] = value
    speed = np.linalg.norm(move.direction, axis=1)
    reach = (true_hand.abduction_offset_m + sum(true_hand.link_length_m) + true_hand.link_radius_m
             + pads.thickness_m)
    commands, swing = _commands(
        np.shape(move.commands_rad), np.ascontiguousarray(move.commands_rad, float).tobytes(),
        move.finger, device)
    images = wp.zeros((n, TAXELS, TAXELS), dtype=wp.uint8, device=device)
    near_bits = wp.empty((n, LINK_COUNT, BLOCKS**2), dtype=int, device=device)
    begins, ends = Records(LineBegin, begin, device), Records(LineEnd, (n,), device)
    launch(line_kernel, {"row": n}, {
        "turns": "40", "true_arms": "world?", "true_hands": "world? 4", "true_pads": "world? 4",
        "mount": "world?", "begins": "row", "commands": "4 step 4", "near_bits": "row 3 16",
        "image": "row 16 16", "ends": "row"}, {
        "scene": scene,
        **_robot(arm, hand, true_hand, pads, contact or ContactTable(), errors, device),
        "joint_noise": true_sensors.joint_noise_rad, "march_scale": march_scale,
        "begins": begins.array,
        "interval": move.interval_m, "steps": move.steps, "finger": move.finger,
        "commands": commands,
        "swing": swing * reach,
        "checked": int(move.checked), "until_release": int(move.until == Until.RELEASE),
        "near_bits": near_bits, "image": images,
        "ends": ends.array}, device=device)
    end, image = ends.numpy(), images.numpy().copy()
    gone = end["made"] * move.interval_m * speed
    touch = LineTouch(
        status=end["status"], link=end["link"], point_m=end["point"], normal=end["normal"],
        tip_m=end["tip"], hand_pose=end["believed"], q_rad=end["q_read"], taxel_peak=end["peak"],
        image=image, steps=end["made"],
        is_touch=was_made(end["status"]) & (move.until == Until.CONTACT),
        time_s=end["arm_time"] + line_time_s(arm, move.commands_rad[move.finger], end["made"],
                                            end["line_time"]),
        path_m=end["arm_path"] + gone)
    # Copies: a truth is kept for the whole episode, and a view would keep all of the record.
    truth = LineTruth(move.rows, end["q_true"].copy(), end["point_true"].copy(),
                      end["normal_true"].copy(), end["force_true"].copy(),
                      end["on_table"].astype(bool), end["pose_true"].copy())
    return touch, truth, end["arm_q"]
