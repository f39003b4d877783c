"""Batches of fixed shapes for JAX: the one place that vmaps, jits, pads, locks and chooses x64.

A fit's result may depend on nothing but its own points. So every fit is put in the bucket of its
*own* number of points, whatever array it came in, and every launch has the same number of lanes;
so nothing recompiles either.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import jax
import numpy as np

POINT_BUCKETS = (16, 32, 64, 128, 256, 512)
LANES = 16
"""Lanes of every launch: another number rounds differently in the last bit, and a larger one is
paid for in full by small batches."""

# Two Python threads in one jitted batched Cholesky hang on a CPU: one call at a time.
_lock = threading.Lock()


def point_bucket(count: int) -> int:
    """The padded number of points for `count` points; multiples of 512 beyond the table."""
    for bucket in POINT_BUCKETS:
        if count <= bucket:
            return bucket
    return -(-count // POINT_BUCKETS[-1]) * POINT_BUCKETS[-1]


def _lane_slices(count: int) -> list[tuple[int, int]]:
    """(start, stop) of the launches that together cover `count` lanes."""
    return [(start, min(start + LANES, count)) for start in range(0, count, LANES)]


@lru_cache(maxsize=256)
def _compiled(lane_function: Callable, lanes: int, shared: int) -> Callable:
    return jax.jit(jax.vmap(lane_function, in_axes=(0,) * lanes + (None,) * shared))


@lru_cache(maxsize=1)
def use_compilation_cache() -> None:
    """Keep compiled programs across processes, in JAX_COMPILATION_CACHE_DIR or the user's cache."""
    if getattr(jax.config, "jax_compilation_cache_dir", None):
        return  # chosen by JAX_COMPILATION_CACHE_DIR or by the program that uses us
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    jax.config.update("jax_compilation_cache_dir", str(root / "warpgrasp" / "jax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.5)


def map_lanes(lane_function: Callable, *lanes: Any, shared: tuple = ()) -> Any:
    """`lane_function(*lane, *shared)` of each lane, in float64.

    `lane_function` must be one cached object (it names the compiled program); `lanes` are trees of
    arrays with the lane as first axis. Returns a tree of numpy arrays, lane first.
    """
    program = _compiled(lane_function, len(lanes), len(shared))
    use_compilation_cache()
    count = len(jax.tree.leaves(lanes)[0])
    parts = []
    for start, stop in _lane_slices(count):
        # The last lane is repeated: valid data, whose results are dropped.
        index = np.minimum(np.arange(start, start + LANES), stop - 1)
        chunk = jax.tree.map(lambda leaf, index=index: leaf[index], lanes)
        with _lock, jax.enable_x64(True):
            out = jax.device_get(program(*chunk, *shared))
        parts.append(jax.tree.map(lambda leaf, n=stop - start: np.asarray(leaf)[:n], out))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def take(tree: Any, index: np.ndarray) -> Any:
    """The lanes `index` of a tree of arrays."""
    return jax.tree.map(lambda leaf: leaf[index], tree)
