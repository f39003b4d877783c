"""Compiled programs cached on disk, so that a warm start neither traces nor compiles.

JAX's own cache avoids compiling, but a program must be traced and lowered to be looked up, which
takes seconds here. Instead the executables are stored, one file each, in a folder named by a hash
of everything they depend on: this package's source, package versions, processor, XLA flags. The
files are pickles: they are loaded only with their checksum, as the user's own, from a folder that
nobody else may write to (`warpgrasp.core.cache_file`); all others are replaced.
"""

import os
import pickle
import platform
from collections.abc import Callable
from functools import lru_cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

import jax
from jax.experimental import serialize_executable

from fit.optimize.xla_flags import xla_flags_active
from warpgrasp.core.cache_file import cache_root, read_cached, write_cached


def load_or_compile(name: str, function: Any, arguments: tuple) -> Callable:
    """The jitted `function` compiled for arguments of these shapes, from the cache if present.

    `name` and the shapes identify the program, so `name` must state all that `function` closes
    over.
    """
    shapes = jax.tree.map(lambda leaf: (leaf.shape, leaf.dtype.str), arguments)
    file = _folder() / (sha256(f"{name}\n{shapes}".encode()).hexdigest()[:32] + ".xla")
    try:
        payload, skeleton = pickle.loads(read_cached(file) or b"")
        _load_linear_algebra()
        return _loaded(payload, jax.tree.structure((arguments, {})), jax.tree.structure(skeleton))
    except Exception:  # absent, damaged or incompatible: compile
        compiled = function.lower(*arguments).compile()
    if not xla_flags_active():
        return compiled  # compiled with other flags than the folder name states
    try:
        payload, given, result = serialize_executable.serialize(compiled)
        # A program from JAX's own cache is serialized incompletely; loading it raises.
        _loaded(payload, given, result)
        skeleton = jax.tree.unflatten(result, range(result.num_leaves))
        write_cached(file, pickle.dumps((payload, skeleton)))
    except Exception:  # only time is lost
        pass
    return compiled


def _loaded(payload: bytes, given: Any, result: Any) -> Callable:
    return serialize_executable.deserialize_and_load(
        payload, given, result, "cpu", [cpu_device()])


@lru_cache(maxsize=1)
def cpu_device() -> Any:
    """JAX's CPU, where fits are computed also if JAX has a GPU: their groups of lanes are too small
    for one, and results shall not depend on what JAX was installed for."""
    return jax.devices("cpu")[0]


def has_cached_programs() -> bool:
    """Whether the cache holds a program of this version."""
    return any(_folder().glob("*.xla"))


@lru_cache(maxsize=1)
def _folder() -> Path:
    digest = sha256()
    for file in sorted(Path(__file__).parent.parent.rglob("*.py")):
        digest.update(file.read_bytes())
    for fact in (*(version(package) for package in ("jax", "jaxlib", "jaxopt", "numpy")),
                 platform.platform(), platform.python_version(), _processor(),
                 os.environ.get("XLA_FLAGS", "")):
        digest.update(f"\n{fact}".encode())
    return cache_root() / "programs" / digest.hexdigest()[:16]


def _processor() -> str:
    """Model and features of the processor, which XLA compiles for."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return f"{platform.machine()} {platform.processor()}"
    wanted = ("vendor_id", "cpu family", "model", "flags", "Features", "CPU part")
    return "\n".join(sorted({line for line in lines if line.startswith(wanted)}))


@lru_cache(maxsize=1)
def _load_linear_algebra() -> None:
    """Make JAX fill in the addresses of LAPACK, which it does when it first lowers such a call."""
    jax.jit(jax.lax.linalg.cholesky).lower(jax.ShapeDtypeStruct((2, 2), "float64"))

