"""A user's own file of planners: run as a program is, so that it may import files beside it.

Files beside it that it imports (at its top: later they are not found) belong to it alone: another
planner's file in another folder may have a helper of the same name.
"""

import importlib.util
import os
import sys
from collections.abc import Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from types import ModuleType

from strategies.planners.guarded_call import guarded_call

FILE_LIMIT = 1 << 20


class PlannerError(ValueError):
    """A planner that cannot be found or made; the message says where and what would be right."""


@dataclass(frozen=True)
class PlannerFile:
    """A file that was run, with the SHA-256 of its content and of those beside it, by name."""

    module: ModuleType
    content: str
    beside: Mapping[str, str]


RUNNING: list[Path] = []
"""Files that are being run now."""
_RUN: dict[Path, PlannerFile] = {}
_SET: dict[str, tuple[str | None, str | None]] = {}
"""Environment variables that such files have changed as they were run: as they were, and are."""


def planner_file(file: Path) -> PlannerFile:
    """A file of planners, run again if it or a file beside it has changed. Raises PlannerError."""
    try:
        content = file.read_bytes()
    except OSError as error:
        raise PlannerError(f"{file}: cannot be read: {error.strerror}") from None
    if len(content) > FILE_LIMIT:
        raise PlannerError(f"{file}: {len(content)} bytes; at most {FILE_LIMIT}")
    place = file.resolve()
    known = _RUN.get(place)
    if known is None or known.content != sha256(content).hexdigest() or any(
            _hash(place.with_name(name)) != found for name, found in known.beside.items()):
        known = _RUN[place] = _run(file, place, sha256(content).hexdigest())
    return known


def environment_without_planners() -> dict[str, str]:
    """The environment of this process without what files of planners have changed in it."""
    found: dict[str, str | None] = dict(os.environ)
    found |= {name: before for name, (before, after) in _SET.items() if found.get(name) == after}
    return {name: value for name, value in found.items() if value is not None}


def files_beside(file: Path) -> Mapping[str, str]:
    """What a file imported from beside it when it was last run, and hashes; it is run if need be.

    Raises PlannerError.
    """
    return (_RUN.get(file) or planner_file(file)).beside


def _run(file: Path, place: Path, content: str) -> PlannerFile:
    label = f"_strategy_{sha256((str(place) + content).encode()).hexdigest()[:16]}"
    spec = importlib.util.spec_from_file_location(label, place)
    if spec is None or spec.loader is None:
        raise PlannerError(f"{file}: is no Python file")
    module = importlib.util.module_from_spec(spec)
    folder = str(place.parent)
    others, environment = _taken_out(folder), dict(os.environ)
    sys.modules[label] = module
    sys.path.insert(0, folder)
    importlib.invalidate_caches()
    RUNNING.append(place)
    try:
        with guarded_call(), redirect_stdout(sys.stderr):  # results stay clean of what it prints
            spec.loader.exec_module(module)
        beside = {f"{name}.py": _hash(place.with_name(f"{name}.py")) for name in _taken_out(folder)}
    except BaseException as error:
        del sys.modules[label]
        if isinstance(error, KeyboardInterrupt):
            raise
        raise PlannerError(f"{file}:{_line_in(error, str(place))}: {type(error).__name__}: "
                           f"{error}") from None
    finally:
        RUNNING.remove(place)
        if folder in sys.path:
            sys.path.remove(folder)
        _taken_out(folder)
        sys.modules.update(others)
        for name in {*environment, *os.environ}:
            if (now := os.environ.get(name)) != environment.get(name):
                _SET[name] = _SET.get(name, (environment.get(name),))[0], now
    return PlannerFile(module, content, beside)


def _taken_out(folder: str) -> dict[str, ModuleType]:
    """The modules that are files of a folder, which are no longer imported from here on."""
    found = {name: module for name, module in list(sys.modules.items())
             if getattr(module, "__dict__", {}).get("__file__") == f"{folder}{os.sep}{name}.py"}
    for name in found:
        del sys.modules[name]
    return found


def _hash(file: Path) -> str:
    try:
        return sha256(file.read_bytes()).hexdigest()
    except OSError:
        return ""


def _line_in(error: BaseException, file: str) -> int:
    """The line of a file where an error came from; 0 where it did not."""
    if isinstance(error, SyntaxError) and error.filename == file:
        return error.lineno or 0
    line, trace = 0, error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == file:
            line = trace.tb_lineno
        trace = trace.tb_next
    return line
