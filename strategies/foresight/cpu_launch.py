"""Launches of the grids' kernels, which run on the CPU alone and share NumPy's arrays."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from warpgrasp.core.kernel_launch import launch

_NUMBERS: dict[Any, Any] = {wp.float32: np.float32, wp.int32: np.int32, int: np.int32,
                            wp.uint64: np.uint64, wp.bool: np.bool_}
"""Of arrays of other types, the numbers are doubles."""


def launch_on_cpu(kernel: Any, extents: Mapping[str, int], shapes: Mapping[str, str],
                  **given: Any) -> None:
    """`launch`, with NumPy's arrays in place of Warp's: a kernel writes to those that are
    contiguous and of its own type, and reads copies of others."""
    types = {argument.label: argument.type for argument in kernel.adj.args}
    there = {name: _shared(value, types[name].dtype) if isinstance(value, np.ndarray) else value
             for name, value in given.items()}
    launch(kernel, extents, shapes, there, device="cpu")


def _shared(values: np.ndarray, dtype: Any) -> wp.array:
    """Without a copy: that takes Warp three times as long."""
    return wp.array(np.ascontiguousarray(values, _NUMBERS.get(dtype, np.float64)), dtype=dtype,
                    device="cpu", copy=False)
