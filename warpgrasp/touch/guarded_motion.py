"""The second guarded move: the arm or a finger along a line, in intervals, until a pad feels.

After each interval two checks are made (Allen and Michelman 1990, section IV-D): does a pad of the
finger feel, and did the finger move the whole distance by its measured joint angles? The hand moves
along a straight line, or the finger along its commands, or both. A pressed finger yields by the
energy of `pad_equilibrium`. The same move backwards ends when the pads feel nothing any more.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp

from warpgrasp.arms.arm_model import ArmModel
from warpgrasp.chain.chain_hand import ChainHand, chain_of_table, chain_rows, padded, true_chains
from warpgrasp.chain.chain_kernel import vec6
from warpgrasp.chain.chain_move import palm_bars
from warpgrasp.chain.chain_pads import own_pads, pad_places
from warpgrasp.chain_closing.chain_path import no_chain_errors
from warpgrasp.core.array_checks import check_poses, check_range
from warpgrasp.core.dtypes import real, transform
from warpgrasp.core.kernel_launch import ShapeError, launch
from warpgrasp.core.struct_array import Records, record_type
from warpgrasp.geometry.scene import Scene
from warpgrasp.mechanism.arm import arm_of, serial_model
from warpgrasp.mechanism.calibration import Calibration, true_arms, true_hands
from warpgrasp.mechanism.utah_mit_hand import FINGER_COUNT, LINK_COUNT, hand_of
from warpgrasp.motion_cost import line_time_s, was_made
from warpgrasp.parameters import (
    TAXELS,
    ArmTable,
    ContactTable,
    HandTable,
    PadTable,
    SensorTable,
    TrueTables,
)
from warpgrasp.touch.chain_line_kernel import chain_line_kernel
from warpgrasp.touch.guarded_motion_kernel import line_kernel
from warpgrasp.touch.line_record import LineBegin, LineEnd
from warpgrasp.touch.line_touch import LineMove, LineTouch, LineTruth, Until, check_rows
from warpgrasp.touch.pad import (
    chain_pad_turns,
    chain_pads,
    pad_of,
    pad_turns,
    true_chain_pads,
    true_pads,
)
from warpgrasp.touch.pad_culling import BLOCKS

_LONGER = 1.03
"""Links that are true are no longer than believed by more."""


@dataclass(frozen=True)
class _LineRobot:
    """Robots, believed and true, on a device, as a kernel of a guarded line takes them."""

    kernel: Any
    shapes: dict[str, str]
    arguments: dict[str, Any]
    reach_m: float
    """From a finger's base to the farthest place of its skin."""
    joints: int
    """Angles of a finger."""
    link: np.ndarray
    """The link's number of each pad, (pad 3,)."""
    kept: Any = None
    """What lives as long."""


@lru_cache(maxsize=16)
def _robot(
    arm: ArmTable, hand: HandTable, true_hand: HandTable, pads: PadTable, contact: ContactTable,
    errors: Calibration, finger: int, device: str, chain: ChainHand | None, model: ArmModel | None
) -> _LineRobot:
    """The robots, kept for the next line; `chain` and `model` are those of the tables, whose files
    may have changed."""
    check_range("finger", finger, 0, (FINGER_COUNT if chain is None else chain.fingers) - 1)
    arms = {"arm": arm_of(arm, hand.mount_length_m),
            "true_arms": true_arms(arm, hand.mount_length_m, errors, device),
            "mount": wp.array(errors.mount, dtype=transform, device=device)}
    if chain is not None:
        return _chain_robot(arms, chain, hand, true_hand, own_pads(chain, pads), contact, errors,
                            finger, device)
    reach = (true_hand.abduction_offset_m + sum(true_hand.link_length_m) + true_hand.link_radius_m
             + pads.thickness_m)
    return _LineRobot(
        line_kernel, {"true_hands": "world? 4", "true_pads": "world? 4", "commands": "4 step 4"}, {
            **arms, "hand": hand_of(hand), "pad": pad_of(pads, hand),
            "turns": pad_turns(pads, true_hand, device),
            "true_hands": true_hands(true_hand, contact, errors, device),
            "true_pads": true_pads(pads, true_hand, errors, device)},
        reach, 4, np.arange(LINK_COUNT))


def _chain_robot(
    arms: dict[str, Any], chain: ChainHand, hand: HandTable, true_hand: HandTable, pads: PadTable,
    contact: ContactTable, errors: Calibration, finger: int, device: str
) -> _LineRobot:
    none = no_chain_errors(chain)
    pad, rows = chain_pads(chain, finger, pads, device)
    true, true_rows = true_chain_pads(chain, pads, errors, device)
    chains, *_ = chain_rows(chain, hand, contact, none)
    joint: Any = rows.numpy()
    radii = [place.radius for place in pad_places(chain, finger, pads)]
    return _LineRobot(
        chain_line_kernel, {"hands": "1 finger", "true_hands": "world? finger", "palm": "bar",
                            "true_pads": "world? finger", "commands": "finger step"}, {
            **arms, "hands": true_chains(chain, hand, contact, none, device), "pad": pad,
            "turns": chain_pad_turns(pads, chain, finger, device),
            "true_hands": true_chains(chain, true_hand, contact, errors, device),
            "true_pads": true, "palm": palm_bars(chain, true_hand, device)},
        _LONGER * (float(chains["reach"][0, finger]) + max(radii, default=0.0)
                   + pads.thickness_m), chain.width, joint["joint"], (rows, true_rows))


@lru_cache(maxsize=32)
def _commands(
    shape: tuple[int, ...], commands: bytes, finger: int, chain: bool, device: str
) -> tuple[wp.array, float]:
    """Commands on a device, and the most that a finger's joints turn in one of them [rad]; kept for
    the next line along them."""
    there = np.frombuffer(commands).reshape(shape)
    turned = np.abs(np.diff(there[finger], axis=0)).sum(-1).max(initial=0.0)
    if chain:
        return wp.array(padded(there), dtype=vec6, device=device), turned
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
    """Make one guarded line; also returns the arms' joints after it (row, 7).

    `body` (world or 1,), `body_pose` (world, 7), `key` (world,) uint64, `errors` of the true
    robots, whose tables are `true` (those believed unless given), `arm_q_rad` (row, 7) where the
    arms stand. Worlds not among `move.rows` cost nothing. Raises ShapeError, and ValueError for a
    body, a world or a finger that there is not, and for a pose of an object (of a world that moves)
    that is no place and unit quaternion.
    """
    check_range("body", body, 0, scene.bodies - 1)
    check_rows(move.rows, len(key))
    n = len(move.rows)
    true_hand, true_sensors = (hand, sensors) if true is None else (true.hand, true.sensors)
    begin = np.zeros(n, record_type(LineBegin))
    for name, value in {
            "body": np.broadcast_to(body, len(key))[move.rows], "body_pose": body_pose[move.rows],
            "world": move.rows, "key": key[move.rows], "number": move.number,
            "start": move.hand_pose, "direction": move.direction, "arm_q": arm_q_rad,
            "interval": move.interval_m, "steps": move.steps,
            "until_release": np.equal(move.until, Until.RELEASE)}.items():
        column = begin[name]
        if np.shape(value) not in ((), column.shape):
            raise ShapeError(f"guarded line: {name!r} has shape {np.shape(value)}, "
                             f"wants {column.shape}")
        column[...] = value
    check_poses("body_pose", body_pose, np.isin(np.arange(len(body_pose)), move.rows))
    speed = np.linalg.norm(move.direction, axis=1)
    robot = _robot(arm, hand, true_hand, pads, contact or ContactTable(), errors, move.finger,
                   device, chain_of_table(hand), serial_model(arm))
    commands, swing = _commands(
        np.shape(move.commands_rad), np.ascontiguousarray(move.commands_rad, float).tobytes(),
        move.finger, robot.kernel is chain_line_kernel, device)
    images = wp.zeros((n, TAXELS, TAXELS), dtype=wp.uint8, device=device)
    near_bits = wp.empty((n, LINK_COUNT, BLOCKS**2), dtype=int, device=device)
    begins, ends = Records(LineBegin, begin, device), Records(LineEnd, (n,), device)
    launch(robot.kernel, {"row": n}, {
        "turns": "turn", "true_arms": "world?", "mount": "world?", "begins": "row",
        "near_bits": "row 3 16", "image": "row 16 16", "ends": "row", **robot.shapes}, {
        "scene": scene, **robot.arguments,
        "joint_noise": true_sensors.joint_noise_rad, "march_scale": march_scale,
        "begins": begins.array,
        "finger": move.finger, "commands": commands, "swing": swing * robot.reach_m,
        "checked": int(move.checked), "near_bits": near_bits, "image": images,
        "ends": ends.array}, device=device, heavy=True)
    end, image = ends.numpy(), images.numpy().copy()
    gone = end["made"] * move.interval_m * speed
    touch = LineTouch(
        status=end["status"], link=np.where(end["link"] < 0, -1, robot.link[end["link"]]),
        point_m=end["point"], normal=end["normal"],
        tip_m=end["tip"], hand_pose=end["believed"], q_rad=end["q_read"][:, :robot.joints],
        taxel_peak=end["peak"],
        image=image, steps=end["made"],
        is_touch=was_made(end["status"]) & (move.until == Until.CONTACT),
        time_s=end["arm_time"] + line_time_s(arm, move.commands_rad[move.finger], end["made"],
                                            end["line_time"]),
        path_m=end["arm_path"] + gone)
    # Copies: a truth is kept for the whole episode, and a view would keep all of the record.
    truth = LineTruth(move.rows, end["q_true"][:, :robot.joints].copy(), end["point_true"].copy(),
                      end["normal_true"].copy(), end["force_true"].copy(),
                      end["on_table"].astype(bool), end["pose_true"].copy())
    return touch, truth, end["arm_q"]
