"""Records with a row for each world, or each fit: some of their rows, other rows put in, joined.

A record is an array, or a dataclass or named tuple of records, whose first axis is the world; what
else it holds (a radius, None) belongs to all worlds alike and stays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

Record = TypeVar("Record")


def rows_of(record: Record, rows: Any) -> Record:
    """The record of the worlds `rows`, an index of the first axis."""
    return _of_arrays(lambda array: array[rows], record)


def with_rows(record: Record, rows: Any, part: Record) -> Record:
    """A copy of `record` whose worlds `rows` are those of `part`, in their order."""
    copied = _of_arrays(np.copy, record)
    put_rows(copied, rows, part)
    return copied


def put_rows(record: Record, rows: Any, part: Record) -> None:
    """Put the worlds of `part` into the arrays of `record`, which nobody else must hold."""
    def put(array: np.ndarray, values: np.ndarray) -> np.ndarray:
        array[rows] = values
        return array

    _of_arrays(put, record, part)


def joined(records: Sequence[Record]) -> Record:
    """One record of the worlds of all, in turn; what belongs to all worlds alike is the first's."""
    return _of_arrays(lambda *arrays: np.concatenate(arrays), *records)


def row_sums(values: np.ndarray) -> np.ndarray:
    """Sums of rows (row, value), NaN counting nothing: one value after the other.

    NumPy sums in pairs, so that what rows are padded with for a longer one beside them would change
    the last digit.
    """
    return np.nancumsum(values, axis=1)[:, -1] if values.shape[1] else np.zeros(len(values))


def _of_arrays(change: Callable[..., np.ndarray], record: Any, *others: Any) -> Any:
    """`record` with `change(array, *those of others)` for each of its arrays."""
    if isinstance(record, np.ndarray):
        return change(record, *others)
    if isinstance(record, tuple):
        return type(record)(*(_of_arrays(change, *values)
                              for values in zip(record, *others, strict=True)))
    if is_dataclass(record):
        return type(record)(**{f.name: _of_arrays(change, *(
            getattr(one, f.name) for one in (record, *others))) for f in fields(record)})
    return record


def row_medians(values: Float[np.ndarray, "row value"]) -> Float[np.ndarray, " row"]:
    """Median of each row's values that are not NaN; NaN where there are none."""
    ordered = np.sort(values, axis=1)
    count = values.shape[1] - np.isnan(ordered).sum(axis=1)
    row, low, high = np.arange(len(values)), (count - 1) // 2, count // 2
    middle = ordered[row, low]
    return np.where(low == high, middle, (middle + ordered[row, np.minimum(high, count - 1)]) / 2)


FARTHEST_M = 1e12


def plausible(values: np.ndarray) -> np.ndarray:
    """Which lengths [m], or covariances [m^2], are neither NaN nor beyond `FARTHEST_M`."""
    return np.abs(values) <= FARTHEST_M
