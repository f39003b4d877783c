"""Running a user's code: what would end or double this process becomes an error of that code."""

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import numpy as np


class EndedProcess(Exception):
    """A planner that wanted to end the process it runs in; its traceback leads to the line."""


@contextmanager
def guarded_call() -> Iterator[None]:
    """Code of a user's runs inside.

    `os._exit` and `sys.exit` raise EndedProcess there; so does KeyboardInterrupt where Ctrl-C is
    ignored, as in workers, since it can only come from that code. A forked copy of the process
    that comes back ends here: only one process may go on.

    Afterwards the process is in the folder it was in, and numpy treats errors as it did: paths of
    ours are relative to that folder, and what follows must not fail for a setting of that code's.
    """
    process, leave, folder = os.getpid(), os._exit, _folder()

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
        if folder is not None and _folder() != folder:
            with suppress(OSError):  # it was removed
                os.chdir(folder)


def _folder() -> str | None:
    try:
        return os.getcwd()
    except OSError:  # it was removed
        return None
