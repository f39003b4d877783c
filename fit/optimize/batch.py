"""Batches of fixed shapes for JAX: the one place that vmaps, jits, pads, locks and chooses x64.

A fit's result may depend on nothing but its own points. So every fit is put in the bucket of its
*own* number of points, whatever array it came in, and lanes are computed in groups of one size by
one program, whose number of groups is a number at run time: nothing recompiles, a small batch
costs little, and the same instructions run whatever the batch.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from fit.optimize.program_cache import load_or_compile
from fit.optimize.xla_flags import ask_for_options

POINT_BUCKETS = (32, 64, 128, 256, 512)
GROUP = 16
"""Lanes computed side by side: another number rounds differently in the last bit."""
LANES = 16 * GROUP
"""Lanes that one launch has room for."""
MOST_PROGRAMS = 48
"""Compiled programs held at a time: each takes up to 70 MB and a thousand of the 65,530 memory
mappings that Linux gives a process. An episode of all procedures uses some forty."""
ask_for_options()
# Two Python threads in one jitted batched Cholesky hang on a CPU: one call at a time.
_lock = threading.Lock()
_programs: dict[Any, Callable] = {}


def point_bucket(count: int) -> int:
    """The padded number of points for `count` points; multiples of 512 beyond the table."""
    for bucket in POINT_BUCKETS:
        if count <= bucket:
            return bucket
    return -(-count // POINT_BUCKETS[-1]) * POINT_BUCKETS[-1]


@dataclass(frozen=True)
class Program:
    """A function of a group of lanes, and a name that says all that it closes over."""

    name: str
    function: Callable

    def __call__(self, *arguments: Any) -> Any:
        """The function's answer."""
        return self.function(*arguments)


@lru_cache(maxsize=256)
def _jitted(group_function: Callable) -> Callable:
    def launch(groups, lanes, *common):
        """`groups` groups of `lanes`, one after the other; rows beyond them stay zero."""
        # Jitted by itself only to be traced once for its shapes and for the loop.
        group = jax.jit(lambda lanes: group_function(*lanes, *common))
        part = lambda tree, start: jax.tree.map(  # noqa: E731
            lambda leaf: jax.lax.dynamic_slice_in_dim(leaf, start, GROUP), tree)

        def step(index, out):
            start = index * GROUP
            return jax.tree.map(
                lambda whole, rows: jax.lax.dynamic_update_slice_in_dim(whole, rows, start, 0),
                out, group(part(lanes, start)))

        shapes = jax.eval_shape(group, part(lanes, 0))
        empty = jax.tree.map(lambda leaf: jnp.zeros((LANES, *leaf.shape[1:]), leaf.dtype), shapes)
        return jax.lax.fori_loop(0, groups, step, empty)

    return jax.jit(launch)


def _run(group_function: Callable, arguments: tuple) -> Any:
    """Traced, compiled and loaded once for arguments of one form, unless dropped meanwhile."""
    leaves, form = jax.tree.flatten(arguments)
    key = group_function, form, tuple((leaf.shape, leaf.dtype) for leaf in leaves)
    program = _programs.pop(key, None)
    if program is None:
        while len(_programs) >= MOST_PROGRAMS:
            del _programs[next(iter(_programs))]
        program = _jitted(group_function)
        if isinstance(group_function, Program):
            program = load_or_compile(group_function.name, program, arguments)
    _programs[key] = program  # the last one used comes last
    return program(*arguments)


def map_lanes(group_function: Callable, *lanes: Any, shared: tuple = ()) -> Any:
    """`group_function(*lanes, *shared)` over all lanes, a group at a time, in float64.

    `group_function` is vmapped, and one cached object; if it is a Program, it is compiled once for
    all processes. `lanes` are trees of arrays with the lane as first axis. Returns a tree of numpy
    arrays, lane first.
    """
    count = len(jax.tree.leaves(lanes)[0])
    parts = []
    for start in range(0, count, LANES):
        rows = min(LANES, count - start)
        groups = -(-rows // GROUP)
        chunk = jax.tree.map(lambda leaf, start=start, rows=rows: _padded(leaf, start, rows), lanes)
        with _lock, jax.enable_x64(True):
            out = jax.device_get(_run(group_function, (np.int64(groups), chunk, *shared)))
        parts.append(jax.tree.map(lambda leaf, rows=rows: np.asarray(leaf)[:rows], out))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def _padded(leaf: np.ndarray, start: int, rows: int) -> np.ndarray:
    """`rows` lanes from `start` and room for the others; the last group is filled with its last
    lane, valid data whose results are dropped."""
    room = np.zeros((LANES, *leaf.shape[1:]), leaf.dtype)
    room[:rows] = leaf[start : start + rows]
    room[rows : -(-rows // GROUP) * GROUP] = leaf[start + rows - 1]
    return room


def take(tree: Any, index: np.ndarray) -> Any:
    """The lanes `index` of a tree of arrays."""
    return jax.tree.map(lambda leaf: leaf[index], tree)
