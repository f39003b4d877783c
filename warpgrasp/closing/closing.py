"""Tendon-guarded closing: the contact event of the paper's first exploratory procedure.

All fingers of all grasps of all probes of all worlds close in one launch (`closing_kernel`), and
what is felt where they stop is read in a second one (`reading_kernel`).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from warpgrasp.closing.closing_kernel import closing_kernel
from warpgrasp.closing.closing_kernels import (
    friction_kernel,
    meeting_kernel,
    near_kernel,
    reading_kernel,
)
from warpgrasp.closing.closing_record import ClosingRow, ClosingTruthRow
from warpgrasp.core.array_checks import check_range
from warpgrasp.core.kernel_launch import array_of, launch, launch_in_turn, poses_of
from warpgrasp.core.random import Purpose, counter_key
from warpgrasp.core.struct_array import Records
from warpgrasp.finger.energy import Equilibrium
from warpgrasp.finger.friction import Friction
from warpgrasp.finger.path_table import path_on_device
from warpgrasp.geometry.scene import Scene
from warpgrasp.hand_rest.meetings import Meeting
from warpgrasp.mechanism.calibration import Calibration, no_errors, true_hands, true_tendons
from warpgrasp.mechanism.utah_mit_hand import FINGER_COUNT
from warpgrasp.parameters import ContactTable, HandTable, SensorTable
from warpgrasp.probe_status import ProbeStatus
from warpgrasp.rubbing.balance import Grip


@dataclass(frozen=True)
class ClosingTruth:
    """The true outcome, for the scorer alone. Shapes start with (world, probe, grasp, finger)."""

    q_rad: np.ndarray
    """Joints where the finger stopped [rad], (..., joint)."""
    rest_rad: np.ndarray
    """Joints when all fingers had stopped [rad], (..., joint): others may have pushed a finger."""
    torque_Nm: np.ndarray
    """Joint torques where it stopped [N m], (..., joint)."""
    link: np.ndarray
    """Link that bears the largest force (0 proximal to 2 distal), -1: none on object or table."""
    point_m: np.ndarray
    """Contact on the surface, base frame [m], (..., 3); NaN without contact."""
    normal: np.ndarray
    """Outward surface normal there, (..., 3)."""
    on_table: np.ndarray
    """Whether the table, not the object, was touched."""
    self_contact: np.ndarray
    """Whether another finger or the palm bears most."""
    pressed: np.ndarray
    """Whether a link pressed object or table on the way, felt or not."""


@dataclass(frozen=True)
class Closing:
    """What the robot knows of a closing. Shapes start with (world, probe, grasp, finger).

    A joint of a hand of chains is one of its drives.
    """

    status: np.ndarray
    """ProbeStatus."""
    step: np.ndarray
    """Command at which the finger stopped (its number on the path)."""
    q_rad: np.ndarray
    """Joint angles as read [rad], (..., joint)."""
    tension_N: np.ndarray
    """Mean tensions read at rest [N], (..., joint, flexor and extensor 2)."""
    tension_difference_N: np.ndarray
    """The reading that stopped the finger [N] (largest of the flexions); NaN without a stop."""


_SHAPES = {
    "body": "world?", "body_pose": "world", "hands": "world? 4", "sensors": "world? 4",
    "key": "world", "probe_number": "world probe", "probe_status": "world probe grasp",
    "closes": "world? probe? finger", "hand_pose": "world probe",
    "path": "grasp finger step", "links": "grasp finger 3 step", "command_count": "grasp",
    "near": "world probe grasp", "place": "row", "state": "row 8", "meetings": "row 8",
    "frictions": "row? 4", "grips": "row? 8",
    "felt": "world probe grasp finger", "truth": "world probe grasp finger"}


def close_fingers(
    scene: Scene,
    body: np.ndarray,
    body_pose: np.ndarray,
    hand: HandTable,
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
) -> tuple[Closing, ClosingTruth]:
    """Close every finger of every grasp at every probe, guarded by the tendon difference.

    `body` (world or 1,) numbers the scene's bodies, `body_pose` and `hand_pose` (the true ones) are
    [m] and quaternion xyzw, shapes (world, 7) and (world, probe, 7), in the base frame, the table
    at z = 0. `key` (world,) uint64 seeds the noise, for which `probe_number` (world, probe) numbers
    the probes, each world's from 0 unless given. `probe_status` (world, probe, grasp) says
    CONTACT where the probe is to be made; other values are passed on. `commands_rad` has shape
    (grasp, finger, step, 4), of which `command_count` (grasp,) steps count. `closes` (world or 1,
    probe or 1, finger) says which fingers close, all unless given; the others hold their first
    command, may be pushed there, and end as NO_CONTACT at step 0. `contact` says what acts on the
    fingers; `errors` are those of the true robots, none unless given. `march_scale`
    below 1 has free steps skipped in shorter jumps, to check that skipping changes nothing. Raises
    ShapeError, and ValueError for a body or a count of steps that there is not, and for a pose that
    is no place and unit quaternion (of hands only where a probe is to be made).
    """
    check_range("body", body, 0, scene.bodies - 1)
    check_range("command_count", command_count, 1, np.shape(commands_rad)[2])
    worlds, probes = hand_pose.shape[:2]
    if probe_number is None:
        probe_number = np.tile(np.arange(probes), (worlds, 1))
    if closes is None:
        closes = np.ones((1, 1, FINGER_COUNT), bool)
    extents = {"world": worlds, "probe": probes, "grasp": len(command_count),
               "finger": FINGER_COUNT}
    dims = tuple(extents.values())
    felt, truth = (Records(row, dims, device, clear=False) for row in (ClosingRow, ClosingTruthRow))
    errors, contact = errors or no_errors(), contact or ContactTable()
    path, links = path_on_device(hand, contact, errors, commands_rad, device)
    hands = true_hands(hand, contact, errors, device)
    tendons = true_tendons(hand, sensors, contact, errors, device)

    def there(values: np.ndarray, dtype: type) -> wp.array:
        return array_of(values, dtype, device)

    given = {
        "scene": scene, "body": there(body, int),
        "body_pose": poses_of("body_pose", body_pose, device),
        "hands": hands, "sensors": tendons,
        "key": there(counter_key(key, int(Purpose.CLOSING)), wp.uint64),
        "probe_number": there(probe_number, int), "hand_pose": poses_of(
            "hand_pose", hand_pose, device, (probe_status == ProbeStatus.CONTACT).any(-1)),
        "path": path, "felt": felt.array, "truth": truth.array}
    steps = {"links": links, "command_count": there(command_count, int)}
    closing = (friction_kernel if contact.friction else closing_kernel, _SHAPES, given | steps | {
        "march_scale": march_scale, "probe_status": there(probe_status, int),
        "closes": wp.array(closes, dtype=int, device=device)})
    reading = (reading_kernel, _SHAPES, given)
    if contact.self_contact:
        near = wp.empty(dims[:3], dtype=int, device=device)
        meeting = {"mount": hand.mount_length_m, "near": near}
        launch_in_turn(extents, [closing, (near_kernel, _SHAPES, _named(
            near_kernel, given | steps | meeting))], device=device, heavy=True)
        _resolve(near.numpy(), given | steps | meeting, contact.friction > 0.0, device)
        launch_in_turn(extents, [reading], device=device, heavy=True)
    else:
        launch_in_turn(extents, [closing, reading], device=device, heavy=True)
    row = felt.numpy()
    true = truth.numpy()
    return (Closing(row["status"], row["step"], row["q"], row["tension"], row["difference"]),
            ClosingTruth(true["q"], true["rest"], true["torque"], true["link"], true["point"],
                         true["normal"], true["on_table"].astype(bool), true["self_depth"] > 0.0,
                         true["touched"] >= 0))


def _named(kernel: Any, values: dict[str, Any]) -> dict[str, Any]:
    """Those of the values that a kernel takes."""
    return {a.label: values[a.label] for a in kernel.adj.args if a.label in values}


def _resolve(near: np.ndarray, given: dict[str, Any], rubs: bool, device: str) -> None:
    """Close together the fingers of those hands whose links come near one another."""
    place = np.argwhere(near >= 0).astype(np.int32)
    if len(place) == 0:
        return
    n = len(place)
    state, meetings = (Records(row, (n, 8), device) for row in (Equilibrium, Meeting))
    rubbing = n if rubs else 1
    frictions, grips = (Records(row, (rubbing, count), device)
                        for row, count in ((Friction, 4), (Grip, 8)))
    # Here worlds are no axis of the launch: their number is stated by an array that has them all.
    shapes = {**_SHAPES, "body": "some"} if given["body"].shape[0] == 1 else _SHAPES
    launch(meeting_kernel, {"row": n}, shapes, _named(meeting_kernel, given | {
        "place": wp.array(place, dtype=wp.vec3i, device=device), "state": state.array,
        "meetings": meetings.array, "frictions": frictions.array,
        "grips": grips.array}), device=device, heavy=True)

