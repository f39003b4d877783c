"""Row operations on batched records: select, replace and concatenate rows; sums and medians.

A record is an array, or a dataclass or named tuple of records, whose first axis is the row (a world
or a fit). Other values in it (a radius, None) are shared by all rows and kept.
"""

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

Record = TypeVar("Record")
_BLOCK = 32  # points


def rows_of(record: Record, rows: Any) -> Record:
    """The rows of a record that `rows` indexes."""
    return _of_arrays(lambda array: array[rows], record)


def with_rows(record: Record, rows: Any, part: Record) -> Record:
    """A copy of `record` whose `rows` are those of `part`, in order."""
    copied = _of_arrays(np.copy, record)
    put_rows(copied, rows, part)
    return copied


def put_rows(record: Record, rows: Any, part: Record) -> None:
    """Overwrite `rows` of `record` with those of `part`, in place."""
    def put(array: np.ndarray, values: np.ndarray) -> np.ndarray:
        array[rows] = values
        return array

    _of_arrays(put, record, part)


def joined(records: Sequence[Record]) -> Record:
    """All records concatenated; shared values are those of the first."""
    return _of_arrays(lambda *arrays: np.concatenate(arrays), *records)


def read_only_view(values: np.ndarray) -> np.ndarray:
    """A view that a user's function cannot write to."""
    view = values.view()
    view.flags.writeable = False
    return view


def row_sums(values: np.ndarray) -> np.ndarray:
    """Sums of rows (row, value), ignoring NaN, in sequential order.

    NumPy's pairwise sums would depend in the last digit on the padding of a row.
    """
    return np.nancumsum(values, axis=1)[:, -1] if values.shape[1] else np.zeros(len(values))


def row_products(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Sums over points of a (row, point, i) times b (row, point, j): (row, i, j).

    Points are taken in blocks of one length: BLAS sums short and long products in other orders, so
    that the last digit would depend on the padding of a row.
    """
    blocks = -(-a.shape[1] // _BLOCK)

    def in_blocks(values: np.ndarray) -> np.ndarray:
        padded = np.zeros((len(values), blocks * _BLOCK, values.shape[2]))
        padded[:, :values.shape[1]] = values
        return padded.reshape(len(values), blocks, _BLOCK, values.shape[2])

    return (np.swapaxes(in_blocks(a), 2, 3) @ in_blocks(b)).sum(axis=1)


def _of_arrays(change: Callable[..., np.ndarray], record: Any, *others: Any) -> Any:
    """`record` with each array replaced by `change(array, *arrays of others)`."""
    if isinstance(record, np.ndarray):
        return change(record, *others)
    if isinstance(record, tuple):
        parts = (_of_arrays(change, *values) for values in zip(record, *others, strict=True))
        return type(record)(*parts) if hasattr(record, "_fields") else tuple(parts)
    if is_dataclass(record):
        return type(record)(**{f.name: _of_arrays(change, *(
            getattr(one, f.name) for one in (record, *others))) for f in fields(record)})
    return record


def row_medians(values: Float[np.ndarray, "row value"]) -> Float[np.ndarray, " row"]:
    """Median of each row, ignoring NaN; NaN for a row without a number."""
    if values.shape[1] == 0:
        return np.full(len(values), np.nan)
    ordered = np.sort(values, axis=1)
    count = values.shape[1] - np.isnan(ordered).sum(axis=1)
    row, low, high = np.arange(len(values)), (count - 1) // 2, count // 2
    middle = ordered[row, low]
    return np.where(low == high, middle, (middle + ordered[row, np.minimum(high, count - 1)]) / 2)


def is_valid(values: np.ndarray) -> np.ndarray:
    """Whether each length [m] or covariance [m^2] is a number of magnitude up to 1e12."""
    return np.abs(values) <= 1e12
