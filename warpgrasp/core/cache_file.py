"""Files kept between runs only to save time: each carries a checksum and is trusted only if nobody
else can have written it.

A file that is absent, damaged, renamed, or not the user's own reads as absent, so that its content
is made again: a cache is never part of a result. Writing is best effort: a full disk or a read-only
home costs time, not the run.
"""

import os
import shutil
import tempfile
from contextlib import suppress
from functools import cache
from hashlib import sha256
from pathlib import Path

_CHECKSUM_BYTES = 32
_OTHERS_WRITE = 0o022


def cache_root() -> Path:
    """The user's cache folder of this package: WARPGRASP_CACHE, or that among their caches."""
    own = os.environ.get("WARPGRASP_CACHE")
    return Path(own) if own else (cache_home() or _among_temporary()) / "warpgrasp"


def kernel_root() -> Path:
    """Where Warp keeps compiled kernels: WARP_CACHE_PATH, or its folder among the user's caches."""
    own = os.environ.get("WARP_CACHE_PATH")
    return Path(own) if own else (cache_home() or _among_temporary()) / "warp"


def cache_home() -> Path | None:
    """The folder of the user's caches: XDG_CACHE_HOME, or .cache in their home. None where they
    have no home, or one in which nothing can be made, as in containers."""
    given = os.environ.get("XDG_CACHE_HOME")
    if given:
        return Path(given)
    try:
        folder = Path.home() / ".cache"
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: no home
        return None
    return folder


@cache
def _among_temporary() -> Path:
    """A folder for caches of this user alone, which may go when the machine or container ends."""
    folder = Path(tempfile.gettempdir()) / f"cache-of-user-{os.getuid()}"
    with suppress(OSError):
        folder.mkdir(mode=0o700, exist_ok=True)
        if _own(folder):
            return folder
    return Path(tempfile.mkdtemp(prefix="cache-"))


def read_cached(file: Path) -> bytes | None:
    """The content that `write_cached` gave this file; None where it is not to be trusted."""
    try:
        if not (_own(file) and _own(file.parent)):
            return None
        stored = file.read_bytes()
    except OSError:
        return None
    content = stored[_CHECKSUM_BYTES:]
    return content if stored[:_CHECKSUM_BYTES] == _checksum(file.name, content) else None


def write_cached(file: Path, content: bytes) -> None:
    """Writes a file whole or not at all; what others may have put into its folder goes first."""
    temporary = file.with_name(f".{file.name}.{os.urandom(6).hex()}.tmp")
    try:
        file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        if not _own(file.parent):
            _empty(file.parent)
        temporary.write_bytes(_checksum(file.name, content) + content)
        os.replace(temporary, file)
    except OSError:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def drop_cached(folder: Path) -> None:
    """Removes a folder of the cache and all in it."""
    shutil.rmtree(folder, ignore_errors=True)


def _own(path: Path) -> bool:
    """Whether only this user can have written a file, or put one into a folder."""
    found = path.stat()
    return found.st_uid == os.getuid() and not found.st_mode & _OTHERS_WRITE


def _empty(folder: Path) -> None:
    """Takes a folder back for this user alone. Raises OSError where it is another's."""
    folder.chmod(0o700)
    for left in folder.iterdir():
        if left.is_file() or left.is_symlink():
            left.unlink()


def _checksum(name: str, content: bytes) -> bytes:
    return sha256(name.encode() + b"\0" + content).digest()
