"""Lower limits lie below upper ones: in the sections of a spec, and at every point of its sweep."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from sweeps.cell import SECTIONS
from sweeps.edge import edge_fields
from sweeps.problems import Path, Problems
from sweeps.study import Axis

_PAIRS = (("arm", "limit_low_deg", "limit_high_deg"),
          ("hand", "flexion_low_deg", "flexion_high_deg"),
          ("hand", "tension_low_N", "tension_high_N"))


def check_order(tables: Mapping[str, Any], given: Mapping[str, Any], axes: Sequence[Axis],
                problems: Problems) -> None:
    """Checks pairs that are not swept, whichever of the two was given."""
    swept = {key for axis in axes for key in axis.keys}
    for section, low, high in _PAIRS:
        lows, highs = (_set(tables, section, name) for name in (low, high))
        if not {f"{section}.{low}", f"{section}.{high}"} & swept and (lows >= highs).any():
            at = low if low in given.get(section, {}) else high
            problems.add((section, at), f"{low} should be below {high}")


def check_swept_order(tables: Mapping[str, Any],
                      parts: Mapping[str, Mapping[str, tuple[Path, Any]]],
                      readers: Mapping[str, Callable[[Any, Path, Problems], Any]],
                      problems: Problems) -> None:
    """Checks pairs of which one is swept: lists by their values, ranges by their ends.

    `parts` has, by kind of axis and key, where a key's values stand, and the values, all checked.
    """
    swept = {key: (kind, *found) for kind, table in parts.items() for key, found in table.items()}
    for section, *names in _PAIRS:
        keys = [f"{section}.{name}" for name in names]
        at = next((swept[key][1] for key in keys if key in swept), None)
        if at is None:
            continue
        sides = []
        for key, name in zip(keys, names, strict=True):
            if key not in swept:
                sides.append(_set(tables, section, name))
                continue
            _, path, values = swept[key]
            values = values.values() if isinstance(values, Mapping) else values
            si = [readers[key](value, path, problems) for value in values]
            sides.append(np.array(si, float).reshape(len(si), -1))
        lows, highs = sides
        if {swept.get(key, ("",))[0] for key in keys} != {"zip"}:  # every value meets every other
            lows, highs = lows.max(0), highs.min(0)
        if (lows >= highs).any():
            problems.add(at, f"{names[0]} should be below {names[1]} at every point of the sweep")


def _set(tables: Mapping[str, Any], section: str, name: str) -> np.ndarray:
    """What a section has for a key, in SI, shape (1, number)."""
    value = getattr(tables[section], edge_fields(SECTIONS[section])[name].name)
    return np.array(value, float).reshape(1, -1)
