"""Checks of the arrays given to fits; a ValueError names the array and what is right."""

import numpy as np


def checked_array(name: str, value, shape: tuple[int | None, ...], dtype=float) -> np.ndarray:
    """`value` as an array of a shape, None for any length. Raises ValueError for another shape, and
    for what are no plain real numbers."""
    value = _plain(name, value, dtype)
    fits = value.ndim == len(shape) and all(
        want is None or have == want for have, want in zip(value.shape, shape, strict=True))
    if not fits:
        wanted = ", ".join("any" if want is None else str(want) for want in shape)
        raise ValueError(f"{name}: shape {value.shape}, should be ({wanted})")
    return value


def spread_array(name: str, value, shape: tuple[int, ...]) -> np.ndarray:
    """One number for all, or an array that spreads to `shape`. Raises ValueError otherwise."""
    value = _plain(name, value, float)
    try:
        return np.broadcast_to(value, shape)
    except ValueError:
        raise ValueError(f"{name}: shape {value.shape}, should be one number or "
                         f"({', '.join(map(str, shape))})") from None


def _plain(name: str, value, dtype) -> np.ndarray:
    if np.ma.is_masked(value):
        raise ValueError(f"{name}: has masked values, should be a plain array; say by `mask` which "
                         "touches count")
    try:
        given = np.asarray(value)
        if not np.iscomplexobj(given):
            return np.asarray(given, dtype)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name}: is no array of numbers ({error})") from None
    raise ValueError(f"{name}: has complex numbers, should have real ones")
