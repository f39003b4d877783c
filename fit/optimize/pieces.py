"""Sums over the points of a fit, in pieces of a fixed size: one program for any number of points.

On the way to a program the points of each lane are divided into pieces of `PIECE`. The pieces of a
group of lanes stand in slots, those of its next group in the slots after them. So the shapes of a
program are the same for every number of points; how many pieces a lane has is a run-time argument.
Padding has weight zero and adds exact zeros to a sum.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

PIECE = 32
"""Points in a piece."""
SLOTS = 16
"""Slots for the pieces of one launch, or a multiple where a single group needs more."""


class Span(NamedTuple):
    """The slots of a group of lanes."""

    first: Any
    count: Any
    """Pieces of each lane."""


def pieces_of(points: int) -> int:
    """Number of pieces that hold `points` points."""
    return -(-points // PIECE)


def divided(values: Any) -> np.ndarray:
    """[lane, ..., point] as [lane, piece, ..., PIECE], padded with zeros."""
    pieces = pieces_of(values.shape[-1])
    missing = pieces * PIECE - values.shape[-1]
    if missing:
        values = np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, missing)])
    parts = values.reshape(*values.shape[:-1], pieces, PIECE)
    return np.moveaxis(parts, -2, 1)


def undivided(values: np.ndarray, points: int) -> np.ndarray:
    """The inverse: [lane, piece, ..., PIECE] as [lane, ..., point]."""
    parts = np.moveaxis(values, 1, -2)
    return parts.reshape(*parts.shape[:-2], -1)[..., :points]


def in_slots(values: np.ndarray, group: int, groups: int, slots: int) -> np.ndarray:
    """[lane, ..., point] as [lane of a group, slot, ..., PIECE] for `groups` groups of lanes."""
    parts = divided(values)
    lanes, count = parts.shape[:2]
    room = np.zeros((group, slots, *parts.shape[2:]), values.dtype)
    for number in range(groups):
        rows = parts[number * group : min((number + 1) * group, lanes)]
        at = slice(number * count, (number + 1) * count)
        room[: len(rows), at] = rows
        if len(rows) < group:
            room[len(rows) :, at] = rows[-1]  # valid data, whose results are dropped
    return room


def sum_of_pieces(function: Callable, slots: Any, span: Span) -> Any:
    """The sum of `function(piece)` over the pieces of one lane, `slots` a tree of [slot, ...]."""
    piece = lambda slot: jax.tree.map(  # noqa: E731
        lambda leaf: jax.lax.dynamic_index_in_dim(leaf, slot, 0, keepdims=False), slots)
    form = jax.eval_shape(lambda: function(piece(0)))
    none = jax.tree.map(lambda leaf: jnp.zeros(leaf.shape, leaf.dtype), form)
    return jax.lax.fori_loop(
        span.first, span.first + span.count,
        lambda slot, sums: jax.tree.map(jnp.add, sums, function(piece(slot))), none)
