"""Locks of files, which the kernel releases when their holder dies, however that happens."""

import fcntl
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

TURN = ".lock-turn"
"""Of a directory: whoever begins to work there holds it for a moment."""


def try_lock(descriptor: int) -> bool:
    """Takes a file's lock; patient for a moment, since `holder_of` touches it in passing."""
    for _ in range(10):
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            time.sleep(0.05)
        else:
            return True
    return False


def holder_of(file: Path) -> str | None:
    """What the holder of a file's lock wrote there; None where nobody holds it. Raises OSError."""
    with file.open("rb") as stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return stream.read(200).decode(errors="replace")
    return None


def held_locks(folder: Path, unknown: bool = False) -> dict[str, str]:
    """What the holders of a directory's shards wrote, by shard (`1-of-3`). Of a lock that cannot be
    looked at it is `unknown`; asked for, it stands there as held."""
    found: dict[str, str] = {}
    for file in sorted(folder.glob(".lock-*-of-*")):
        shard = file.name.removeprefix(".lock-")
        try:
            holder = holder_of(file)
        except OSError:  # it may not be read, or the file system has no flock
            holder = "" if unknown else None
        found |= {} if holder is None else {shard: holder}
    return found


def sign(descriptor: int, command: str, study: str = "") -> None:
    """Writes into a lock who holds it; below, the hash of the study that it is held for, and the
    command (`sweep` or `race`)."""
    os.ftruncate(descriptor, 0)
    lines = f"process {os.getpid()} on {socket.gethostname()}", study, command
    os.pwrite(descriptor, "\n".join(lines).encode(), 0)


def signature(text: str) -> tuple[str, str, str]:
    """What `sign` wrote: holder, study and command; empty where it did not, or not yet."""
    holder, study, command = (*text.split("\n"), "", "")[:3]
    return holder, study, command


def same_file(descriptor: int, file: Path) -> bool:
    """Whether an open file still has this name."""
    try:
        return os.path.samestat(os.fstat(descriptor), file.stat())
    except OSError:
        return False


@contextmanager
def turn(folder: Path) -> Iterator[None]:
    """One process at a time is inside, of all that begin in a directory. Raises OSError."""
    try:
        descriptor = os.open(folder / TURN, os.O_RDWR | os.O_CREAT, 0o644)
    except PermissionError:  # another user, whose run shares the directory, has made it
        descriptor = os.open(folder / TURN, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
