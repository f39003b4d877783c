"""The command line. Commands import what they need when they run, so that help answers at once."""

import errno
import gc
import io
import os
import sys

from cyclopts import (
    CycloptsError,
    MissingArgumentError,
    UnknownCommandError,
    UnusedCliTokensError,
)

from sweeps.cli import (
    arms,
    explore,
    export,
    fit,
    hands,
    learn,
    lists,
    look,
    machine,
    measure,
    study,
)
from sweeps.cli.app import BAD_USAGE, INTERRUPTED, OTHER_SPEC, SOME_FAILED, UsageError, app
from warpgrasp.core.cores import thread_count

# Imported for the commands that they add to the app.
GROUPS = (study, look, explore, fit, learn, lists, export, hands, arms, measure, machine)
DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""Errors after which the same command may succeed: nothing is wrong with what was asked."""
GARBAGE_AFTER = (500_000, 20, 20)
"""Objects made before the youngest are searched for garbage, and searches before older ones are.
Imports make many objects and no garbage: Python's own 700 cost a tenth of a command's time, and a
search after 100,000 still 30 ms, four times in an episode of `explore`."""


def main(arguments: list[str] | None = None) -> None:
    """The entry point: runs a command and exits with its code."""
    gc.set_threshold(*GARBAGE_AFTER)
    if isinstance(sys.stdout, io.TextIOWrapper):  # a terminal may not know all letters of a name
        sys.stdout.reconfigure(errors="backslashreplace")
    # As workers have them. Threads of BLAS gain nothing with matrices of a thousand rows, and on a
    # busy machine their waiting for one another takes a hundred times as long as the work.
    os.environ.setdefault("JAX_PLATFORMS", "cpu")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        thread_count()
    except ValueError as error:
        sys.exit(_refuse(f"warpgrasp: {error}"))
    code = run(sys.argv[1:] if arguments is None else arguments)
    gc.freeze()  # a collection at exit would take 0.7 s
    sys.exit(code)


def run(arguments: list[str]) -> int:
    """Runs a command; the exit code comes back, user errors are one message on stderr."""
    if "--quiet" in arguments:
        from sweeps.output import quietly

        with quietly():
            return run([argument for argument in arguments if argument != "--quiet"])
    if "" in arguments:
        return _refuse("warpgrasp: an argument is empty; leave it out or give it a value")
    try:
        code = app(arguments or ["--help"], exit_on_error=False, print_error=False,
                   result_action="return_value")
    except CycloptsError as error:
        return _refuse(f"warpgrasp: {_wrong_usage(error, arguments)}")
    except UsageError as error:
        return _refuse(f"warpgrasp: {error}")
    except KeyboardInterrupt:
        from sweeps.output import say

        say("interrupted; what was finished is kept")
        return INTERRUPTED
    except BrokenPipeError:
        return 0
    except Exception as error:
        return _explain(error)
    return code if isinstance(code, int) else 0


def _wrong_usage(error: CycloptsError, arguments: list[str]) -> str:
    """What is wrong with the arguments, and where to read what would be right."""
    if isinstance(error, UnusedCliTokensError):
        unused = error.unused_tokens or []
        after = any(word.startswith("-") for word in arguments[:arguments.index(unused[0])]
                    ) if unused and unused[0] in arguments else False
        advice = ("an option that takes several values is repeated, as in --tip A --tip B; "
                  if after else "")
        return f"{', '.join(unused)}: there is no place for it; {advice}see warpgrasp --help"
    if isinstance(error, MissingArgumentError):
        help_text = f"see warpgrasp {arguments[0]} --help"
        if error.keyword:
            return f"{error.keyword}: is given without a value; {help_text}"
        name = error.argument.name if error.argument else "an argument"
        return f"{name}: is missing; {help_text}"
    if isinstance(error, UnknownCommandError):
        from sweeps.spec.errors import choose

        name = (error.unused_tokens or arguments)[0]
        commands = [name for name in app if not name.startswith("-")]
        return f"no command {name!r}; {choose(name, commands)}; see warpgrasp --help"
    return f"{str(error).rstrip('.')}; see warpgrasp --help"


def _explain(error: Exception) -> int:
    """A user error as a message and its exit code; anything else is a defect and raised on."""
    from sweeps.spec.errors import OtherStudy, SpecError, StoreError

    if isinstance(error, SpecError):
        return _refuse(str(error))
    if isinstance(error, OtherStudy):
        return _refuse(str(error), OTHER_SPEC)
    if isinstance(error, StoreError):
        return _refuse(str(error), error.exit_code)
    if isinstance(error, OSError):
        code = SOME_FAILED if error.errno in DISK else BAD_USAGE
        return _refuse(f"{error.filename or 'warpgrasp'}: {error.strerror or error}", code)
    if type(error).__name__ in ("LeaderboardError", "ObjectError", "BodyError", "WaypointError",
                                "PointsError", "HandError", "ArmError"):
        return _refuse(str(error))
    raise error


def _refuse(text: str, code: int = BAD_USAGE) -> int:
    from sweeps.output import say

    say(text)
    return code


if __name__ == "__main__":
    main()
