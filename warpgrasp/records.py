"""Rows of structs, to a device and back, by their bytes.

Warp works out a struct's NumPy type anew at every array made and read, which takes longer than a
small launch; here it is kept.
"""

from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp


@lru_cache
def record_type(struct: Any) -> np.dtype:
    """The NumPy type of a struct's rows."""
    return np.dtype(struct.numpy_dtype())


class Records:
    """Rows of a `struct` on a device: `array` is what kernels take."""

    def __init__(self, struct: Any, rows: np.ndarray | int, device: str) -> None:
        """`rows` are a NumPy array of `record_type`, or how many there are to be, all zero."""
        self._type = record_type(struct)
        if isinstance(rows, int):
            self._bytes = wp.zeros(rows * self._type.itemsize, dtype=wp.uint8, device=device)
        else:
            self._bytes = wp.array(rows.view(np.uint8), dtype=wp.uint8, device=device)
        self.array = wp.array(ptr=self._bytes.ptr, dtype=struct, device=device,
                              shape=self._bytes.size // self._type.itemsize)

    def numpy(self) -> np.ndarray:
        """A copy of the rows as they are now."""
        return self._bytes.numpy().copy().view(self._type)
