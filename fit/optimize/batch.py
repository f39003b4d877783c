"""Batches of fixed shapes for JAX: padding, jit, locking and float64.

A fit must depend only on its own points. Therefore each fit is padded to the bucket of its *own*
number of points, and lanes are computed in groups of fixed size by one program, which takes the
number of groups, and of pieces that the points of a lane are divided into (`pieces`), as run-time
arguments. The same instructions run for any batch size, nothing recompiles, and a small batch costs
little.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import custom_vmap

from fit.optimize.pieces import SLOTS, Span, in_slots, pieces_of
from fit.optimize.program_cache import cpu_device, load_or_compile
from fit.optimize.xla_flags import set_xla_flags

POINT_BUCKETS = (32, 64, 96, 128, 256, 512)
GROUP = 16
"""Lanes computed side by side; another number would change rounding in the last bit."""
LANES = 16 * GROUP
"""Lanes per launch."""
MAX_PROGRAMS = 48
"""Compiled programs held in memory: each takes up to 70 MB and a thousand of the 65,530 memory
mappings that Linux allows a process. An episode of all procedures uses about forty."""
set_xla_flags()
# Two Python threads in one jitted batched Cholesky deadlock on a CPU: one call at a time.
_lock = threading.Lock()
_programs: dict[Any, Callable] = {}


def point_bucket(count: int) -> int:
    """Padded number of points for `count` points; above 512, a multiple of 512."""
    for bucket in POINT_BUCKETS:
        if count <= bucket:
            return bucket
    return -(-count // POINT_BUCKETS[-1]) * POINT_BUCKETS[-1]


@dataclass(frozen=True)
class Program:
    """A function of a group of lanes, with a name that states all it closes over."""

    name: str
    function: Callable

    def __call__(self, *arguments: Any) -> Any:
        """Call the function."""
        return self.function(*arguments)


@lru_cache(maxsize=256)
def _jitted(group_function: Callable) -> Callable:
    def launch(groups, pieces, lanes, slots, *common):
        """Compute `groups` groups of `lanes` in turn; rows after them stay zero."""
        # Jitted so that it is traced once, for the shapes and the loop.
        group = jax.jit(lambda lanes, index: group_function(
            *lanes, *(() if slots is None else (slots, Span(index * pieces, pieces))), *common))
        part = lambda tree, start: jax.tree.map(  # noqa: E731
            lambda leaf: jax.lax.dynamic_slice_in_dim(leaf, start, GROUP), tree)

        def step(index, out):
            start = index * GROUP
            return jax.tree.map(
                lambda whole, rows: jax.lax.dynamic_update_slice_in_dim(whole, rows, start, 0),
                out, group(part(lanes, start), index))

        shapes = jax.eval_shape(group, part(lanes, 0), 0)
        empty = jax.tree.map(lambda leaf: jnp.zeros((LANES, *leaf.shape[1:]), leaf.dtype), shapes)
        return jax.lax.fori_loop(0, groups, step, empty)

    return jax.jit(launch)


def _run(group_function: Callable, arguments: tuple) -> Any:
    """Call the program for arguments of this structure, compiling it unless it is held."""
    leaves, form = jax.tree.flatten(arguments)
    key = group_function, form, tuple((leaf.shape, leaf.dtype) for leaf in leaves)
    program = _programs.pop(key, None)
    if program is None:
        while len(_programs) >= MAX_PROGRAMS:
            del _programs[next(iter(_programs))]
        program = _jitted(group_function)
        if isinstance(group_function, Program):
            program = load_or_compile(group_function.name, program, arguments)
    _programs[key] = program  # most recently used last
    return program(*arguments)


def map_lanes(
    group_function: Callable, *lanes: Any, shared: tuple = (), by_point: Any = None
) -> Any:
    """`group_function(*lanes, *shared)` over all lanes, a group at a time, in float64.

    `lanes` are trees of arrays whose first axis is the lane; so is the result. `group_function` is
    a vmapped function, the same object in every call; a `Program` is compiled once for all
    processes. `by_point` is a tree of arrays [lane, ..., point] of one number of points: the
    function gets its pieces, [lane, slot, ..., PIECE], and their `Span` after the lanes.
    """
    count = len(jax.tree.leaves(lanes)[0])
    pieces = 1 if by_point is None else pieces_of(jax.tree.leaves(by_point)[0].shape[-1])
    slots = -(-pieces // SLOTS) * SLOTS
    at_once = LANES if by_point is None else min(LANES, slots // pieces * GROUP)
    parts = []
    for start in range(0, count, at_once):
        rows = min(at_once, count - start)
        groups = -(-rows // GROUP)
        chunk = jax.tree.map(lambda leaf, start=start, rows=rows: _padded(leaf, start, rows), lanes)
        points = jax.tree.map(lambda leaf, start=start, rows=rows, groups=groups: in_slots(
            leaf[start : start + rows], GROUP, groups, slots), by_point)
        with _lock, jax.enable_x64(True), jax.default_device(cpu_device()):
            out = jax.device_get(_run(group_function, (
                np.int64(groups), np.int64(pieces), chunk, points, *shared)))
        parts.append(jax.tree.map(lambda leaf, rows=rows: np.asarray(leaf)[:rows], out))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def _padded(leaf: np.ndarray, start: int, rows: int) -> np.ndarray:
    """`rows` lanes from `start`, padded to `LANES`; the last group repeats its last lane, so that
    it holds valid data, whose results are dropped."""
    room = np.zeros((LANES, *leaf.shape[1:]), leaf.dtype)
    room[:rows] = leaf[start : start + rows]
    room[rows : -(-rows // GROUP) * GROUP] = leaf[start + rows - 1]
    return room


def take(tree: Any, index: np.ndarray) -> Any:
    """The lanes `index` of a tree of arrays."""
    return jax.tree.map(lambda leaf: leaf[index], tree)


def vmap_cond(function: Callable, needed: Any, *arguments: Any) -> Any:
    """`function(*arguments)` if any lane of a vmapped group needs it, else zeros.

    vmap turns a `lax.cond` on a per-lane condition into both branches and a select. This keeps one
    condition for the group, so the work is skipped when no lane needs it. The function must return
    zeros for a lane that does not need it. Not differentiable.
    """

    def choose(needed, work, *arguments):
        shapes = jax.eval_shape(work, *arguments)
        nothing = lambda *_: jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes)  # noqa: E731
        return jax.lax.cond(needed, work, nothing, *arguments)

    @custom_vmap
    def chosen(needed, *arguments):
        return choose(needed, function, *arguments)

    @chosen.def_vmap
    def _of_lanes(lanes, batched, needed, *arguments):
        work = jax.vmap(function, in_axes=tuple(jax.tree.map(
            lambda b: 0 if b else None, batched[1:])), axis_size=lanes)
        out = choose(jnp.any(needed), work, *arguments)
        return out, jax.tree.map(lambda _: True, out)

    return chosen(needed, *arguments)
