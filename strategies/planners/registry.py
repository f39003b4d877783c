"""Finding planners by name: in the package, in installed entry points, in a user's own file."""

import inspect
import sys
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from strategies.planners.guarded_call import guarded_call
from strategies.planners.planner_file import PlannerError, planner_file
from strategies.planners.register import PLANNERS, Planner

GROUP = "warpgrasp.strategies"


def make_planner(call: str, options: Mapping[str, Any]) -> Planner:
    """A planner, fresh for one batch. Raises PlannerError.

    `call` is a registered name, the name of an entry point of the group `warpgrasp.strategies`, or
    `path/to/file.py:name`. A file is run as a program is: name only files you trust.
    """
    found = find_planner(call)
    if inspect.isclass(found) or not takes_belief(found):
        known = options_of(found)
        wrong = sorted(set(options) - set(known)) if known is not None else []
        if wrong:
            raise PlannerError(f"strategy {call!r} has no option {wrong[0]!r}; there are: "
                               f"{', '.join(known or ()) or 'none'}")
        try:
            with guarded_call(), redirect_stdout(sys.stderr):
                made: Any = found(**options)
        except Exception as error:  # anything may go wrong in a planner that somebody else wrote
            raise PlannerError(f"strategy {call!r} cannot take the options {dict(options)!r:.200}: "
                               f"{type(error).__name__}: {error!s:.200}") from None
        if not can_be_asked(made):
            raise PlannerError(f"strategy {call!r}: gives a {type(made).__name__} that cannot be "
                               "asked; a planner is a function of the belief, or a class with a "
                               "method __call__(self, belief)")
        return made
    if options:
        raise PlannerError(f"strategy {call!r} is a plain function; it takes no options, "
                           f"but has {sorted(options)}")
    return found


def takes_belief(found: Any) -> bool:
    """Whether a function is itself a planner: its one required argument is the belief."""
    try:
        needed = [p for p in inspect.signature(found).parameters.values()
                  if p.default is p.empty and p.kind in (p.POSITIONAL_ONLY,
                                                         p.POSITIONAL_OR_KEYWORD)]
    except (TypeError, ValueError):
        return False
    return len(needed) == 1


def options_of(found: Callable[..., Any]) -> tuple[str, ...] | None:
    """Names of the options of what makes a planner; None where any may be given, or is not known.
    """
    try:
        given = inspect.signature(found).parameters.values()
    except (TypeError, ValueError):
        return None
    if any(p.kind is p.VAR_KEYWORD for p in given):
        return None
    return tuple(p.name for p in given if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY))


def can_be_asked(made: Any) -> bool:
    """Whether it can be called with a belief."""
    if not callable(made):
        return False
    try:
        inspect.signature(made).bind(None)
    except TypeError:
        return False
    except ValueError:  # of built-in functions there may be none
        pass
    return True


def find_planner(call: str) -> Callable[..., Any]:
    """What `call` names. Raises PlannerError."""
    for module in ("any_object", "unguided", "adaptive", "expected_error", "oracle"):
        import_module(f"strategies.planners.{module}")  # one after the other: each imports kernels
        if call in PLANNERS:
            return PLANNERS[call][0]
    file, colon, name = call.rpartition(":")
    if colon and file.endswith(".py"):
        return _from_file(Path(file), name)
    for entry in entry_points(group=GROUP):
        if entry.name == call:
            try:
                with guarded_call():
                    return entry.load()
            except Exception as error:
                raise PlannerError(f"strategy {call!r}: its entry point {entry.value} cannot be "
                                   f"loaded: {type(error).__name__}: {error}") from error
    known = ", ".join(sorted(PLANNERS))
    raise PlannerError(f"no strategy {call!r}; there are: {known}; or name a file, as in "
                       "\"mine.py:next_best\"")


def _from_file(file: Path, name: str) -> Callable[..., Any]:
    module = planner_file(file).module
    found = getattr(module, name, None)
    if not callable(found):
        functions = [n for n, v in vars(module).items() if callable(v) and not n.startswith("_")]
        raise PlannerError(f"{file}: has no function or class {name!r}; it has: "
                           f"{', '.join(functions) or 'none'}")
    return found
