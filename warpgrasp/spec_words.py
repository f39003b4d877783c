"""Words of a spec in Python: `Ring(tilt_deg=50)` as in a spec's `tilt_deg = 50`.

Inside the program all quantities are SI, and so are the fields of the parameter tables. In a spec,
lengths are in mm, angles in degrees and relative errors in percent, and the key ends in the unit:
the field `link_radius_m` has the word `link_radius_mm`, `speed_rad_s` has `speed_deg_s`, and
`link_length_share` has `link_length_pct`.
"""

import re
from collections.abc import Callable
from dataclasses import fields
from difflib import get_close_matches
from functools import wraps
from math import degrees, radians
from typing import Any, TypeVar

# A trailing m or rad is a length or an angle, unless it belongs to a compound: N_m, Nm_rad, per_m.
_UNIT = re.compile(r"^(?P<stem>.*(?<!_N)(?<!_Nm)(?<!_per))_(?P<unit>m|rad)(?P<rate>_s)?$")
_SHARE = re.compile(r"^(?P<stem>link_length|moment_arm|pad_gain)_share$")
Table = TypeVar("Table")


def same(value: Any) -> Any:
    """A value that has no unit, or the same one in a spec."""
    return value


def word_of(field: str) -> tuple[str, Callable[[float], float], Callable[[float], float]]:
    """A field's word in a spec, and the functions from the spec's unit to SI and back."""
    if share := _SHARE.match(field):
        return f"{share['stem']}_pct", _from_percent, _to_percent
    match = _UNIT.match(field)
    if match is None:
        return field, same, same
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

    Its constructor raises TypeError for an unknown word, naming the right one.
    """
    make = table.__init__
    known = {word: (f.name, to_si) for f in fields(table)  # type: ignore[arg-type]
             for word, to_si, _ in [word_of(f.name)]}
    names = {name for name, _ in known.values()}

    @wraps(make)
    def init(self: Any, *values: Any, **words: Any) -> None:
        found = {}
        for word, value in words.items():
            name, to_si = (word, same) if word in names else known.get(word, ("", same))
            if not name:
                near = get_close_matches(word, known, n=1, cutoff=0.5)
                guess = f"did you mean {near[0]}? " if near else ""
                raise TypeError(f"{table.__name__} has no {word!r}; {guess}"
                                f"there are: {', '.join(known)}")
            if name in found:  # in both units
                raise TypeError(f"{table.__name__}: {word_of(name)[0]} and {name} are the same; "
                                "give one")
            found[name] = each(to_si, value)
        make(self, *values, **found)

    table.__init__ = init  # type: ignore[method-assign]
    return table


def _from_mm(value: float) -> float:
    return value / 1000


def _to_mm(value: float) -> float:
    return value * 1000


def _from_percent(value: float) -> float:
    return value / 100


def _to_percent(value: float) -> float:
    return value * 100
