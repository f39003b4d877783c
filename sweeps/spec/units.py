"""Units and checks of the parameter tables in a spec, derived from their dataclasses.

The program uses SI units, a spec mm and degrees (`warpgrasp.spec_words`). Types, bounds and
choices come from the dataclass fields.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cache
from math import inf
from types import UnionType
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, create_model

from sweeps.spec.errors import KeyPath, Problems, choose, short
from warpgrasp.spec_words import each, same, word_of


@dataclass(frozen=True)
class SpecField:
    """A field of a parameter table and its key in a spec."""

    table: type
    name: str  # in the table, SI
    key: str  # in a spec
    kind: type  # of the value, or of each entry of a list
    low: float  # in the units of the spec, as `high`
    high: float
    to_si: Callable[[float], float]
    from_si: Callable[[float], float]
    choices: tuple[str, ...]
    default: Any
    doc: str

    def read(self, value: Any, path: KeyPath, problems: Problems) -> Any:
        """The checked value in SI units, or None after adding its errors to `problems`."""
        return _read(self.table, {self.key: value}, problems,
                     lambda where: (*path, *where[1:])).get(self.name)

    @property
    def spec_default(self) -> Any:
        """The default in the units of the spec, rounded to 10 digits; None if unset."""
        if self.default is None or self.to_si is same:
            return each(same, self.default)
        return each(lambda v: float(f"{self.from_si(v):.10g}"), self.default)


@cache
def spec_fields(table: type) -> dict[str, SpecField]:
    """Every field of a parameter dataclass that has a `doc`, by its name in a spec."""
    hints = get_type_hints(table)
    found = [_spec_field(table, f.name, hints[f.name], f.default, f.metadata)
             for f in fields(table) if "doc" in f.metadata]
    return {field.key: field for field in found}


@cache
def _model(table: type) -> type[BaseModel]:
    """The pydantic model of a spec's table: keys and units of the spec in, SI out."""
    parts: dict[str, Any] = {}
    for key, f in spec_fields(table).items():
        of_key = Annotated[_annotation(f), AfterValidator(_to_si(f))]
        parts[_attribute(key)] = of_key, Field(default=None, alias=key)
    return create_model(table.__name__, __config__=ConfigDict(extra="forbid"), **parts)


def _to_si(f: SpecField) -> Callable[[Any], Any]:
    """A field's value in SI. What the template writes for the default is the default itself: in SI
    it may differ in its last bits, since it is rounded."""
    written = repr(each(float, f.spec_default)) if f.to_si is not same else ""  # tells 0 from -0

    def converted(value: Any) -> Any:
        if written and repr(each(float, value)) == written:
            return f.default
        return each(f.to_si, value)

    return converted


def _attribute(key: str) -> str:
    return f"{key}_"  # keys such as `schema` are names that pydantic needs itself


def read_table(table: type, values: Any, path: KeyPath, problems: Problems,
               instead: str = "a table") -> dict[str, Any]:
    """The checked fields of a spec's table in SI units, keyed by the field names; `instead` is what
    should stand where there is no table."""
    if isinstance(values, Mapping):
        return _read(table, dict(values), problems, lambda where: (*path, *where))
    problems.add(path, f"is {short(values)}; should be {instead}")
    return {}


def _read(table: type, values: dict[str, Any], problems: Problems,
          place: Callable[[KeyPath], KeyPath]) -> dict[str, Any]:
    """The values that are right, in SI; the others' errors go to `problems`, each at its place."""
    known = spec_fields(table)
    try:
        found = _model(table).model_validate(values)
    except ValidationError as error:
        details = error.errors(include_url=False)
        for detail in details:
            problems.add(place(detail["loc"]), _message(detail, known))
        wrong = {detail["loc"][0] for detail in details}
        values = {key: value for key, value in values.items() if key not in wrong}
        found = _model(table).model_validate(values)
    return {known[key].name: getattr(found, _attribute(key)) for key in values}


def _spec_field(table: type, name: str, hint: Any, default: Any,
                metadata: Mapping[str, Any]) -> SpecField:
    key, to_si, from_si = word_of(name)
    if isinstance(hint, UnionType):  # with None: unset
        hint = next(option for option in get_args(hint) if option is not type(None))
    kind = get_args(hint)[0] if get_origin(hint) is tuple else hint
    low, high = metadata.get("low", -inf), metadata.get("high", inf)
    if kind is float:
        low, high = (float(f"{from_si(v):.10g}") for v in (low, high))
    return SpecField(table, name, key, kind, low, high, to_si, from_si,
                     tuple(metadata.get("choices", ())), default, metadata["doc"])


def _annotation(f: SpecField) -> Any:
    """What pydantic checks a value by, in the units of the spec."""
    if f.choices:
        return Literal[f.choices]
    limits: dict[str, Any] = {"ge": f.low, "le": f.high} if f.kind in (int, float) else {}
    if f.kind is float:
        limits["allow_inf_nan"] = False
    entry = Annotated[f.kind, Field(strict=True, **limits)]
    if not isinstance(f.default, tuple):
        return entry
    return Annotated[list[entry], Field(strict=True, min_length=len(f.default),
                                        max_length=len(f.default))]


def _message(detail: Any, known: Mapping[str, SpecField]) -> str:
    """A pydantic error as a message: the given value, then what is expected."""
    field = known.get(detail["loc"][0])
    if field is None:
        return f"unknown key; {choose(detail['loc'][0], known)}"
    given = f"is {short(detail['input'])}; "
    if field.choices:
        return given + choose(detail["input"], field.choices)
    bounds = f"from {_text(field.low)} to {_text(field.high)}"
    if detail["type"] in ("list_type", "too_short", "too_long"):
        each_from = f", each {bounds}" if field.high < inf else ""
        return f"{given}should be a list of {len(field.default)} numbers{each_from}"
    if field.kind is bool:
        return f"{given}should be true or false"
    if field.high < inf:
        if field.low == field.high:
            return f"{given}should be {_text(field.low)}"
        number = "a whole number" if field.kind is int else "a number"
        return f"{given}should be {number} {bounds}"
    said = detail["msg"].removeprefix("Input ").removeprefix("Value ")
    return f"{given}{said[:1].lower()}{said[1:]}"


def _text(number: float) -> str:
    return f"{number:.10g}" if isinstance(number, float) else str(number)
