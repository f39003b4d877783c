"""Output streams, Warp's start, and atomic file writes."""

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from functools import cache
from pathlib import Path
from typing import BinaryIO

from warpgrasp.core.plain_text import printable

# Printed by native code on machines without a GPU; Warp has no setting to suppress it.
NO_DRIVER = b"Could not find or load the NVIDIA CUDA driver"

ASKED = "WARPGRASP_QUIET"


@contextmanager
def quietly() -> Iterator[None]:
    """Suppress progress and notes on stderr in this process and its workers; errors remain."""
    before = os.environ.get(ASKED, "")
    os.environ[ASKED] = "1"
    try:
        yield
    finally:
        os.environ[ASKED] = before


def is_quiet() -> bool:
    """Whether `--quiet` was given, or WARPGRASP_QUIET=1 is set."""
    return os.environ.get(ASKED, "") not in ("", "0")


@contextmanager
def quiet_stdout() -> Iterator[None]:
    """Redirect standard output to stderr, so that library output stays out of results."""
    with redirect_stdout(sys.stderr):
        yield


def devices() -> list[str]:
    """The devices of this machine: cpu, cuda:0, ..."""
    init_warp()
    import warp

    return [str(device) for device in warp.get_devices()]


@cache
def init_warp() -> None:
    """Initialize Warp and pass on its messages, except the one about a missing GPU driver."""
    import warp

    from warpgrasp.core.kernel_cache import place_kernels

    warp.config.log_level = warp.LOG_ERROR
    place_kernels()
    sys.stderr.flush()
    kept = os.dup(2)
    try:
        with tempfile.TemporaryFile() as said:
            os.dup2(said.fileno(), 2)
            try:
                warp.init()
            finally:
                os.dup2(kept, 2)
            said.seek(0)
            for line in said:
                if NO_DRIVER not in line:
                    os.write(2, line)
    finally:
        os.close(kept)


def say(text: str) -> None:
    """Print a message on stderr; control characters in what came from a user are escaped."""
    print(printable(text), file=sys.stderr, flush=True)


def note(text: str) -> None:
    """`say`, unless notes are suppressed by `--quiet`."""
    if not is_quiet():
        say(text)


def extra_hint(extra: str) -> str:
    """How to install one of the package's optional groups."""
    return f"run `pip install '.[{extra}]'` in the clone"


def write_atomic(path: Path, content: bytes) -> None:
    """Write a temporary file, sync it, rename it to `path`, and sync the folder.

    Raises OSError that names `path`.
    """
    with atomic_file(path) as stream:
        stream.write(content)


@contextmanager
def atomic_file(path: Path) -> Iterator[BinaryIO]:
    """A temporary file to write to; it becomes `path`, or what a link there stands for, at the end,
    and is removed on an error. What is no plain file, such as a pipe, is written to itself."""
    if path.exists() and not path.is_file():
        with path.open("wb") as stream:
            yield stream
        return
    path = Path(os.path.realpath(path))
    temporary = path.with_name(f".{path.name}.{os.urandom(6).hex()}.tmp")
    try:
        with temporary.open("wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except BaseException as error:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise OSError(error.errno, error.strerror, str(path)) from None
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
