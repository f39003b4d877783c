"""What a strategy did wrong, said so that its author finds the place."""

import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from strategies.probes import ProbeError

Planner = Callable[..., Any]


def fault_text(planner: Planner, error: BaseException) -> str:
    """One line: where the strategy failed (the last line of its own file) and how."""
    if isinstance(error, ProbeError):
        return f"{place_of(planner)}: {error}"
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if f.filename == _code_of(planner)[0]]
    if not own:  # of what it answered with
        return f"{place_of(planner)}: {type(error).__name__}: {error}"[:400].replace("\n", " ")
    where = f"{Path(own[-1].filename).name}:{own[-1].lineno}: {own[-1].name}"
    return f"{where}: {type(error).__name__}: {error}"[:400].replace("\n", " ")


def place_of(planner: Planner) -> str:
    """File, line and name of a strategy, for a message."""
    file, line, name = _code_of(planner)
    return f"{Path(file).name}:{line}: {name}"


def _code_of(planner: Planner) -> tuple[str, int, str]:
    call = planner if hasattr(planner, "__code__") else type(planner).__call__
    code = getattr(call, "__code__", None)
    if code is None:
        return "", 0, repr(planner)
    return code.co_filename, code.co_firstlineno, code.co_name
