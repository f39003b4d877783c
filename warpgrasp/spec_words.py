"""Words of a spec in Python: `Ring(tilt_deg=50)` as in a spec's `tilt_deg = 50`.

Inside the program all quantities are SI, and so are the fields of the parameter tables. In a spec,
lengths are in mm, angles in degrees and relative errors in percent, and the key ends in the unit:
the field `link_radius_m` has the word `link_radius_mm`, `speed_rad_s` has `speed_deg_s`, and
`link_length_share` has `link_length_pct`.
"""

import re
from collections.abc import Callable
from copy import copy
from dataclasses import field, fields
from difflib import get_close_matches
from functools import wraps
from math import degrees, inf, isfinite, radians
from numbers import Integral, Real
from typing import Any, TypeVar

import numpy as np

# A trailing m or rad is a length or an angle, unless it belongs to a compound: N_m, Nm_rad, per_m.
_UNIT = re.compile(r"^(?P<stem>.*(?<!_N)(?<!_Nm)(?<!_per))_(?P<unit>m|rad)(?P<rate>_s)?$")
_SHARE = re.compile(r"^(?P<stem>link_length|moment_arm|pad_gain)_share$")
_ROUNDING = 1e-9
"""Of a bound, by which a value in a spec's unit may lie beyond it: messages give ten digits."""
Table = TypeVar("Table")


def same(value: Any) -> Any:
    """A value that has no unit, or the same one in a spec."""
    return value


def number(default: Any, low: float = 0.0, high: float = inf, doc: str = "") -> Any:
    """A field with its default, the closed range each entry must lie in, and its meaning."""
    return field(default=default, metadata={"low": low, "high": high, "doc": doc})


def choice(default: str, choices: tuple[str, ...], doc: str) -> Any:
    """A field with its default, the texts that it may be, and its meaning."""
    return field(default=default, metadata={"choices": choices, "doc": doc})


def word_of(name: str) -> tuple[str, Callable[[float], float], Callable[[float], float]]:
    """A field's word in a spec, and the functions from the spec's unit to SI and back."""
    if share := _SHARE.match(name):
        return f"{share['stem']}_pct", _from_percent, _to_percent
    match = _UNIT.match(name)
    if match is None:
        return name, same, same
    if match["unit"] == "m":
        return f"{match['stem']}_mm{match['rate'] or ''}", _from_mm, _to_mm
    return f"{match['stem']}_deg{match['rate'] or ''}", radians, degrees


def each(change: Callable[[Any], Any], value: Any) -> Any:
    """`change` of a number, or of every number of a list, as a tuple."""
    if isinstance(value, list | tuple):
        return tuple(each(change, entry) for entry in value)
    return value if isinstance(value, bool | str | None) else change(value)


def spec_words(table: type[Table]) -> type[Table]:
    """A parameter dataclass whose constructor takes the words of a spec too, in their units.

    Its constructor raises TypeError for an unknown word, naming the right one, and ValueError for a
    value that a spec could not have: bounds and choices are those of the fields' metadata.
    """
    make = table.__init__
    named: dict[str, Any] = {f.name: f for f in fields(table) if f.init}  # type: ignore[arg-type]
    known = {word: (name, to_si) for name in named for word, to_si, _ in [word_of(name)]}

    @wraps(make)
    def init(self: Any, *values: Any, **words: Any) -> None:
        found = {}
        given = [_plain(of, value) for of, value in zip(named.values(), values, strict=False)]
        for name, value in zip(named, given, strict=False):
            _check(table.__name__, named[name], name, value, same)
        for word, value in words.items():
            name, to_si = (word, same) if word in named else known.get(word, ("", same))
            if not name:
                near = get_close_matches(word, known, n=1, cutoff=0.5)
                guess = f"did you mean {near[0]}? " if near else ""
                raise TypeError(f"{table.__name__} has no {word!r}; {guess}"
                                f"there are: {', '.join(known)}")
            if name in found:  # in both units
                raise TypeError(f"{table.__name__}: {word_of(name)[0]} and {name} are the same; "
                                "give one")
            value = _plain(named[name], value)
            _check(table.__name__, named[name], word, value, to_si)
            found[name] = each(to_si, value)
        # too many values are refused here
        make(self, *(each(same, value) for value in given), *values[len(given):], **found)

    table.__init__ = init  # type: ignore[method-assign]
    return table


def reckoned(table: Table, **values: Any) -> Table:
    """A copy of a table with other values of some fields, in SI. They are not checked: what is
    reckoned of a spec's values may lie beyond the bounds of these."""
    changed = copy(table)
    for name, value in values.items():
        object.__setattr__(changed, name, value)
    return changed


def _plain(of: Any, value: Any) -> Any:
    """A value of a field without NumPy's arrays, but for one of numbers of worlds, where the
    field's own is a single number."""
    alone = isinstance(value, np.ndarray) and (value.ndim == 0 or isinstance(of.default, tuple))
    return value.tolist() if alone else value


def _check(table: str, of: Any, word: str, value: Any, to_si: Callable[[float], float]) -> None:
    """Raise ValueError where a value is none of its field's choices, not of its kind, or no number
    or list of them within its bounds. Arrays are of worlds and are not looked at."""
    choices, low, high = (of.metadata.get(name) for name in ("choices", "low", "high"))
    if choices and not (isinstance(value, str) and value in choices):
        raise ValueError(f"{table}: {word} is {value!r}; should be one of {', '.join(choices)}")
    if value is None and "None" in str(of.type):
        return
    if value is of.default or (isinstance(value, np.ndarray) and value.ndim):
        return
    if isinstance(value, np.generic):
        value = value.item()
    for kind, wanted in ((bool, "True or False"), (str, "a text")):
        if isinstance(of.default, kind) and not isinstance(value, kind):
            raise ValueError(f"{table}: {word} is {value!r}; should be {wanted}")
    if low is None:
        return
    whole = of.type in (int, "int")
    wanted = "a whole number" if whole else "a number"
    entries: Any = [value]
    if isinstance(of.default, tuple):
        wanted = f"{len(of.default)} numbers, each"
        entries = value if isinstance(value, list | tuple) else ()
        entries = entries if len(entries) == len(of.default) else [None]
    factor = to_si(1.0)
    slack = _ROUNDING * max(abs(v) for v in (low, high, 0.0) if isfinite(v))
    for entry in entries:
        right = isinstance(entry, Integral) or (isinstance(entry, Real) and not whole)
        if isinstance(entry, bool) or not right or not (
                low - slack <= entry * factor <= high + slack) or not isfinite(entry):
            ends = (f" from {low / factor:.10g} to {high / factor:.10g}" if isfinite(high)
                    else f" from {low / factor:.10g} on" if isfinite(low) else "")
            raise ValueError(f"{table}: {word} is {value!r}; should be {wanted}{ends}")


def _from_mm(value: float) -> float:
    return value / 1000


def _to_mm(value: float) -> float:
    return value * 1000


def _from_percent(value: float) -> float:
    return value / 100


def _to_percent(value: float) -> float:
    return value * 100
