"""Closing paths as kernels see them: the links of a free finger at every command.

The places of a free finger's links in the frame of its base, the distance they have moved, and the
number of moves of its tendons depend on the closing path alone. They are tabulated once for each
robot. A closing reads from the table how many steps it can skip for a given free distance.
"""

from functools import lru_cache

import numpy as np
import warp as wp

from warpgrasp.closing.closing_record import LinkStep, PathStep
from warpgrasp.closing.path_table_kernel import path_kernel
from warpgrasp.core.dtypes import real
from warpgrasp.core.kernel_launch import launch
from warpgrasp.mechanism.calibration import Calibration, true_hands
from warpgrasp.mechanism.utah_mit_hand import FINGER_COUNT
from warpgrasp.parameters import HandTable


@lru_cache(maxsize=8)
def _tabled(
    hand: HandTable, errors: Calibration, shape: tuple[int, ...], commands: bytes, device: str
) -> tuple[wp.array, wp.array]:
    paths = np.frombuffer(commands).reshape(shape)
    hands = true_hands(hand, errors, device)
    # Fingers that go the same way share one table, which then stays in the processor's cache.
    alike = bool((paths == paths[:, :1]).all()) and not errors.joint_offset_rad.any() and (
        not errors.link_length_share.any())
    own = 1 if alike else FINGER_COUNT
    rows = errors.worlds * shape[0]
    path = wp.empty((rows, own, shape[2]), dtype=PathStep, device=device)
    links = wp.empty((rows, own, 3, shape[2]), dtype=LinkStep, device=device)
    launch(path_kernel, {"row": rows, "finger": own}, {
        "hands": "world 4", "commands": "grasp finger step 4", "path": "row finger step",
        "links": "row finger 3 step"}, {
        "hands": hands, "path": path, "links": links,
        "commands": wp.array(np.ascontiguousarray(paths[:, :own]), dtype=real, device=device)},
        device=device)
    return _for_fingers(path, FINGER_COUNT), _for_fingers(links, FINGER_COUNT)


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
    hand: HandTable, errors: Calibration, commands_rad: np.ndarray, device: str
) -> tuple[wp.array, wp.array]:
    """Tables of a closing path, kept for the next launch along the same commands.

    `commands_rad` has shape (grasp, finger 4, step, 4). Returns rows of PathStep, shape (world *
    grasp, finger, step), and of LinkStep, shape (world * grasp, finger, link 3, step), with one
    world where all robots are the same. Their commands are those of the true joints.
    """
    commands = np.ascontiguousarray(commands_rad, np.float64)
    return _tabled(hand, errors, commands.shape, commands.tobytes(), device)
