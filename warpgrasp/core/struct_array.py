"""Arrays of structs, copied to a device and back as bytes.

Warp derives the NumPy type of a struct at every array that it makes or reads, which takes longer
than a small launch. Here the type is kept.
"""

from functools import lru_cache
from math import prod
from typing import Any

import numpy as np
import warp as wp


@lru_cache
def record_type(struct: Any) -> np.dtype:
    """The NumPy type of a struct's rows."""
    return np.dtype(struct.numpy_dtype())


def repeated(value: Any, struct: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Rows of `shape`, each a copy of the struct `value`, to be changed."""
    one = wp.array([value], dtype=struct, device="cpu").numpy()
    return np.broadcast_to(one, shape).copy()


class Records:
    """Rows of a `struct` on a device: `array` is what kernels take."""

    def __init__(
        self, struct: Any, rows: np.ndarray | tuple[int, ...], device: str, *, clear: bool = True
    ) -> None:
        """`rows` are a NumPy array of `record_type`, or the shape of rows to be written.

        They are zeros; without `clear` their content is undefined.
        """
        self._type = record_type(struct)
        if isinstance(rows, tuple):
            self._shape = rows
            size = prod(rows) * self._type.itemsize
            self._bytes = wp.array(shape=size, dtype=wp.uint8, device=device)
            if clear:
                self._bytes.zero_()
        else:
            self._shape = rows.shape
            self._bytes = wp.array(rows.view(np.uint8).ravel(), dtype=wp.uint8, device=device)
        self.array = wp.array(ptr=self._bytes.ptr, dtype=struct, device=device, shape=self._shape)

    def numpy(self) -> np.ndarray:
        """The rows as they are now; on a CPU it is the kernels' own memory."""
        return self._bytes.numpy().view(self._type).reshape(self._shape)
