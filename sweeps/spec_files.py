"""Files that a spec names: plain files beside it, no larger than their readers expect."""

from pathlib import Path
from typing import Any

from sweeps.problems import short

CSV_LIMIT = 1 << 20  # bytes of a file of poses or of a profile
MESH_LIMIT = 1 << 28


class NoFile(ValueError):
    """A file that cannot be used; the message says why."""


def named_file(value: Any, base_dir: Path, limit: int) -> Path:
    """The file a spec names, relative to the spec, made absolute. Raises NoFile.

    Devices, pipes and the endless files of /proc, which say that they are empty, are refused.
    """
    if not isinstance(value, str) or not value:
        raise NoFile(f"is {short(value)}; should be a file")
    try:
        file = (base_dir / value).resolve()
        if not file.is_file():
            raise OSError
        size = file.stat().st_size
    except (OSError, ValueError, RuntimeError):
        raise NoFile(f"{short(value)} is not a file; relative to the spec that is "
                     f"{short(str(base_dir / value), 200)}") from None
    if size == 0:
        raise NoFile(f"{short(value)} is empty")
    if size > limit:
        raise NoFile(f"{short(value)} is larger than {limit >> 20} MiB, the limit")
    return file
