"""Closing paths as kernels see them: where a free finger's links are at every command.

A free finger stands where it is commanded, so its links' places in the frame of its base, how far
they have come, and how often its tendons have moved depend on the path alone: they are tabled once
for all worlds. A closing looks up how many steps nothing can happen in, by the distance that is
free, and jumps there.
"""

from functools import lru_cache

import numpy as np
import warp as wp

from warpgrasp.parameters import HandTable
from warpgrasp.real import real, vec3, vec4

_STILL = 1e-12
"""Joint steps below are none [rad]."""
_UNMOVED = 1e9
"""Steps a metre of a link that stands still."""


@wp.struct
class PathStep:
    """A command and the free finger there, in the frame of its base.

    `p1` to `p3` are the flexion joints, `p4` the tip's centre; `moves` counts the flexion joints'
    moves since the start. `steps` is in how many steps a metre each link goes at the fastest, from
    here on.
    """

    command: vec4
    p1: vec3
    p2: vec3
    p3: vec3
    p4: vec3
    moves: real
    steps: vec3


def path_table(hand: HandTable, commands_rad: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows of PathStep of commands (grasp, finger, step, 4) [rad], and how far each link has come.

    The latter, (grasp, finger, step, link 3) [m], bounds the way of any point of the link's axis.
    """
    table = np.zeros(commands_rad.shape[:3], dtype=PathStep.numpy_dtype())
    turn = commands_rad[..., 0]
    z = np.stack([np.zeros_like(turn), np.sin(turn), np.cos(turn)], -1)
    x = np.array([1.0, 0.0, 0.0])
    joints = [z * hand.abduction_offset_m]
    for link, angle in enumerate(np.moveaxis(commands_rad[..., 1:].cumsum(-1), -1, 0)):
        along = np.sin(angle)[..., None] * x + np.cos(angle)[..., None] * z
        joints.append(joints[-1] + hand.link_length_m[link] * along)
    # A point of a link moves no farther than the farther-moving of its ends.
    moved = [np.linalg.norm(np.diff(p, axis=2), axis=-1) for p in joints]
    table["command"] = commands_rad
    for name, place in zip(("p1", "p2", "p3", "p4"), joints, strict=True):
        table[name] = place
    travel = np.zeros((*table.shape, 3))
    for link in range(3):
        travel[:, :, 1:, link] = np.maximum(moved[link], moved[link + 1]).cumsum(-1)
    fastest = np.maximum.accumulate(np.diff(travel, axis=2)[:, :, ::-1], axis=2)[:, :, ::-1]
    table["steps"] = _UNMOVED
    with np.errstate(divide="ignore"):
        table["steps"][:, :, :-1] = np.minimum(1.0 / fastest, _UNMOVED)
    moving = np.abs(np.diff(commands_rad[..., 1:], axis=2)) > _STILL
    table["moves"][:, :, 1:] = moving.sum(-1).cumsum(-1)
    return table, travel


@lru_cache(maxsize=32)
def _tabled(
    hand: HandTable, shape: tuple[int, ...], commands: bytes, device: str
) -> tuple[wp.array, wp.array]:
    path, travel = path_table(hand, np.frombuffer(commands).reshape(shape))
    return (wp.array(path, dtype=PathStep, device=device),
            wp.array(travel, dtype=vec3, device=device))


def path_on_device(
    hand: HandTable, commands_rad: np.ndarray, device: str
) -> tuple[wp.array, wp.array]:
    """`path_table` as kernels take it; kept for the next launch along the same commands."""
    commands = np.ascontiguousarray(commands_rad, np.float64)
    return _tabled(hand, commands.shape, commands.tobytes(), device)
