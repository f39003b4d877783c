"""What a planner is, and its registration under a name.

    @planner("mine", "grasps where it likes")
    def mine(belief: Belief) -> list[Probe]: ...

A class or a function that takes keyword options works too: what is registered is called with the
options of the strategy, if there are any, and returns the planner itself; a function of one
argument is the planner.
"""

import inspect
import traceback
from collections.abc import Callable, Sequence
from math import inf, isfinite
from numbers import Integral, Real
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np

from strategies.planners.guarded_call import EndedProcess
from strategies.planners.planner_file import RUNNING
from strategies.planners.probes import Grasp, Probe, ProbeError
from strategies.ready_made import STRATEGIES
from strategies.recovery.belief import Belief
from strategies.recovery.choose_model import Recovered
from warpgrasp.core.plain_text import on_one_line

Maker = TypeVar("Maker", bound=Callable[..., Any])
PLANNERS: dict[str, tuple[Callable[..., Any], str]] = {}


def planner(name: str, doc: str = "") -> Callable[[Maker], Maker]:
    """Register a planner under a name, for `strategy = "name"` in a spec.

    A planner of a file that a spec names is found in its file, and under this name nowhere. Raises
    ValueError for the name of a strategy that ships, TypeError for what is no name.
    """
    if not isinstance(name, str) or not name:
        raise TypeError(f"planner: its name is {name!r:.80}; should be a text, as in "
                        '@planner("mine", "grasps where it likes")')

    def register(found: Maker) -> Maker:
        if not str(getattr(found, "__module__", "")).startswith("strategies.planners."):
            if name in STRATEGIES:
                raise ValueError(f"planner {name!r}: a strategy that ships has this name; give "
                                 "yours another one")
            if RUNNING:
                return found
        PLANNERS[name] = (found, doc or first_line(found))
        return found

    return register


def first_line(found: Any) -> str:
    """The first line of a docstring."""
    return (inspect.getdoc(found) or "").partition("\n")[0]


def whole_option(name: str, value: Any, low: int, high: float = inf) -> int:
    """An option of a planner that is a whole number. Raises ValueError."""
    if not isinstance(value, Integral) or isinstance(value, bool) or not low <= int(value) <= high:
        upto = f" to {high}" if isfinite(high) else ""
        raise ValueError(f"{name} is {value!r}; should be a whole number from {low}{upto}")
    return int(value)


def real_option(name: str, value: Any, low: float, high: float) -> float:
    """An option of a planner that is a number. Raises ValueError."""
    if not isinstance(value, Real) or isinstance(value, bool) or not low <= float(value) <= high:
        raise ValueError(f"{name} is {value!r}; should be a number from {low:g} to {high:g}")
    return float(value)


class Planner(Protocol):
    """A strategy at work: what to do next, given what is believed."""

    def __call__(self, belief: Belief, /) -> Sequence[Probe]: ...  # noqa: D102


class Foreseeing(Protocol):
    """A planner that may try a grasp on a copy of the episode: the oracle."""

    foresee: Callable[[Grasp, np.ndarray], Recovered] | None


def fault_text(planner: Callable[..., Any], error: BaseException) -> str:
    """One line: where the strategy failed (the last line of its own file) and how."""
    if isinstance(error, ProbeError):
        return f"{place_of(planner)}: {error}"
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if f.filename == _code_of(planner)[0]]
    # Without a line of its own: of what it answered with.
    where = (f"{Path(own[-1].filename).name}:{own[-1].lineno}: {own[-1].name}" if own
             else place_of(planner))
    what = (_text_of(error) if isinstance(error, EndedProcess)
            else f"{type(error).__name__}: {_text_of(error)}")
    return on_one_line(f"{where}: {what}"[:400])


def _text_of(error: BaseException) -> str:
    """What an error says; nothing where that fails too."""
    try:
        return str(error)
    except Exception:
        return ""


def place_of(planner: Callable[..., Any]) -> str:
    """File, line and name of a strategy, for a message."""
    file, line, name = _code_of(planner)
    return f"{Path(file).name}:{line}: {name}"


def _code_of(planner: Callable[..., Any]) -> tuple[str, int, str]:
    call = planner if hasattr(planner, "__code__") else type(planner).__call__
    code = getattr(call, "__code__", None)
    if code is None:
        return "", 0, repr(planner)
    return code.co_filename, code.co_firstlineno, code.co_name
