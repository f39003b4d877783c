"""Checks of the options and arrays of fits; a ValueError names what is wrong and what is right."""

from math import inf, nan
from numbers import Integral, Real
from typing import Any, TypeVar

import numpy as np

Options = TypeVar("Options")
MOST_WEIGHT = 1e4
"""Of a term relative to all touches; far larger ones leave nothing of the touches but rounding."""
LEAST_RAD = 1e-9
"""Of a standard deviation of directions [rad]; far smaller ones overflow as weights."""


def options_of(options: Options | None, kind: type[Options]) -> Options:
    """`options`, or the defaults where None. Raises ValueError for anything else."""
    if options is None:
        return kind()
    if not isinstance(options, kind):
        raise ValueError(f"options: {options!r}, should be a {kind.__name__}")
    return options


def check_flags(options: Any, *names: str) -> None:
    """Raises ValueError unless each option named is true or false: any text would count as true."""
    for name in names:
        if not isinstance(value := getattr(options, name), bool | np.bool):
            raise ValueError(f"{name}: {value!r}, should be True or False")


def check_counts(options: Any, **least: int) -> None:
    """Raises ValueError unless each option named is a whole number of so many at least."""
    for name, low in least.items():
        value = getattr(options, name)
        if not isinstance(value, Integral) or isinstance(value, bool) or value < low:
            raise ValueError(f"{name}: {value!r}, should be a whole number, {low} at least")


def check_numbers(options: Any, *names: str, low: float = 0.0, high: float = inf,
                  above: bool = False) -> None:
    """Raises ValueError unless each option named is finite and from `low` to `high`; `above`: more
    than `low`."""
    for name in names:
        check_number(name, getattr(options, name), low=low, high=high, above=above)


def check_number(name: str, value: Any, *, low: float = 0.0, high: float = inf,
                 above: bool = False) -> None:
    """As `check_numbers`, of one value."""
    number = float(value) if isinstance(value, Real) and not isinstance(value, bool) else nan
    if not (low <= number <= high and number < inf) or (above and number == low):
        first = f"above {low:g}" if above else f"{low:g} or more"
        last = f", {high:g} at most" if high < inf else ""
        raise ValueError(f"{name}: {value!r}, should be a finite number, {first}{last}")


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


def check_balls(free_points, free_radius, free_mask) -> None:
    """Raises ValueError for radii or a mask of free space where no places are given, and for one
    radius of all balls that is none or negative."""
    for name, value in (("free_radius", free_radius), ("free_mask", free_mask)):
        if free_points is None and value is not None:
            raise ValueError(f"{name}: given without free_points, should come with them")
    if free_radius is not None and np.ndim(free_radius) == 0:
        check_number("free_radius", np.asarray(free_radius)[()])


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
