"""Units and checks of the parameter tables in a spec, derived from their dataclasses.

The program uses SI units. In a spec, lengths are in mm and angles in degrees, and keys end in the
unit: the field `link_radius_m` has the key `link_radius_mm`, and `speed_rad_s` has `speed_deg_s`.
Types, bounds and choices come from the dataclass fields.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cache
from math import degrees, inf, radians
from types import UnionType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from pydantic import Field, TypeAdapter, ValidationError

from sweeps.spec.errors import KeyPath, Problems, choose, short

# A trailing m or rad is a length or an angle, unless it belongs to a compound: N_m, Nm_rad, per_m.
_UNIT = re.compile(r"^(?P<stem>.*(?<!_N)(?<!_Nm)(?<!_per))_(?P<unit>m|rad)(?P<rate>_s)?$")


@dataclass(frozen=True)
class SpecField:
    """A field of a parameter table and its key in a spec."""

    name: str  # in the table, SI
    key: str  # in a spec
    to_si: Callable[[float], float]
    from_si: Callable[[float], float]
    adapter: TypeAdapter[Any]
    choices: tuple[str, ...]
    default: Any
    doc: str

    def read(self, value: Any, path: KeyPath, problems: Problems) -> Any:
        """The checked value in SI units, or None after adding its errors to `problems`."""
        if self.choices and not (isinstance(value, str) and value in self.choices):
            problems.add(path, f"is {short(value)}; {choose(value, self.choices)}")
            return None
        try:
            return _apply(self.to_si, self.adapter.validate_python(value))
        except ValidationError as error:
            for detail in error.errors(include_url=False):
                problems.add((*path, *detail["loc"]), _message(detail))
        except OverflowError:
            problems.add(path, f"is {short(value)}; should be a number a float can hold")
        return None

    @property
    def spec_default(self) -> Any:
        """The default in the units of the spec, rounded to 10 digits; None if unset."""
        if self.default is None or self.to_si is _same:
            return _apply(_same, self.default)
        return _apply(lambda v: float(f"{self.from_si(v):.10g}"), self.default)


@cache
def spec_fields(table: type) -> dict[str, SpecField]:
    """Every field of a parameter dataclass, by its name in a spec."""
    hints = get_type_hints(table)
    found = [_spec_field(f.name, hints[f.name], f.default, f.metadata) for f in fields(table)]
    return {field.key: field for field in found}


def read_table(table: type, values: Any, path: KeyPath, problems: Problems,
               ignore: tuple[str, ...] = ()) -> dict[str, Any]:
    """The checked fields of a spec's table in SI units, keyed by the field names."""
    if not isinstance(values, Mapping):
        problems.add(path, f"is {short(values)}; should be a table")
        return {}
    known = spec_fields(table)
    found: dict[str, Any] = {}
    for key, value in values.items():
        if key in ignore:
            continue
        if key not in known:
            problems.add((*path, key), f"unknown key; {choose(key, known)}")
        else:
            found[known[key].name] = known[key].read(value, (*path, key), problems)
    return {name: value for name, value in found.items() if value is not None}


def _spec_field(name: str, hint: Any, default: Any, metadata: Mapping[str, Any]) -> SpecField:
    match = _UNIT.match(name)
    unit = match["unit"] if match else ""
    to_si, from_si = {"m": (_from_mm, _to_mm), "rad": (radians, degrees)}.get(unit, (_same, _same))
    key = name
    if match:
        key = f"{match['stem']}_{ {'m': 'mm', 'rad': 'deg'}[unit]}{match['rate'] or ''}"
    choices = tuple(metadata.get("choices", ()))
    annotation = _annotation(_without_none(hint), default, metadata, from_si)
    return SpecField(name, key, to_si, from_si, TypeAdapter(annotation), choices, default,
                     metadata.get("doc", ""))


def _annotation(hint: Any, default: Any, metadata: Mapping[str, Any],
                from_si: Callable[[float], float]) -> Any:
    if get_origin(hint) is tuple:
        entry = _annotation(get_args(hint)[0], None, metadata, from_si)
        return Annotated[list[entry], Field(strict=True, min_length=len(default),
                                            max_length=len(default))]
    if metadata.get("choices"):
        return Literal[tuple(metadata["choices"])]
    if hint not in (float, int):
        return Annotated[hint, Field(strict=True)]
    limits: dict[str, Any] = {"strict": True}
    for bound, key, unbounded in (("low", "ge", -inf), ("high", "le", inf)):
        value = metadata.get(bound, unbounded)
        if value != unbounded:
            limits[key] = value if hint is int else float(f"{from_si(value):.10g}")
    if hint is float:
        limits["allow_inf_nan"] = False
    return Annotated[hint, Field(**limits)]


def _without_none(hint: Any) -> Any:
    if isinstance(hint, UnionType):
        return next(option for option in get_args(hint) if option is not type(None))
    return hint


def _message(detail: Any) -> str:
    """A pydantic error as a message: the given value, then what is expected."""
    said = detail["msg"]
    said = said.removeprefix("Input ").removeprefix("Value ")
    said = said[:1].lower() + said[1:]
    return f"is {short(detail['input'])}; {said}"


def _apply(change: Callable[[Any], Any], value: Any) -> Any:
    if isinstance(value, list | tuple):
        return tuple(_apply(change, entry) for entry in value)
    return value if isinstance(value, bool | str | None) else change(value)


def _same(value: Any) -> Any:
    return value


def _from_mm(value: float) -> float:
    return value / 1000


def _to_mm(value: float) -> float:
    return value * 1000
