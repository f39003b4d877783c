"""Launches of the grids' kernels, which run on the CPU alone and share NumPy's arrays."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import warp as wp

from warpgrasp.core.kernel_launch import launch

_NUMBERS: dict[Any, Any] = {wp.float32: np.float32, wp.int32: np.int32, int: np.int32,
                            wp.uint64: np.uint64, wp.bool: np.bool_}
"""Of arrays of other types, the numbers are doubles."""


def launch_on_cpu(
    kernel: Any,
    extents: Mapping[str, int],
    shapes: Mapping[str, str],
    writes: Collection[str],
    **given: Any,
) -> None:
    """`launch`, with NumPy's arrays in place of Warp's.

    Those that the kernel `writes` are to be contiguous and of its own numbers; a copy is read of
    others that are not. Raises ValueError naming the array that what is written would not reach.
    """
    types = {argument.label: argument.type for argument in kernel.adj.args}
    there = {name: _shared(name, value, types[name].dtype, name in writes)
             if isinstance(value, np.ndarray) else value for name, value in given.items()}
    launch(kernel, extents, shapes, there, device="cpu")


def _shared(name: str, values: np.ndarray, dtype: Any, written: bool) -> wp.array:
    """An array of Warp without a copy: that takes Warp three times as long."""
    numbers = np.dtype(_NUMBERS.get(dtype, np.float64))
    if written and not (values.dtype == numbers and values.flags.c_contiguous):
        raise ValueError(f"{name}: {values.dtype} with strides {values.strides}; should be "
                         f"contiguous {numbers}, for it is written to")
    return wp.array(np.ascontiguousarray(values, numbers), dtype=dtype, device="cpu", copy=False)
