"""Guarded closing of any hand whose fingers are chains, each guarded by what it feels.

All fingers of all grasps of all probes of all worlds close in one launch, and what is felt where
they stop is read in a second one.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import warp as wp

from warpgrasp.chain.chain_hand import ChainHand, padded, true_chains
from warpgrasp.chain.chain_kernel import CAPSULES, vec6
from warpgrasp.chain.torque_sensor import command_range, true_sensors
from warpgrasp.chain_closing.chain_closing_kernels import chain_closing_kernel, chain_reading_kernel
from warpgrasp.chain_closing.chain_meeting import CLOSE_M, pairs_on_device, resolve_meetings
from warpgrasp.chain_closing.chain_path import come_bounds, no_chain_errors
from warpgrasp.chain_closing.chain_record import ChainClosingRow, ChainTruthRow
from warpgrasp.chain_closing.chain_slack import pair_slack, path_gaps
from warpgrasp.closing.closing import Closing, ClosingTruth
from warpgrasp.core.array_checks import check_range
from warpgrasp.core.dtypes import real
from warpgrasp.core.kernel_launch import array_of, launch_in_turn, poses_of
from warpgrasp.core.lanes import has_lanes
from warpgrasp.core.random import Purpose, counter_key
from warpgrasp.core.struct_array import Records
from warpgrasp.geometry.scene import Scene
from warpgrasp.mechanism.calibration import Calibration
from warpgrasp.parameters import ContactTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.rubbing.chain_balance import ChainGrip


@dataclass(frozen=True)
class ChainClosing(Closing):
    """What the robot knows of a closing of a hand of chains; its tensions are NaN."""

    torque_Nm: np.ndarray
    """Mean torques read at rest [N m], the believed weight taken off, (..., drive)."""
    stop_reading: np.ndarray
    """The reading that stopped the finger, [N m], of a switch [N]; NaN without a stop."""


_EACH = "world probe grasp finger"
_SHAPES = {
    "body": "world?", "body_pose": "world", "hands": "world? finger", "believed": "1 finger",
    "sensors": "world? finger", "key": "world", "probe_number": "world probe",
    "probe_status": "world probe grasp", "closes": "world? probe? finger",
    "hand_pose": "world probe", "path": "grasp finger step",
    "come": f"grasp finger {CAPSULES} step", "command_count": "grasp", "felt": _EACH,
    "truth": _EACH, "ended": "world? probe? grasp? finger?"}


def close_chains(
    scene: Scene,
    body: np.ndarray,
    body_pose: np.ndarray,
    hand: ChainHand,
    table: HandTable,
    sensors: SensorTable,
    key: np.ndarray,
    probe_status: np.ndarray,
    hand_pose: np.ndarray,
    commands_rad: np.ndarray,
    command_count: np.ndarray,
    *,
    contact: ContactTable | None = None,
    errors: Calibration | None = None,
    closes: np.ndarray | None = None,
    probe_number: np.ndarray | None = None,
    march_scale: float = 1.0,
    device: str = "cpu",
) -> tuple[ChainClosing, ClosingTruth]:
    """Close every finger of every grasp at every probe, guarded by what the hand feels.

    As `closing.close_fingers`, with `hand` in place of the Utah-MIT's, and of `table` the numbers
    that any hand has: skin, stops, density. `commands_rad` has shape (grasp, finger, step, width),
    angles of drives. Links are numbered by their joints. Raises ShapeError, and ValueError for a
    body or a count of steps that there is not, for a pose that is no place and unit quaternion, and
    for what `closing_misfit` says.
    """
    check_range("body", body, 0, scene.bodies - 1)
    check_range("command_count", command_count, 1, np.shape(commands_rad)[2])
    worlds, probes = hand_pose.shape[:2]
    if probe_number is None:
        probe_number = np.tile(np.arange(probes), (worlds, 1))
    if closes is None:
        closes = np.ones((1, 1, hand.fingers), bool)
    extents = {"world": worlds, "probe": probes, "grasp": len(command_count),
               "finger": hand.fingers}
    dims = tuple(extents.values())
    felt, truth = (Records(row, dims, device, clear=False)
                   for row in (ChainClosingRow, ChainTruthRow))
    contact = contact or ContactTable()
    rubs = contact.friction > 0.0
    ended = Records(ChainGrip, dims if rubs else (1, 1, 1, 1), device, clear=False)
    none = no_chain_errors(hand)
    errors = errors or none

    def there(values: np.ndarray, dtype: type) -> wp.array:
        return array_of(values, dtype, device)

    commands = np.ascontiguousarray(commands_rad, np.float64)
    path, come = _on_device(hand, table, contact, errors, commands.shape, commands.tobytes(),
                            device)
    given = {
        "scene": scene, "body": there(body, int),
        "body_pose": poses_of("body_pose", body_pose, device),
        "hands": true_chains(hand, table, contact, errors, device),
        "believed": true_chains(hand, table, contact, none, device),
        "sensors": true_sensors(hand, table, sensors, contact, errors, device,
                                command_range(commands)),
        "key": there(counter_key(key, int(Purpose.CLOSING)), wp.uint64),
        "probe_number": there(probe_number, int), "hand_pose": poses_of(
            "hand_pose", hand_pose, device, (probe_status == ProbeStatus.CONTACT).any(-1)),
        "path": path, "felt": felt.array, "truth": truth.array}
    counts = {"command_count": there(command_count, int)}
    closing = (chain_closing_kernel, _SHAPES, given | counts | {
        "has_lanes": has_lanes(device), "march_scale": march_scale,
        "probe_status": there(probe_status, int), "come": come, "ended": ended.array,
        "closes": wp.array(closes, dtype=int, device=device)})
    reading = (chain_reading_kernel, _SHAPES, given)
    if contact.self_contact:
        launch_in_turn(extents, [closing], device=device, heavy=True)
        resolve_meetings(hand, felt.numpy()["status"][..., 0],
                         *_slack(hand, table, contact, errors, commands.shape, commands.tobytes(),
                                 device),
                         given | counts | {"come": come, "ended": ended.array}, rubs, device)
        launch_in_turn(extents, [reading], device=device, heavy=True)
    else:
        launch_in_turn(extents, [closing, reading], device=device, heavy=True)
    row, true, width = felt.numpy(), truth.numpy(), hand.width
    return (ChainClosing(
                row["status"], row["step"], row["q"][..., :width],
                np.full((*dims, width, 2), np.nan), np.full(dims, np.nan),
                row["torque"][..., :width], row["reading"]),
            ClosingTruth(true["q"][..., :width], true["rest"][..., :width],
                         true["torque"][..., :width], true["link"], true["point"], true["normal"],
                         true["on_table"].astype(bool), true["self_depth"] > 0.0,
                         true["touched"] >= 0))


@lru_cache(maxsize=32)
def _on_device(
    hand: ChainHand, table: HandTable, contact: ContactTable, errors: Calibration,
    shape: tuple[int, ...], commands: bytes, device: str
) -> tuple[wp.array, wp.array]:
    """Commands and bounds of a path, kept for the next launch along the same commands."""
    commands_rad = np.frombuffer(commands).reshape(shape)
    return (wp.array(padded(commands_rad), dtype=vec6, device=device),
            wp.array(come_bounds(hand, table, contact, errors, commands_rad), dtype=real,
                     device=device))


@lru_cache(maxsize=8)
def _slack(
    hand: ChainHand, table: HandTable, contact: ContactTable, errors: Calibration,
    shape: tuple[int, ...], commands: bytes, device: str
) -> tuple[wp.array, wp.array]:
    """How near pairs of capsules can come, kept for the next launch of the same robots."""
    _, _, pairs = pairs_on_device(hand, CLOSE_M, device)
    return pair_slack(hand, table, contact, errors, np.frombuffer(commands).reshape(shape),
                      _gaps(hand, table, shape, commands, device), pairs, device)


@lru_cache(maxsize=16)
def _gaps(
    hand: ChainHand, table: HandTable, shape: tuple[int, ...], commands: bytes, device: str
) -> np.ndarray:
    """How near pairs come on a path of the hand that is believed, kept for all robots."""
    commands_rad = np.frombuffer(commands).reshape(shape)
    palm, _, pairs = pairs_on_device(hand, CLOSE_M, device)
    come = come_bounds(hand, table, ContactTable(weight=False), no_chain_errors(hand), commands_rad)
    return path_gaps(hand, commands_rad, wp.array(come, dtype=real, device=device), palm, pairs,
                     device)
