"""Checks of arrays from outside, before kernels take them at their word."""

from collections.abc import Mapping
from typing import Any

import numpy as np

_KINDS = {"numbers": "iuf", "whole numbers": "iu", "bool": "b"}
"""Letters that NumPy has for kinds of numbers."""
_UNIT = 1e-6
"""By how much a quaternion may be longer or shorter than 1."""


def check_range(what: str, numbers: np.ndarray | int, least: int, most: int) -> None:
    """Raise ValueError where a number is no whole one of `least` to `most`: kernels index by it
    unasked."""
    right = np.greater_equal(numbers, least) & np.less_equal(numbers, most)  # no NaN is either
    wrong = ~(right & np.equal(numbers, np.floor(numbers))).ravel()
    if wrong.any():
        raise ValueError(f"{what} {np.ravel(numbers)[wrong][0]}: wants {least} to {most}")


def check_array(name: str, value: Any, kind: str, axes: str, **sizes: int) -> None:
    """Raise TypeError for what is no NumPy array of a kind (numbers, whole numbers, bool),
    ValueError for one of another shape.

    `axes` has a word for each axis, as "world probe 7": the size, or a name. The size of a name
    is in `sizes`, or free.
    """
    if not isinstance(value, np.ndarray):
        raise TypeError(f"{name}: is {type(value).__name__}; should be a NumPy array of {kind}, "
                        f"{_told(axes, sizes)}")
    if value.dtype.kind not in _KINDS[kind]:
        raise TypeError(f"{name}: is of {value.dtype}; should be of {kind}, {_told(axes, sizes)}")
    wanted = [int(word) if word.isdigit() else sizes.get(word) for word in axes.split()]
    if value.ndim != len(wanted) or any(
            size not in (None, found) for size, found in zip(wanted, value.shape, strict=True)):
        raise ValueError(f"{name}: of shape {value.shape}; should be {_told(axes, sizes)}")


def check_finite(name: str, value: np.ndarray | float) -> None:
    """Raise ValueError where a number is not finite."""
    wrong = ~np.isfinite(value)
    if wrong.any():
        first = tuple(int(k) for k in np.argwhere(wrong)[0])
        raise ValueError(f"{name}: is {np.asarray(value)[first]}"
                         f"{f' at {first}' if first else ''}; should be finite")


def check_poses(name: str, pose: np.ndarray, counts: np.ndarray | None = None) -> None:
    """Raise ValueError where a pose (world, ..., 7), of those that `counts` (world, ...), is no
    place and unit quaternion."""
    length = np.linalg.norm(pose[..., 3:], axis=-1)
    # Kernels take it at its word: of another length an object seems to stand elsewhere.
    wrong = ~(np.isfinite(pose).all(-1) & (np.abs(length - 1.0) < _UNIT))
    if counts is not None:
        wrong &= counts
    if wrong.any():
        first = tuple(np.argwhere(wrong)[0])
        raise ValueError(f"{name}: that of world {first[0]} is {pose[first].tolist()}; should "
                         "be finite, and its quaternion (the last four) of length 1")


def check_kind(name: str, value: Any, kind: type, *, optional: bool = False) -> None:
    """Raise TypeError for a value of another kind; None is right where it is optional."""
    if not (isinstance(value, kind) or (optional and value is None)):
        raise TypeError(f"{name}: is {value!r:.80}; should be of {kind.__name__}")


def _told(axes: str, sizes: Mapping[str, int]) -> str:
    """The axes for a message, as (world 2, probe, 7)."""
    words = [f"{word} {sizes[word]}" if word in sizes else word for word in axes.split()]
    return f"({', '.join(words)}{',' if len(words) == 1 else ''})"
