"""Closing paths as kernels see them: the links of a free finger at every command.

The places of a free finger's links in the frame of its base, the distance they have moved, and the
number of moves of its tendons depend on the closing path alone. They are tabulated once for all
worlds. A closing reads from the table how many steps it can skip for a given free distance.
"""

from functools import lru_cache

import numpy as np
import warp as wp

from warpgrasp.closing.closing_record import LinkStep, PathStep
from warpgrasp.core.struct_array import record_type
from warpgrasp.parameters import HandTable

_STILL = 1e-12
"""Joint steps below are none [rad]."""
_UNMOVED = 1e9
"""Steps a metre of a link that stands still."""


def path_table(hand: HandTable, commands_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Tables of a closing path.

    `commands_rad` has shape (grasp, finger, step, 4). Returns rows of PathStep, shape (grasp,
    finger, step), and of LinkStep, shape (grasp, finger, link 3, step).
    """
    table = np.zeros(commands_rad.shape[:3], dtype=record_type(PathStep))
    table["command"] = commands_rad
    moving = np.abs(np.diff(commands_rad[..., 1:], axis=2)) > _STILL
    table["moves"][:, :, 1:] = moving.sum(-1).cumsum(-1)
    turn = commands_rad[..., 0]
    z = np.stack([np.zeros_like(turn), np.sin(turn), np.cos(turn)], -1)
    x = np.array([1.0, 0.0, 0.0])
    joints = [z * hand.abduction_offset_m]
    for link, angle in enumerate(np.moveaxis(commands_rad[..., 1:].cumsum(-1), -1, 0)):
        along = np.sin(angle)[..., None] * x + np.cos(angle)[..., None] * z
        joints.append(joints[-1] + hand.link_length_m[link] * along)
    places = np.stack(joints, 2)
    links = np.zeros((*places.shape[:2], 3, places.shape[3]), dtype=record_type(LinkStep))
    links["start"], links["end"] = places[:, :, :-1], places[:, :, 1:]
    # A point of a link moves no farther than the farther-moving of its ends.
    moved = np.linalg.norm(np.diff(places, axis=3), axis=-1)
    links["come"][..., 1:] = np.maximum(moved[:, :, :-1], moved[:, :, 1:]).cumsum(-1)
    fastest = np.maximum.accumulate(np.diff(links["come"])[..., ::-1], axis=-1)[..., ::-1]
    links["steps"] = _UNMOVED
    with np.errstate(divide="ignore"):
        links["steps"][..., :-1] = np.minimum(1.0 / fastest, _UNMOVED)
    return table, links


@lru_cache(maxsize=32)
def _tabled(
    hand: HandTable, shape: tuple[int, ...], commands: bytes, device: str
) -> tuple[wp.array, wp.array]:
    paths = np.frombuffer(commands).reshape(shape)
    # Fingers that go the same way share one table, which then stays in the processor's cache.
    own = shape[1] if (paths != paths[:, :1]).any() else min(shape[1], 1)
    path, links = path_table(hand, paths[:, :own])
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
    hand: HandTable, commands_rad: np.ndarray, device: str
) -> tuple[wp.array, wp.array]:
    """`path_table` on a device, kept for the next launch along the same commands."""
    commands = np.ascontiguousarray(commands_rad, np.float64)
    return _tabled(hand, commands.shape, commands.tobytes(), device)
