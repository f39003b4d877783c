"""Running a user's code: what would end or double this process becomes an error of that code, and
an error that it was asked of many at once becomes one of those that it is about."""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

MOST_BLAMED = 8
"""Members of a batch at most that are found to be what errors were about."""


class EndedProcess(Exception):
    """A planner that wanted to end the process it runs in; its traceback leads to the line."""


@contextmanager
def guarded_call() -> Iterator[None]:
    """Code of a user's runs inside.

    `os._exit` and `sys.exit` raise EndedProcess there; so does KeyboardInterrupt where Ctrl-C is
    ignored, as in workers, since it can only come from that code. A forked copy of the process
    that comes back ends here: only one process may go on.

    Afterwards the process is in the folder it was in, its output goes where it went, and numpy
    treats errors as it did: paths of ours are relative to that folder, and what follows must not
    fail, or be silent, for a setting of that code's.
    """
    process, leave, folder = os.getpid(), os._exit, _folder()
    output = [_output(1, sys.stdout), _output(2, sys.stderr)]

    def refuse(status: int) -> None:
        if os.getpid() != process:
            leave(status)
        raise EndedProcess(f"os._exit({status})")

    os._exit = refuse  # type: ignore[assignment]
    try:
        with np.errstate():
            yield
    except SystemExit as error:
        raise EndedProcess(f"SystemExit: {error}").with_traceback(error.__traceback__) from None
    except KeyboardInterrupt as error:
        if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
            raise
        raise EndedProcess("KeyboardInterrupt").with_traceback(error.__traceback__) from None
    finally:
        if os.getpid() != process:
            leave(1)
        os._exit = leave
        sys.stdout, sys.stderr = (each.put_back() for each in output)
        if folder is not None and _folder() != folder:
            with suppress(OSError):  # it was removed
                os.chdir(folder)


@dataclass(frozen=True)
class _Output:
    """Where standard output or standard error goes."""

    number: int
    stream: Any
    copy: int
    """Another descriptor of its file; -1 where it has none."""
    file: tuple[int, int] | None

    def put_back(self) -> Any:
        """Opens its descriptor again if that was closed or leads elsewhere; its stream."""
        if self.file is not None and _file(self.copy) == self.file:  # the copy may be closed, too
            if _file(self.number) != self.file:
                os.dup2(self.copy, self.number)
            os.close(self.copy)
        if getattr(self.stream, "closed", False) and _file(self.number) is not None:
            return open(self.number, "w", buffering=1, encoding=self.stream.encoding,
                        errors=self.stream.errors, closefd=False)
        return self.stream


def _output(number: int, stream: Any) -> _Output:
    file = _file(number)
    return _Output(number, stream, -1 if file is None else os.dup(number), file)


def _file(descriptor: int) -> tuple[int, int] | None:
    """What tells the file of a descriptor from others; None where it is not open."""
    try:
        status = os.fstat(descriptor)
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _folder() -> str | None:
    try:
        return os.getcwd()
    except OSError:  # it was removed
        return None


def told_apart(together: np.ndarray, again: Callable[[np.ndarray], np.ndarray]) -> None:
    """Which members of a batch, numbers (member,), an error was about that ended them together.

    They are asked of in halves, and those of a half that an error ends in halves of it, until an
    error ends one alone: `again` asks of some, keeps what comes of it, and returns those that an
    error ended. Once `MOST_BLAMED` were found the others stay ended together, so that code that
    always fails costs little.
    """
    waiting, blamed = [together], 0
    while waiting and blamed < MOST_BLAMED:
        last = waiting.pop()
        if len(last) < 2:
            blamed += len(last)
            continue
        middle = len(last) // 2
        for half in (last[middle:], last[:middle]):
            waiting.append(again(half))
