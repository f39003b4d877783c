"""Writing a file so that it is there whole or not at all, whatever stops the program."""

import os
from pathlib import Path


def write_atomic(path: Path, content: bytes) -> None:
    """Writes under a temporary name, syncs, renames, and syncs the folder."""
    temporary = path.with_name(f".{path.name}.{os.urandom(6).hex()}.tmp")
    try:
        with temporary.open("wb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)
