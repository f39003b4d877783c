"""Checksums for the compiled kernels that Warp keeps between runs.

Warp loads a compiled kernel without looking at its content, and a damaged one gives other results
or ends the process. So a file `NAME.sha256` is put beside each file of a module's folders, and a
folder with a file that no longer fits is removed before Warp loads from it; Warp then compiles
again. Folders without checksums (of an earlier version, or just compiled) are given theirs after
the first launch.
"""

import os
import shutil
from collections.abc import Iterator
from contextlib import suppress
from hashlib import sha256
from pathlib import Path

import warp as wp

from warpgrasp.core.cache_file import cache_home, kernel_root

_HASH = "[0-9a-f]" * 7
_SUFFIX = ".sha256"


def place_kernels() -> None:
    """Before Warp starts: names a folder for its kernels where it would find none. Without one it
    does not start, or makes one named `~` in the working directory."""
    if cache_home() is None and wp.config.kernel_cache_dir is None:
        wp.config.kernel_cache_dir = str(kernel_root())


def has_kernels(module: str) -> bool:
    """Whether a compiled version of a module's kernels is kept, be it of this program or before."""
    return bool(_folders(module))


def check_kernels(module: str) -> None:
    """Removes what is damaged of a module's compiled kernels; before its first launch."""
    for folder in _folders(module):
        for file in _compiled(folder):
            with suppress(OSError):
                seal = file.with_name(file.name + _SUFFIX)
                if seal.exists() and seal.read_bytes() != _digest(file):
                    shutil.rmtree(folder, ignore_errors=True)
                    break


def seal_kernels(module: str) -> None:
    """Notes the checksums of a module's compiled kernels; after its first launch."""
    for folder in _folders(module):
        for file in _compiled(folder):
            seal = file.with_name(file.name + _SUFFIX)
            with suppress(OSError):  # a read-only cache stays as it is
                if not seal.exists():
                    temporary = seal.with_name(f"{seal.name}.{os.urandom(6).hex()}.tmp")
                    temporary.write_bytes(_digest(file))
                    os.replace(temporary, seal)


def drop_kernels(*packages: str) -> None:
    """Removes all compiled kernels of some packages, as ("warpgrasp",)."""
    for package in packages:
        for folder in [*_folders(package), *_folders(f"{package}.*")]:
            shutil.rmtree(folder, ignore_errors=True)


def _folders(module: str) -> list[Path]:
    wp.init()  # which names the folder
    root = wp.config.kernel_cache_dir
    return sorted(Path(root).glob(f"wp_{module}_{_HASH}")) if root else []


def _compiled(folder: Path) -> Iterator[Path]:
    """All but the checksums, and the source, which Warp does not read again."""
    return (file for file in sorted(folder.iterdir())
            if file.suffix not in (_SUFFIX, ".cpp", ".cu", ".tmp"))


def _digest(file: Path) -> bytes:
    return sha256(file.name.encode() + b"\0" + file.read_bytes()).hexdigest().encode()
