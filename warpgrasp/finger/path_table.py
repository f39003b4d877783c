"""Closing paths as kernels see them: the links of a free finger at every command.

The places of a free finger's links in the frame of its base and the distance they have moved depend
on the closing path alone, but for its weight and errors of calibration. They are tabulated once for
all worlds. A closing reads from the table how many steps it can skip for a given free distance.
"""

from functools import lru_cache

import numpy as np
import warp as wp

from warpgrasp.core.struct_array import record_type
from warpgrasp.finger.path_record import LinkStep, PathStep
from warpgrasp.mechanism.calibration import Calibration
from warpgrasp.mechanism.utah_mit_weight import weight_askew
from warpgrasp.parameters import ContactTable, HandTable

_STILL = 1e-9
"""Joints are no farther past a stop by rounding [rad]."""
_UNMOVED = 1e9
"""Steps a metre of a link that stands still."""


def path_table(
    hand: HandTable, commands_rad: np.ndarray, askew: float = 0.0, stops: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Tables of a closing path of the hand believed.

    `commands_rad` has shape (grasp, finger, step, 4). `askew` bounds `Hand.askew` of the
    true hands. Joints end at their
    limits with `stops`. Returns rows of PathStep, shape (grasp, finger, step), and of LinkStep,
    shape (grasp, finger, link 3, step).
    """
    table = np.zeros(commands_rad.shape[:3], dtype=record_type(PathStep))
    table["command"] = commands_rad
    if stops:
        past = commands_rad - np.clip(
            commands_rad, [hand.abduction_limit_rad[0], *hand.flexion_low_rad],
            [hand.abduction_limit_rad[1], *hand.flexion_high_rad])
        past[np.abs(past) < _STILL] = 0.0
        strain = hand.joint_stiffness_Nm_rad * np.abs(past[..., 1:]).max(-1)
        table["strain"] = np.maximum.accumulate(strain, axis=-1)
        commands_rad = commands_rad - past
    turn = commands_rad[..., 0]
    z = np.stack([np.zeros_like(turn), np.sin(turn), np.cos(turn)], -1)
    x = np.array([1.0, 0.0, 0.0])
    joints = [z * hand.abduction_offset_m]
    for link, angle in enumerate(np.moveaxis(commands_rad[..., 1:].cumsum(-1), -1, 0)):
        along = np.sin(angle)[..., None] * x + np.cos(angle)[..., None] * z
        joints.append(joints[-1] + hand.link_length_m[link] * along)
    places = np.stack(joints, 2)
    radius = hand.link_radius_m
    table["inward"] = np.maximum.accumulate(places[..., 0].max(2) + radius, axis=-1)
    table["palm"] = np.minimum.accumulate(_palm_clearance(hand, places), axis=-1)
    links = np.zeros((*places.shape[:2], 3, places.shape[3]), dtype=record_type(LinkStep))
    links["start"], links["end"] = places[:, :, :-1], places[:, :, 1:]
    # A point of a link moves no farther than the farther-moving of its ends.
    moved = np.linalg.norm(np.diff(places, axis=3), axis=-1)
    moved = np.maximum(moved[:, :, :-1], moved[:, :, 1:])
    # Links askew differ in their ways by as much, each way as long as its turn and its length make.
    turned = np.abs(np.diff(np.concatenate([turn[..., None], commands_rad[..., 1:].cumsum(-1)], -1),
                            axis=2))
    length = np.array([hand.abduction_offset_m, *hand.link_length_m])
    swing = np.moveaxis((turned * length).cumsum(-1), -1, 2)
    swing += turned[:, :, None, :, 0] * length.sum()
    links["come"][..., 1:] = moved.cumsum(-1)
    links["swing"][..., 1:] = swing[:, :, 1:].cumsum(-1)
    farthest = np.diff(links["come"] + askew * links["swing"])
    fastest = np.maximum.accumulate(farthest[..., ::-1], axis=-1)[..., ::-1]
    links["steps"] = _UNMOVED
    with np.errstate(divide="ignore"):
        links["steps"][..., :-1] = np.minimum(1.0 / fastest, _UNMOVED)
    return table, links


def _palm_clearance(hand: HandTable, places: np.ndarray) -> np.ndarray:
    """Between the outer two links' skin and the palm's bars, (grasp, finger, step), of joints
    (grasp, finger, joint 4, step, 3): bars lie across the fingers, so that sideways does not count.
    """
    bars = hand.palm_gap_m * np.array([0.0, 0.5, 1.0])
    bar = np.stack([bars, np.full(3, -hand.palm_thickness_m / 2)], -1)
    start, end = places[:, :, 1:-1, ..., None, [0, 2]], places[:, :, 2:, ..., None, [0, 2]]
    along = end - start
    share = ((bar - start) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12)
    nearest = start + np.clip(share, 0.0, 1.0)[..., None] * along
    away = np.linalg.norm(nearest - bar, axis=-1) - hand.palm_thickness_m / 2 - hand.link_radius_m
    return away.min((2, 4))


@lru_cache(maxsize=32)
def _tabled(
    hand: HandTable, askew: float, stops: bool, shape: tuple[int, ...], commands: bytes, device: str
) -> tuple[wp.array, wp.array]:
    paths = np.frombuffer(commands).reshape(shape)
    # Fingers that go the same way share one table, which then stays in the processor's cache.
    own = shape[1] if (paths != paths[:, :1]).any() else min(shape[1], 1)
    path, links = path_table(hand, paths[:, :own], askew, stops)
    return (_for_fingers(wp.array(path, dtype=PathStep, device=device), shape[1]),
            _for_fingers(wp.array(links, dtype=LinkStep, device=device), shape[1]))


def _for_fingers(table: wp.array, fingers: int) -> wp.array:
    """A table (grasp, finger, ...) of one finger as a view with its rows repeated for `fingers`."""
    if table.shape[1] == fingers:
        return table
    shared = wp.array(
        ptr=table.ptr, dtype=table.dtype, device=table.device,
        shape=(table.shape[0], fingers, *table.shape[2:]),
        strides=(table.strides[0], 0, *table.strides[2:]))  # pyright: ignore[reportArgumentType]
    shared._ref = table  # as long as the view lives, so does the table
    return shared


def path_on_device(
    hand: HandTable, contact: ContactTable, errors: Calibration, commands_rad: np.ndarray,
    device: str
) -> tuple[wp.array, wp.array]:
    """`path_table` on a device, kept for the next launch along the same commands."""
    commands = np.ascontiguousarray(commands_rad, np.float64)
    askew = errors.askew_limit + weight_askew(hand) * contact.weight
    return _tabled(hand, askew, contact.joint_stops, commands.shape, commands.tobytes(), device)
