"""What a comparison with another engine comes to: rows of ours, theirs, difference, bound, ok."""

from dataclasses import dataclass
from math import isnan, nan
from typing import Any


@dataclass(frozen=True)
class Comparison:
    """One line of the table. `bound` NaN: for information, without a bound."""

    check: str
    what: str
    unit: str
    ours: float
    theirs: float
    difference: float
    bound: float = nan
    note: str = ""

    @property
    def ok(self) -> bool:
        """Whether the difference keeps its bound."""
        return isnan(self.bound) or self.difference <= self.bound

    def cells(self) -> tuple[str, ...]:
        """As text, in the order of `HEADER`."""
        held = "" if isnan(self.bound) else "yes" if self.ok else "NO"
        return (self.check, self.what, self.unit, _text(self.ours), _text(self.theirs),
                _text(self.difference), _text(self.bound), held, self.note)


HEADER = ("check", "what", "unit", "ours", "theirs", "difference", "bound", "ok", "note")


def _text(value: float) -> str:
    return "" if isnan(value) else f"{value:.4g}"


class MissingEngine(Exception):
    """An engine to compare with is not installed."""


def engine(name: str) -> Any:
    """Import an engine. Raises MissingEngine."""
    from importlib import import_module

    try:
        return import_module(name)
    except ImportError as error:
        raise MissingEngine(f"{name} is not installed ({error})") from None
